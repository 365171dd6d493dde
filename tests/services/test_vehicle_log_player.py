import asyncio
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.services.vehicle_log_player import VehicleLogPlayer
from bluerov_slam.sinks.mavlink_transport import UdpTransport
from bluerov_slam.sources.vehicle_log import LoggedFrame, read_vehicle_log
from patience import PATIENCE_S
from real_data import recording

FRAMES = [LoggedFrame(100.0 + 0.01 * number, bytes((0xFD, number))) for number in range(5)]


async def test_plays_in_order_to_whoever_spoke_and_starts_again() -> None:
    said: list[str] = []
    player = VehicleLogPlayer(FRAMES, ("127.0.0.1", 0), on_event=said.append)
    task = asyncio.create_task(player.run())
    async with asyncio.timeout(PATIENCE_S):
        while player.address[1] == 0:
            await asyncio.sleep(0)
        loop = asyncio.get_running_loop()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.setblocking(False)
            client.connect(player.address)
            await loop.sock_sendall(client, b"hello")
            heard = [await loop.sock_recv(client, 100) for _ in range(7)]
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    assert [data[1] for data in heard] == [0, 1, 2, 3, 4, 0, 1]
    assert any("starts again" in text for text in said)


async def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=str(port)):
            await VehicleLogPlayer(FRAMES, ("127.0.0.1", port)).run()


@pytest.mark.data
async def test_a_real_log_feeds_the_receiving_side_of_the_bridge() -> None:
    path = recording("bluerov2_ardusub_logs", "surface_ugps_2023-05-04.tlog")
    heard: set[str] = set()
    everything = asyncio.Event()
    wanted = {"HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "BATTERY_STATUS"}

    def on_message(_system: int, _component: int, name: str, _fields: Mapping[str, Any]) -> None:
        heard.add(name)
        if wanted <= heard:
            everything.set()

    player = VehicleLogPlayer(read_vehicle_log(path), ("127.0.0.1", 0), speed=50.0)
    task = asyncio.create_task(player.run())
    async with asyncio.timeout(PATIENCE_S):
        while player.address[1] == 0:
            await asyncio.sleep(0)
        bridge = UdpTransport(*player.address, system_id=1, component_id=197, on_message=on_message)
        await bridge.start()
        heartbeat = {
            "type": 18,
            "autopilot": 8,
            "base_mode": 0,
            "custom_mode": 0,
            "system_status": 4,
            "mavlink_version": 3,
        }
        while not bridge.send("HEARTBEAT", heartbeat):
            await asyncio.sleep(0)
        await everything.wait()
    await bridge.stop()
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    assert bridge.bad_frames == 0
