"""The extension's MAVLink half of navigation and an autopilot at the far end of its datagrams."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from typing import Any

import numpy as np
from pymavlink.quaternion import Quaternion

from bluerov_slam.config import Settings
from bluerov_slam.records import NavMode, NavState
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_vehicle import NavigationVehicle
from bluerov_slam.sinks.mavlink_bridge import MavlinkBridge, MavlinkOptions
from fake_autopilot import FakeAutopilot, fly
from patience import PATIENCE_S

ORIGIN = (54.3219, 10.1356)


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def state(at_s: float, **changes: Any) -> NavState:
    pose = np.diag([1.0, 0.25, 0.01, 1e-4, 1e-4, 1e-3])
    values = NavState(
        measured_s=at_s, arrived_s=at_s, mode=NavMode.DEAD_RECKONING, origin_deg=ORIGIN,
        position_ned_m=(20.0, -5.0, 3.0), velocity_ned_mps=(0.4, 0.1, 0.05),
        quaternion_ned_frd=tuple(float(q) for q in Quaternion([0.1, -0.2, 1.2]).q),
        angular_rate_frd_radps=(0.0, 0.0, 0.1), pose_covariance=pose, velocity_covariance_m2ps2=np.eye(3) * 0.01,
        depth_m=3.0, depth_std_m=0.1, altitude_m=None, current_ne_mps=None, current_std_mps=None, last_fix_s=None,
        distance_m=0.0, reset_counter=2,
    )  # fmt: skip
    return replace(values, **changes)


class Rig:
    """A bridge, a hub and an autopilot that hear each other; time is the test's."""

    def __init__(
        self, autopilot: FakeAutopilot, navigation: dict[str, Any], port: int | None = None, **options: bool
    ) -> None:
        self.clock = Clock()
        self.autopilot = autopilot
        self.hub = Hub()
        port = port or autopilot.port
        self.settings = Settings.model_validate(
            {"navigation": navigation, "mavlink": {"enabled": True, "target_port": port}}
        )
        self.bridge = MavlinkBridge(MavlinkOptions(enabled=True, target_port=port), self.hub.publish, self.clock)
        options = {"replay": False, "simulated": False} | options
        self.vehicle = NavigationVehicle(self.bridge, self.hub, lambda: self.settings, self.clock, **options)

    async def until(self, condition: Any, what: str) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                await asyncio.sleep(0.002)

    async def run(self, seconds: float, rate_hz: float = 20.0, **changes: Any) -> None:
        """States at this rate on the test's clock; datagrams get their time after each."""
        for _ in range(round(seconds * rate_hz)):
            self.clock.now += 1.0 / rate_hz
            self.hub.publish(state(self.clock.now, **changes))
            await self.settle()

    async def settle(self) -> None:
        """Everything said so far has arrived: a message there and one back behind it."""
        seen, heard = self.autopilot.names.count("HEARTBEAT"), self.bridge.counters()["received"].get("HEARTBEAT", 0)
        self.bridge.send("HEARTBEAT", HEARTBEAT)
        await self.until(lambda: self.autopilot.names.count("HEARTBEAT") > seen, "arrival")
        await self.until(lambda: self.bridge.counters()["received"].get("HEARTBEAT", 0) > heard, "answer")

    @property
    def text(self) -> str:
        return self.vehicle.odometry.json()["text"]


HEARTBEAT = {"type": 18, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
ON = {"odometry_enabled": True}


@contextlib.asynccontextmanager
async def rig(navigation: dict[str, Any] | None = None, *, autopilot: dict[str, Any] | None = None, **options: bool):
    far_end = await fly(**(autopilot or {}))
    made = Rig(far_end, navigation or {}, **options)
    await made.bridge.start()
    await made.until(lambda: made.bridge.send("HEARTBEAT", HEARTBEAT), "open socket")
    await made.until(lambda: made.bridge.facts().peer_alive, "heartbeat")
    try:
        yield made
    finally:
        await made.bridge.stop()
        far_end.transport.close()
