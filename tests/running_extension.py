"""The real extension on free ports, with the real virtual ESP32 behind a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import aiohttp

from bluerov_slam.services.extension import Extension
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.simulator import Simulator
from bluerov_slam.simulation.faults import parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.sources.serial_port import SerialPort
from firmware_build import board_in_the_loop
from free_ports import free_port
from patience import PATIENCE_S

ORIGIN = {"Origin": "http://127.0.0.1"}


def open_store(state: Path, **settings: object) -> SettingsStore:
    """Settings for a test: free ports, loopback, little disk; `settings` as group__key=value."""
    flags: dict[str, object] = {
        "paths.state": str(state),
        "recording.min_free_mb": 10,
        "http.host": "127.0.0.1",
        "http.port": 0,
        "http.sensor_ws_port": 0,
        "viewer.port": 0,
        "viewer.waterfall_ws_port": 0,
        "viewer.udp_port_a": free_port(),
        "viewer.udp_port_b": free_port(),
    }
    given = {key.replace("__", ".", 1): value for key, value in settings.items()}
    return SettingsStore.open(None, flags | given, {})


@dataclass(slots=True)
class Running:
    """A running extension and a client for it."""

    extension: Extension
    client: aiohttp.ClientSession

    async def get(self, path: str) -> Any:
        """The JSON answer of a GET that must succeed."""
        async with self.client.get(path) as response:
            body = await response.read()
            assert response.status == 200, (path, response.status, body)
            return json.loads(body)

    async def call(self, method: str, path: str, **options: Any) -> tuple[int, Any]:
        """Status and JSON answer of any call, made as a page of the vehicle makes it."""
        options.setdefault("headers", ORIGIN)
        async with self.client.request(method, path, **options) as response:
            return response.status, json.loads(await response.read())

    async def configure_esp32(self, **values: Any) -> tuple[int, Any]:
        """POST /api/esp32; again, as the user would, while its acknowledgement comes too late on a busy machine."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                status, answer = await self.call("POST", "/api/esp32", json=values)
                if not str(answer.get("error")).startswith("timeout: "):
                    return status, answer

    async def until(self, path: str, condition: Callable[[Any], bool]) -> Any:
        """Ask again until the answer satisfies the condition."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition(answer := await self.get(path)):
                await asyncio.sleep(0.02)
            return answer

    def events(self) -> list[str]:
        """The texts of the events so far."""
        return [event["text"] for event in self.extension.events.listing()]


@contextlib.asynccontextmanager
async def running_extension(state: Path, *, port: SerialPort | None = None, **options: Any) -> AsyncIterator[Running]:
    """Start, hand out, stop. `options`: settings as group__key, and arguments of the extension."""
    extra = {key: options.pop(key) for key in ("wall_time", "simulated", "navigator") if key in options}
    extension = Extension(open_store(state, **options), port, **extra)
    await extension.start()
    async with aiohttp.ClientSession(f"http://127.0.0.1:{extension.http.port}") as client:
        try:
            yield Running(extension, client)
        finally:
            await client.close()
            await extension.stop()


@contextlib.asynccontextmanager
async def running_simulator(
    device_folder: Path, *faults: str, baud: int = 115_200, scenario: str = "survey", **changes: Any
) -> AsyncIterator[Simulator]:
    """A virtual ESP32 whose port appears in a folder that plays /dev."""
    scripted = tuple(parse_fault(fault) for fault in faults)
    chosen = replace(SCENARIOS[scenario], **changes, faults=scripted)
    board = VirtualEsp32(chosen, baud, board=board_in_the_loop(chosen))
    simulator = Simulator(board, device_folder=device_folder)
    task = asyncio.create_task(simulator.run())
    async with asyncio.timeout(PATIENCE_S):
        await simulator.ready.wait()
    try:
        yield simulator
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def serial_port(device_folder: Path, baud: int = 115_200, **options: Any) -> SerialPort:
    """A port that is looked for in that folder."""
    return SerialPort("auto", baud, device_folder=device_folder, **options)
