"""Extension and viewer as processes of their own, on free ports, with the virtual ESP32 of the test on a real pty."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiohttp

from bluerov_slam.protocol.waterfall_frame import unpack_ping
from bluerov_slam.records import Channel, Ping, Record, SensorSample
from bluerov_slam.services.simulator import BY_ID_NAME, Simulator
from bluerov_slam.simulation.faults import parse_fault
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import decode
from free_ports import free_ports
from patience import PATIENCE_S

ORIGIN = {"Origin": "http://127.0.0.1"}


@dataclass(frozen=True, slots=True)
class Window:
    """Virtual time in which a fault was at work, ms as in `ts`."""

    start_ms: float
    end_ms: float

    def holds(self, ts: float, slack_ms: float) -> bool:
        """Whether a frame sent at `ts` may have met the fault."""
        return self.start_ms - slack_ms <= ts <= self.end_ms + slack_ms


class RunningServices:
    """The two processes. `serial_port` is what the extension opens; `settings` are dotted keys."""

    def __init__(self, folder: Path, serial_port: str, settings: Mapping[str, str] | None = None) -> None:
        self.folder = folder
        self.serial_port = serial_port
        self.ports = free_ports()
        values = {
            "http.host": "127.0.0.1",
            "http.port": self.ports["http"],
            "http.sensor_ws_port": self.ports["sensor_ws"],
            "viewer.port": self.ports["viewer"],
            "viewer.waterfall_ws_port": self.ports["waterfall_ws"],
            "viewer.udp_port_a": self.ports["udp_a"],
            "viewer.udp_port_b": self.ports["udp_b"],
            "serial.port": serial_port,
            "paths.state": folder / "state",
            "recording.min_free_mb": 10,
            **(settings or {}),
        }
        flags = [word for key, value in values.items() for word in ("--set", f"{key}={value}")]
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        for name in ("extension", "viewer"):
            with (folder / f"{name}.log").open("ab") as log:
                command = [sys.executable, "-m", "bluerov_slam", name, *flags]
                self.processes[name] = subprocess.Popen(command, stdout=log, stderr=log)
        self.client = aiohttp.ClientSession()

    def url(self, path: str, service: str = "http") -> str:
        """The address of a path of the extension ("http") or of the viewer ("viewer")."""
        return f"http://127.0.0.1:{self.ports[service]}{path}"

    async def get(self, path: str, service: str = "http") -> Any:
        """The JSON answer of a GET that must succeed."""
        async with self.client.get(self.url(path, service)) as response:
            body = await response.read()
            assert response.status == 200, (path, response.status, body)
            return json.loads(body)

    async def call(self, method: str, path: str, service: str = "http", **options: Any) -> tuple[int, Any]:
        """Status and JSON answer of any call, made as a page of the vehicle makes it."""
        options.setdefault("headers", ORIGIN)
        async with self.client.request(method, self.url(path, service), **options) as response:
            return response.status, json.loads(await response.read())

    async def configure_esp32(self, **values: Any) -> tuple[int, Any]:
        """POST /api/esp32; again, as the user would, while its acknowledgement comes too late on a busy machine."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                status, answer = await self.call("POST", "/api/esp32", json=values)
                if not str(answer.get("error")).startswith("timeout: "):
                    return status, answer

    async def until(self, path: str, condition: Callable[[Any], bool], service: str = "http") -> Any:
        """Ask again until the answer satisfies the condition."""
        answer = None
        try:
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    with contextlib.suppress(aiohttp.ClientConnectionError):
                        answer = await self.get(path, service)
                        if condition(answer):
                            return answer
                    self.assert_alive()
                    await asyncio.sleep(0.05)
        except TimeoutError as error:
            raise AssertionError(f"{path} did not come to it; last: {json.dumps(answer)[:6000]}") from error

    async def until_up(self) -> None:
        """Return once both services answer and the serial port is open."""
        await self.until("/health", lambda health: health["serial"])
        await self.until("/health", lambda health: health["status"] == "healthy", "viewer")

    def assert_alive(self) -> None:
        """Neither process has ended."""
        for name, process in self.processes.items():
            assert process.poll() is None, f"{name} ended with {process.returncode}:\n{self.log(name)}"

    def log(self, name: str) -> str:
        """Everything a service has logged."""
        return (self.folder / f"{name}.log").read_text(errors="replace")

    def complaints(self) -> list[str]:
        """Log lines that tell of a fault of ours; what the user is told of the hardware is none."""
        lines = [line for name in self.processes for line in self.log(name).splitlines()]
        bad = [line for line in lines if line.startswith(("ERROR", "CRITICAL", "Traceback", "Fatal"))]
        return [line for line in bad if " bluerov_slam.services.event_log: " not in line]

    async def terminate(self) -> None:
        """End both as BlueOS does; both must end in order."""
        for process in self.processes.values():
            process.send_signal(signal.SIGTERM)
        for name, process in self.processes.items():
            assert await asyncio.to_thread(process.wait, PATIENCE_S) == 0, self.log(name)

    async def kill(self) -> None:
        """Nothing outlives the test."""
        await self.client.close()
        for process in self.processes.values():
            process.kill()
            await asyncio.to_thread(process.wait)

    def records(self) -> list[Record]:
        """The only recorded dive, decoded afresh from its raw bytes."""
        (session,) = (self.folder / "state" / "recordings").glob("session_*")
        recording = open_recording(session)
        records = list(decode(recording))
        assert recording.problems == []
        return records


class Dive:
    """Services, simulator and two listeners: everything a user would have on the screen is kept."""

    def __init__(self, services: RunningServices, simulator: Simulator, samples: int) -> None:
        self.services = services
        self.simulator = simulator
        self.samples = samples
        self.sensors: list[dict[str, Any]] = []
        self.pings: list[Ping] = []
        self._ping_times_unix_s: list[float] = []
        self._listeners: list[asyncio.Task[None]] = []

    @property
    def ts(self) -> list[int]:
        """`ts` of every sensor message so far."""
        return [message["data"]["ts"] for message in self.sensors]

    @property
    def now_ms(self) -> float:
        """The board's virtual time."""
        return self.simulator.board.now_s * 1000.0

    async def listen(self, pings: bool) -> None:
        """Connect both listeners; returns once sensors and, if there are to be any, both sonars have come."""
        self._listeners = [asyncio.create_task(self._take_sensors()), asyncio.create_task(self._take_pings())]
        sonars = set(Channel) if pings else set()
        await self.until(lambda: self.sensors and {ping.channel for ping in self.pings} == sonars, "first data")

    async def until(self, condition: Callable[[], Any], what: str) -> None:
        """Wait until something holds of what was received."""
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not condition():
                    for listener in self._listeners:
                        assert not listener.done(), f"a listener ended while waiting for {what}: {listener}"
                    self.services.assert_alive()
                    await asyncio.sleep(0.02)
        except TimeoutError as error:
            raise AssertionError(f"no {what} within {PATIENCE_S} s; ts {self.ts[-5:]}") from error

    def inject(self, fault: str, duration_s: float) -> Window:
        """Start a fault now."""
        start_s = self.simulator.board.now_s
        self.simulator.inject(parse_fault(f"{fault} at={start_s} duration={duration_s}"))
        return Window(start_s * 1000.0, (start_s + duration_s) * 1000.0)

    def replug(self) -> None:
        """End an `unplug` that was to last until it had been seen."""
        self.simulator.board.replug()

    def let_speak(self, *sensors: str) -> None:
        """End a `silent` that was to last until it had been seen."""
        for sensor in sensors:
            self.simulator.board.let_speak(sensor)

    async def past(self, window: Window, margin_ms: float = 500.0) -> None:
        """Wait until sensor frames from after the window have come."""
        end_ms = window.end_ms + margin_ms
        await self.until(lambda: self.now_ms > end_ms and self.ts[-1] >= end_ms, f"sensor frame after {end_ms} ms")

    async def whole_pings(self, count: int = 5) -> None:
        """Whatever is measured from now on is nothing but whole pings, at least so many of each sonar.

        Pings come by way of the viewer and may be behind the sensors: when they were measured counts.
        """
        since_s = self.sensors[-1]["extra"]["measured_unix_s"]

        def new() -> list[Ping]:
            times = zip(self._ping_times_unix_s, self.pings, strict=True)
            return [ping for measured_unix_s, ping in times if measured_unix_s > since_s]

        def enough() -> bool:
            found = Counter(ping.channel for ping in new())
            return all(found[channel] >= count for channel in Channel)

        await self.until(enough, f"{count} pings of each sonar")
        assert [shape(ping) for ping in new() if not self.is_whole(ping)] == []

    def is_whole(self, ping: Ping) -> bool:
        """All samples, no gap."""
        return ping.samples.size == self.samples and not ping.gaps

    async def state(self, condition: Callable[[Any], bool] = lambda _: True) -> Any:
        """GET /api/state, once the condition holds."""
        return await self.services.until("/api/state", condition)

    async def chip(self, chip_id: str, *states: str) -> Any:
        """The chip, once it has one of these states."""
        state = await self.state(lambda s: chips(s)[chip_id]["state"] in states)
        return chips(state)[chip_id]

    async def fault(self, fault_id: str) -> Any:
        """The fault, once it is shown."""
        state = await self.state(lambda s: fault_id in faults(s))
        return faults(state)[fault_id]

    async def assert_healthy(self) -> None:
        """Both services say so."""
        self.services.assert_alive()
        for service in ("http", "viewer"):
            assert (await self.services.get("/health", service))["status"] == "healthy"

    async def finish(self) -> list[Record]:
        """End everything in order; the recording, decoded, must hold every sensor frame that was shown."""
        await self.assert_healthy()
        await self.hang_up()
        await self.services.terminate()
        assert not self.services.complaints(), "\n".join(map(self.services.log, self.services.processes))
        records = self.services.records()
        recorded = [record.device_ms for record in records if isinstance(record, SensorSample)]
        first = recorded.index(self.ts[0])
        assert recorded[first : first + len(self.ts)] == self.ts
        return records

    async def hang_up(self) -> None:
        """End the listeners."""
        for listener in self._listeners:
            listener.cancel()
        await asyncio.gather(*self._listeners, return_exceptions=True)
        self._listeners.clear()

    async def _take_sensors(self) -> None:
        async with self.services.client.ws_connect(self.services.url("/ws")) as stream:
            await stream.send_json({"subscribe": ["sensors"]})
            async for message in stream:
                document = json.loads(message.data)
                if document["topic"] == "sensors":
                    self.sensors.append(document)

    async def _take_pings(self) -> None:
        async with self.services.client.ws_connect(self.services.url("/ws", "viewer"), max_msg_size=0) as stream:
            await stream.send_json({"subscribe": ["A", "B"]})
            async for message in stream:
                if message.type is aiohttp.WSMsgType.BINARY:
                    found = unpack_ping(message.data)
                    assert found.time_unix_s is not None
                    self.pings.append(found.ping)
                    self._ping_times_unix_s.append(found.time_unix_s)


def chips(state: Mapping[str, Any]) -> dict[str, Any]:
    """Chips by id."""
    return {chip["id"]: chip for chip in state["chips"]}


def faults(state: Mapping[str, Any]) -> dict[str, Any]:
    """Faults by id."""
    return {fault["id"]: fault for fault in state["faults"]}


def shape(ping: Ping) -> tuple[str, int, tuple[tuple[int, int], ...]]:
    """What is wrong with a ping, for messages."""
    return ping.channel.value, ping.samples.size, tuple(ping.gaps)


def missing_ts(ts: Iterable[int], period_ms: float) -> list[float]:
    """Times at which a frame is due, counted from each one received, and none came."""
    times = list(ts)
    missing: list[float] = []
    for before, after in itertools.pairwise(times):
        absent = round((after - before) / period_ms) - 1
        missing += [before + (number + 1) * period_ms for number in range(absent)]
    return missing


@contextlib.asynccontextmanager
async def diving(folder: Path, board: VirtualEsp32, *, pings: bool = True, **settings: str) -> AsyncIterator[Dive]:
    """A dive under way: the board runs, both services are up, both listeners have data. `settings` as group__key."""
    device_folder = folder / "dev"
    simulator = Simulator(board, device_folder=device_folder)
    simulation = asyncio.create_task(simulator.run())
    await asyncio.wait_for(simulator.ready.wait(), PATIENCE_S)
    dotted = {key.replace("__", ".", 1): value for key, value in settings.items()}
    by_id = device_folder / "serial" / "by-id" / BY_ID_NAME
    services = RunningServices(folder, str(by_id), {"serial.baud": str(board.baud), **dotted})
    dive = Dive(services, simulator, board.scenario.samples)
    try:
        await services.until_up()
        await dive.listen(pings)
        yield dive
    finally:
        await dive.hang_up()
        await services.kill()
        simulation.cancel()
        await asyncio.gather(simulation, return_exceptions=True)
