"""The real extension and the real viewer on a virtual ESP32 behind a pseudo-terminal."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from bluerov_slam.protocol.kogger import KoggerFrame, KoggerFrameDecoder, KoggerId
from bluerov_slam.protocol.waterfall_frame import unpack_ping
from bluerov_slam.records import Channel, Ping
from bluerov_slam.services.extension import Extension
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.simulator import Simulator
from bluerov_slam.services.viewer import ViewerService
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from firmware_build import board_in_the_loop
from free_ports import free_port
from patience import PATIENCE_S

ORIGIN = {"Origin": "http://127.0.0.1"}
VECTORS = Path(__file__).parents[1] / "vectors" / "kogger_vectors.json"
COMMANDS = {
    entry["what"]: bytes.fromhex(entry["hex"]) for entry in json.loads(VECTORS.read_text())["commands"]["frames"]
}
ASK_AGAIN_S = 5.0
FED_TOPSIDE = "127.0.0.3"
OTHER_TOPSIDE = "127.0.0.2"


def parse(data: bytes) -> list[KoggerFrame]:
    return KoggerFrameDecoder("mod256").feed(data)


class Vehicle:
    """Simulator, extension and viewer of one test."""

    def __init__(self, folder: Path, scenario: Scenario, baud: int = 115_200) -> None:
        self._flags: dict[str, Any] = {
            "http.host": "127.0.0.1",
            "http.port": free_port(),  # it is opened anew after a restart
            "http.sensor_ws_port": 0,
            "serial.port": str(folder / "esp32"),
            "serial.baud": baud,
            "viewer.port": 0,
            "viewer.waterfall_ws_port": 0,
            "viewer.udp_port_a": free_port(),
            "viewer.udp_port_b": free_port(),
            "forwarding.targets": ["127.0.0.1", FED_TOPSIDE],
            "paths.state": str(folder / "state"),
            "recording.min_free_mb": 10,
        }
        self.store = SettingsStore.open(None, self._flags, {})
        self.simulator = Simulator(
            VirtualEsp32(scenario, baud, board=board_in_the_loop(scenario)), link=folder / "esp32"
        )
        self.extension = Extension(self.store, simulated=True)
        self.viewer: ViewerService | None = None
        self._simulation: asyncio.Task[None] | None = None

    async def start(self) -> None:
        self._simulation = asyncio.create_task(self.simulator.run())
        await self.simulator.ready.wait()
        await self.extension.start()
        self.viewer = ViewerService(self.store.settings, extension_port=self.extension.http.port)
        await self.viewer.start()

    async def stop(self) -> None:
        await self.viewer.stop()
        await self.extension.stop()
        self._simulation.cancel()
        await asyncio.gather(self._simulation, return_exceptions=True)

    def url(self, path: str) -> str:
        return f"http://127.0.0.1:{self.viewer.http.port}{path}"

    async def restart_extension(self) -> None:
        """The same port, as in real life."""
        self.extension = Extension(SettingsStore.open(None, self._flags, {}), simulated=True)
        await self.extension.start()


class KoggerApp:
    """Polls one sonar's port like KoggerApp and keeps what comes back."""

    def __init__(self, host: str, port: int, vehicle_port: int) -> None:
        self.frames: asyncio.Queue[KoggerFrame] = asyncio.Queue()
        self._target = ("127.0.0.1", vehicle_port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((host, port))
        asyncio.get_running_loop().add_reader(self._socket, self._read)

    async def ask(self, what: str, route: int, frame_id: int, response: bool = False) -> tuple[bytes, KoggerFrame]:
        """Send a frame, again and again as KoggerApp does, until this comes back; both frames."""
        frame = parse(COMMANDS[what])[0].to_bytes(route)
        async with asyncio.timeout(PATIENCE_S):
            while True:
                self._socket.sendto(frame, self._target)
                with contextlib.suppress(TimeoutError):
                    return frame, await asyncio.wait_for(self.wait_for(frame_id, response), ASK_AGAIN_S)

    async def wait_for(self, frame_id: int, response: bool = False) -> KoggerFrame:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                frame = await self.frames.get()
                if frame.frame_id == frame_id and frame.response == response:
                    return frame

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        for frame in parse(self._socket.recv(4096)):
            self.frames.put_nowait(frame)


@pytest.fixture
async def vehicle(tmp_path: Path) -> AsyncIterator[Vehicle]:
    vehicle = Vehicle(tmp_path, Scenario(samples=500, mission_start_s=60.0))
    await vehicle.start()
    yield vehicle
    await vehicle.stop()


@pytest.fixture
async def http() -> AsyncIterator[aiohttp.ClientSession]:
    async with aiohttp.ClientSession() as session:
        yield session


async def pings(stream: aiohttp.ClientWebSocketResponse) -> AsyncIterator[Ping]:
    async with asyncio.timeout(PATIENCE_S):
        async for message in stream:
            if message.type is aiohttp.WSMsgType.BINARY:
                yield unpack_ping(message.data).ping


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.02)


async def until_read(vehicle: Vehicle) -> None:
    state = vehicle.viewer.forwarder.state
    await until(lambda: all(state()[name]["last_result"] == "settings read" for name in "AB"))


async def test_link_up_reads_both_sonars_and_pings_flow(vehicle, http) -> None:
    async with http.ws_connect(vehicle.url("/ws")) as stream:
        seen: set[Channel] = set()
        async for ping in pings(stream):
            seen.add(ping.channel)
            if len(seen) == 2 and ping.samples.size == 500:
                break
    await until_read(vehicle)
    await until(lambda: vehicle.viewer.forwarder.state()["sound_speed_ctd_mps"] is not None)
    async with http.get(vehicle.url("/api/sonar")) as answer:
        sonar = await answer.json()
    assert sonar["B"]["read"]["samples"] == 500
    assert sonar["A"]["read"]["period_ms"] == 100
    assert sonar["A"]["device"]["board"] == "Side-Enhanced"
    assert sonar["A"]["alive"] is True
    assert 1400 < sonar["sound_speed_ctd_mps"] < 1600


async def test_a_range_change_ends_with_the_read_back_and_pings_of_the_new_size(vehicle, http) -> None:
    await until_read(vehicle)
    async with http.ws_connect(vehicle.url("/ws")) as stream:
        await stream.send_json({"subscribe": ["A"]})
        async with http.post(vehicle.url("/api/sonar/A"), json={"range_m": 16.0}, headers=ORIGIN) as answer:
            assert answer.status == 200, await answer.text()
            outcome = (await answer.json())["A"]
        assert (outcome["ok"], outcome["read"]["samples"], outcome["read"]["range_m"]) == (True, 800, 16.0)
        whole = 0
        async for ping in pings(stream):
            whole += ping.samples.size == 800 and not ping.gaps
            if whole == 3:
                break


async def test_a_period_too_short_is_refused_and_the_sonar_keeps_its_settings(vehicle, http) -> None:
    await until_read(vehicle)
    async with http.post(vehicle.url("/api/sonar/both"), json={"range_m": 100.0}, headers=ORIGIN) as answer:
        assert answer.status == 409
        assert "two-way time" in (await answer.json())["error"]
    async with http.get(vehicle.url("/api/sonar")) as answer:
        assert (await answer.json())["A"]["read"]["range_m"] == 10.0


async def test_a_poller_nobody_feeds_gets_answers_and_whole_frames_with_the_public_address(vehicle) -> None:
    await until_read(vehicle)
    app = KoggerApp(OTHER_TOPSIDE, 0, vehicle.store.settings.viewer.udp_port_b)
    _, version = await app.ask("version get v0 v1 v2", 2, KoggerId.VERSION)
    chart = await app.wait_for(KoggerId.CHART)
    assert (version.route, chart.route) == (2, 2)
    mark, result = await app.ask("mark set", 2, KoggerId.MARK, response=True)
    assert result.payload == b"\x01" + mark[-2:]
    app.close()


async def test_a_fed_poller_gets_every_chart_exactly_once(vehicle) -> None:
    await until_read(vehicle)
    port = vehicle.store.settings.viewer.udp_port_a
    app = KoggerApp(FED_TOPSIDE, port, port)
    await app.ask("mark set", 1, KoggerId.MARK, response=True)
    starts = []
    while len(starts) < 30:
        frame = await app.wait_for(KoggerId.CHART)
        starts.append(int.from_bytes(frame.payload[:2], "little"))
    first = starts.index(0)
    assert starts[first : first + 24] == [0, 200, 400] * 8
    app.close()


async def test_settings_from_the_network_need_the_switch(vehicle, http) -> None:
    await until_read(vehicle)
    app = KoggerApp(OTHER_TOPSIDE, 0, vehicle.store.settings.viewer.udp_port_a)
    _, refusal = await app.ask("dsp set smooth 1", 1, KoggerId.DSP, response=True)
    assert refusal.payload[0] != 1
    _, refusal = await app.ask("flash save v0", 1, KoggerId.FLASH, response=True)
    assert refusal.payload[0] != 1
    assert vehicle.viewer.channels[Channel.A].gateway.counters.settings_relayed == 0
    await vehicle.extension.change_settings(
        lambda: vehicle.store.change({"sonar.kogger_app_may_change_settings": True})
    )
    await until(lambda: vehicle.viewer.channels[Channel.A].gateway.settings_allowed)
    command, result = await app.ask("chart_setup set 1000x20mm off0", 1, KoggerId.CHART_SETUP, response=True)
    assert (result.route, result.payload) == (1, b"\x01" + command[-2:])
    await until(lambda: vehicle.viewer.forwarder.state()["A"]["read"]["samples"] == 1000)
    app.close()


async def test_a_sonar_reset_by_the_page_is_marked_and_read_again(vehicle, http) -> None:
    await until_read(vehicle)
    session = vehicle.viewer.channels[Channel.A].session
    await until(lambda: session.marked is True)
    async with http.post(
        vehicle.url("/api/sonar/A/action"), json={"action": "reboot", "confirm": True}, headers=ORIGIN
    ) as answer:
        assert answer.status == 200, await answer.text()
    await until(lambda: session.restarts == 1)
    await until(lambda: session.marked is True)
    await until_read(vehicle)


async def test_contacts_reach_the_recording_and_the_viewer_survives_the_extension(vehicle, http) -> None:
    await until(lambda: vehicle.viewer.desk.status()["recording"] is not None)
    contact = {"name": "wreck", "channel": "A", "ping_number": 3, "range_m": 7.5}
    async with http.post(vehicle.url("/api/contacts"), json=contact, headers=ORIGIN) as answer:
        assert (await answer.json())["pending"] is False
    kept = vehicle.extension.recordings.annotations("active")
    assert [annotation["name"] for annotation in kept] == ["wreck"]
    await vehicle.extension.stop()
    async with http.get(vehicle.url("/health")) as answer:
        assert (await answer.json())["status"] == "healthy"
    async with http.post(vehicle.url("/api/contacts"), json={"name": "later"}, headers=ORIGIN) as answer:
        assert (await answer.json())["pending"] is True
    await vehicle.restart_extension()
    await until(lambda: vehicle.viewer.contacts.unsent == 0)
    assert [a["name"] for a in vehicle.extension.recordings.annotations("active")] == ["later"]


async def test_undecimated_pings_at_921600_come_whole(tmp_path, http) -> None:
    vehicle = Vehicle(tmp_path, Scenario(samples=2000, resolution_mm=15, mission_start_s=60.0), baud=921_600)
    await vehicle.start()
    try:
        async with http.ws_connect(vehicle.url("/ws")) as stream:
            whole = dict.fromkeys(Channel, 0)
            async for ping in pings(stream):
                whole[ping.channel] += ping.samples.size == 2000 and not ping.gaps
                if min(whole.values()) >= 3:
                    break
    finally:
        await vehicle.stop()
