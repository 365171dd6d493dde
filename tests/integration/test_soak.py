import asyncio
import contextlib
import json
import random
import select
import threading
import urllib.request
from collections import Counter
from dataclasses import replace

import aiohttp
import psutil
import pytest

from bluerov_slam.protocol.esp32_messages import MessageType
from bluerov_slam.records import Ping, SensorSample
from bluerov_slam.services.simulator import SerialNode
from bluerov_slam.simulation.faults import WireFaults, parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from firmware_build import board_in_the_loop
from running_system import RunningServices

DIVE_S = 1200.0
STEP_S = 0.02
SEED = 20
GROWTH_LIMIT_MB = 15.0
LOG_LIMIT_BYTES = 1_000_000
SENSORS_HEADER = b"\xaa\x55" + bytes((MessageType.SENSORS,))
LASTING = (
    "bit_errors rate=3e-4", "garbage rate=8", "drop rate=2e-3", "probe rate=4", "i2c_errors",
    "silent sensor=imu", "silent sensor=gps", "silent sensor=b", "silent sensor=depth",
)  # fmt: skip

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]


class WitnessedWire(WireFaults):
    """Notes `ts` of every SENSORS frame that left the board, and of those that the faults left whole."""

    def __init__(self, seed):
        super().__init__(seed)
        self.sent = 0
        self.whole = Counter()

    def damage(self, data, at_s, faults):
        result = super().damage(data, at_s, faults)
        if data.startswith(SENSORS_HEADER):
            self.sent += 1
            if data in result:
                self.whole[int.from_bytes(data[5:9], "little")] += 1
        return result


class FastForward(threading.Thread):
    """Runs the board ahead of time, as fast as the reader of its port takes the bytes; loses none of them."""

    def __init__(self, board, link, bytes_taken):
        super().__init__(daemon=True)
        self.board = board
        self.bytes_written = 0
        self.replugs = 0
        self.problem = None
        self.ended = threading.Event()
        self._link = link
        self._bytes_taken = bytes_taken
        self._node = None

    def run(self):
        try:
            while self.board.now_s < DIVE_S and not self.ended.is_set():
                self._step()
            self._drain()
        except Exception as problem:
            self.problem = problem
        finally:
            self.ended.set()

    def close(self):
        self.ended.set()
        self.join(30)
        if self._node is not None:
            self._node.close()
        self.board.close()

    def _step(self):
        data = self.board.advance(self.board.now_s + STEP_S)
        if not self.board.plugged and self._node is not None:
            self._drain()
            self._node.close()
            self._node = None
            self.replugs += 1
        elif self.board.plugged and self._node is None:
            self._node = SerialNode([self._link])
        if self._node is None:
            return
        heard, listening = self._node.read()
        if heard:
            self.board.receive(heard, self.board.now_s)
        while not listening and not self.ended.wait(0.01):
            _, listening = self._node.read()
        while data and not self.ended.is_set():
            written = self._node.write(data)
            self.bytes_written += written
            data = data[written:]
            if data:
                select.select([], [self._node.master], [], 0.1)

    def _drain(self):
        """Until the reader has everything: closing the port loses what it has not read."""
        while self._bytes_taken() < self.bytes_written and not self.ended.wait(0.05):
            pass


def make_board():
    scenario = replace(SCENARIOS["survey"], mission_start_s=60.0, seed=SEED)
    board = VirtualEsp32(scenario, board=board_in_the_loop(scenario))
    board._wire_faults = WitnessedWire(SEED)
    dice = random.Random(SEED)
    at_s, number = 20.0, 0
    while at_s < DIVE_S - 20.0:
        number += 1
        if number % 50 == 0:
            board.add_fault(parse_fault(f"kind=unplug at={at_s} duration=2"))
        elif number % 12 == 0:
            board.add_fault(parse_fault(f"kind=reset at={at_s} reason={dice.choice((1, 4, 9))}"))
        elif number % 7 == 0:
            board.add_fault(parse_fault(f"kind=mid_ping sensor=b at={at_s}"))
        else:
            board.add_fault(parse_fault(f"kind={dice.choice(LASTING)} at={at_s} duration={dice.uniform(0.5, 3.0)}"))
        at_s += dice.uniform(3.0, 8.0)
    return board


async def come_and_go(services, seed, visits):
    """A user who opens a page, looks for a while, sometimes without reading, and leaves without a word."""
    dice = random.Random(seed)
    addresses = [("http", "/ws"), ("viewer", "/ws"), ("sensor_ws", "/"), ("waterfall_ws", "/")]
    while True:
        service, path = dice.choice(addresses)
        async with aiohttp.ClientSession() as client:
            stream = await client.ws_connect(services.url(path, service), max_msg_size=0)
            with contextlib.suppress(TimeoutError):
                for _ in range(dice.randint(1, 60)):
                    message = await stream.receive(timeout=3.0)
                    assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
                    visits[service] += 1
            await asyncio.sleep(dice.choice((0.0, 0.0, 1.0)))
            stream._response.connection.transport.abort()


async def test_twenty_minutes_of_faults_leave_no_trace(tmp_path):
    board = make_board()
    services = RunningServices(tmp_path, str(tmp_path / "esp32"), {"serial.baud": "921600"})

    def bytes_taken():
        with contextlib.suppress(OSError), urllib.request.urlopen(services.url("/api/state"), timeout=10) as answer:
            return json.load(answer)["link"]["bytes"]
        return 0

    forward = FastForward(board, tmp_path / "esp32", bytes_taken)
    visits = Counter()
    visitors = []
    try:
        forward.start()
        await services.until_up()
        visitors = [asyncio.create_task(come_and_go(services, seed, visits)) for seed in range(3)]
        early = None
        while not forward.ended.is_set():
            await asyncio.sleep(0.2)
            services.assert_alive()
            assert not any(visitor.done() for visitor in visitors), visitors
            if early is None and board.now_s > DIVE_S / 4:
                early = memory_mb(services)
        assert forward.problem is None
        late = memory_mb(services)
        state = await services.get("/api/state")
        viewer = (await services.get("/api/status", "viewer"))["channels"]
        await services.terminate()
    finally:
        forward.close()
        for visitor in visitors:
            visitor.cancel()
        await asyncio.gather(*visitors, return_exceptions=True)
        await services.kill()

    assert not services.complaints(), services.complaints()[:20]
    assert all(len(services.log(name)) < LOG_LIMIT_BYTES for name in services.processes)
    assert all(late[name] - early[name] < GROWTH_LIMIT_MB for name in late), (early, late)
    assert len(visits) == 4, visits
    assert_counters_agree(state, viewer, forward)
    assert_everything_is_recorded(services, state, board)


def assert_counters_agree(state, viewer, forward):
    link = state["link"]
    assert link["bytes"] == forward.bytes_written
    assert sum(link["frames_by_type"].values()) == link["frames"]
    assert (link["connected"], link["reconnects"]) == (True, forward.replugs)
    assert forward.replugs > 2
    assert min(link[key] for key in ("crc_errors", "length_errors", "bytes_skipped", "resyncs")) > 0
    assert state["recorder"]["dropped"] == 0
    for channel, sonar in state["sonars"].items():
        assert sonar["pings"] > 0.9 * DIVE_S / 0.1
        assert sonar["checksum_errors"] == viewer[channel]["checksum_errors"] == 0
        assert viewer[channel]["bb55"] > 0.99 * sonar["frames"], "next to nothing is lost on the way to the viewer"


def assert_everything_is_recorded(services, state, board):
    records = services.records()
    received = Counter(record.device_ms for record in records if isinstance(record, SensorSample))
    assert received.total() == state["link"]["frames_by_type"]["0x01"]
    wire = board._wire_faults
    assert wire.whole.total() < wire.sent
    # A reset cuts a frame short now and then; a damaged frame passes its 8-bit check once in 256 times.
    assert (wire.whole - received).total() <= 3
    assert (received - wire.whole).total() <= 3
    pings = Counter(record.channel.value for record in records if isinstance(record, Ping))
    for channel, sonar in state["sonars"].items():
        assert abs(pings[channel] - sonar["pings"]) <= 1, "all but the one that was under way"
    lines = [
        json.loads(line)
        for path in (services.folder / "state" / "recordings").glob("session_*/*.jsonl")
        for line in path.read_text().splitlines()
    ]
    sensor_lines = [line for line in lines if line.get("type") not in ("navigation", "position_fix")]
    assert Counter(line["ts"] for line in sensor_lines) == received


def memory_mb(services):
    """What each process alone holds, MB."""
    return {name: psutil.Process(p.pid).memory_full_info().uss / 1e6 for name, p in services.processes.items()}
