import asyncio
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.protocol.mavlink_map import vehicle_record
from bluerov_slam.records import VehicleAttitude
from bluerov_slam.services.autopilot_player import AutopilotPlayer
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.scene import SimulatedScene
from bluerov_slam.simulation.sensors import errors_for
from bluerov_slam.simulation.virtual_autopilot import VirtualAutopilot
from bluerov_slam.sinks.mavlink_transport import UdpTransport
from patience import PATIENCE_S

SCENARIO = replace(SCENARIOS["survey"], dvl=True, mission_start_s=60.0)


def player(address: tuple[str, int], now_s: list[float]) -> tuple[AutopilotPlayer, SimulatedScene]:
    scene = SimulatedScene(SCENARIO)
    autopilot = VirtualAutopilot(
        scene.truth, errors_for(SCENARIO, scene), SCENARIO.seed, mission_start_s=60.0, dvl=SCENARIO.dvl
    )
    return AutopilotPlayer(autopilot, lambda: now_s[0], address), scene


async def test_the_extensions_way_in_hears_the_vehicle_of_the_simulated_dive() -> None:
    heard: dict[str, tuple[int, int, Mapping[str, Any]]] = {}
    everything = asyncio.Event()
    wanted = {"HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "BATTERY_STATUS", "VISION_POSITION_DELTA"}

    def on_message(system: int, component: int, name: str, fields: Mapping[str, Any]) -> None:
        heard[name] = system, component, fields
        if wanted <= set(heard):
            everything.set()

    now_s = [0.0]
    speaks, scene = player(("127.0.0.1", 0), now_s)
    task = asyncio.create_task(speaks.run())
    async with asyncio.timeout(PATIENCE_S):
        while speaks.address[1] == 0:
            await asyncio.sleep(0)
        transport = UdpTransport(*speaks.address, 1, 197, on_message)
        await transport.start()
        while not everything.is_set():
            transport.send("HEARTBEAT", heartbeat())
            now_s[0] += 0.2
            await asyncio.sleep(0.01)
        await transport.stop()
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    assert heard["ATTITUDE"][:2] == (1, 1)
    assert heard["VISION_POSITION_DELTA"][:2] == (255, 0)
    attitude = vehicle_record("ATTITUDE", heard["ATTITUDE"][2], 0.0)
    assert isinstance(attitude, VehicleAttitude)
    at_s = attitude.boot_ms / 1000.0 - 95.0
    assert attitude.roll_rad == pytest.approx(scene.state(60.0 + at_s).roll_rad, abs=0.03)


async def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        speaks, _ = player(("127.0.0.1", taken.getsockname()[1]), [0.0])
        with pytest.raises(LinkError, match=str(taken.getsockname()[1])):
            await speaks.run()


def heartbeat() -> dict[str, int]:
    fields = ("type", "autopilot", "base_mode", "custom_mode", "system_status", "mavlink_version")
    return dict.fromkeys(fields, 0) | {"type": 18, "autopilot": 8, "mavlink_version": 3}
