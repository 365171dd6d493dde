"""ODOMETRY through MAVProxy, which relays it to the autopilot as a ground station's router does, and logs it.

Needs MAVProxy in an environment of its own (it is large): `BLUEROV_SLAM_MAVPROXY` names its mavproxy.py.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from pathlib import Path

import pytest
from pymavlink import mavutil

from fake_autopilot import fly
from free_ports import free_port
from patience import PATIENCE_S
from vehicle_rig import HEARTBEAT, ON, Rig, state

MAVPROXY = os.environ.get("BLUEROV_SLAM_MAVPROXY")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(MAVPROXY is None, reason="BLUEROV_SLAM_MAVPROXY names no mavproxy.py"),
]


@contextlib.asynccontextmanager
async def mavproxy(folder: Path, autopilot_port: int, port: int):
    """MAVProxy between the autopilot and whoever speaks to `port`."""
    assert MAVPROXY is not None
    python = Path(MAVPROXY).parent / "python"
    process = await asyncio.create_subprocess_exec(
        str(python), MAVPROXY, f"--master=udpout:127.0.0.1:{autopilot_port}", f"--out=udpin:127.0.0.1:{port}",
        "--non-interactive", f"--state-basedir={folder}", "--aircraft=relay",
        cwd=folder, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.returncode is None:
            process.terminate()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(10.0):
                await process.wait()
        if process.returncode is None:
            process.kill()
            await process.wait()


async def test_odometry_passes_a_router_unchanged(tmp_path: Path) -> None:
    autopilot, port = await fly(), free_port()
    made = Rig(autopilot, ON, port=port, replay=False, simulated=False)
    async with mavproxy(tmp_path, autopilot.port, port) as process:
        await made.bridge.start()
        try:
            async with asyncio.timeout(3.0 * PATIENCE_S):
                while len(autopilot.odometry) < 20:
                    assert process.returncode is None, "MAVProxy ended"
                    made.clock.now += 0.05
                    made.bridge.send("HEARTBEAT", HEARTBEAT)
                    made.hub.publish(state(made.clock.now))
                    await asyncio.sleep(0.05)
        finally:
            await made.bridge.stop()
            autopilot.transport.close()
    taken = autopilot.odometry[-1]
    assert autopilot.dropped_frames == 0
    assert autopilot.origin == (543219000, 101356000)
    assert taken.position_ned_m == pytest.approx((20.0, -5.0, 3.0), abs=1e-4)
    assert taken.velocity_ned_mps == pytest.approx((0.4, 0.1, 0.05), abs=1e-6)
    assert taken.message.reset_counter == 2
    assert taken.message.get_srcComponent() == 197
    (log,) = tmp_path.rglob("*.tlog")
    reader, names = mavutil.mavlink_connection(str(log)), []
    while (message := reader.recv_match(blocking=False)) is not None:
        names.append((message.get_srcComponent(), message.get_type()))
    assert names.count((1, "HEARTBEAT")) > 5
    assert (1, "GPS_GLOBAL_ORIGIN") in names
