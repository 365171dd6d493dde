"""Plays a vehicle's telemetry log over UDP, standing where the vehicle's MAVLink router has its endpoint."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence

from bluerov_slam.services.mavlink_server import MavlinkServer
from bluerov_slam.sources.vehicle_log import LoggedFrame

LONGEST_GAP_S = 2.0
_LOOK_FOR_PEER_S = 0.1


class VehicleLogPlayer:
    """One log in a loop, at its own pace (times `speed`); pauses in the log are cut to `LONGEST_GAP_S`."""

    def __init__(
        self,
        frames: Sequence[LoggedFrame],
        address: tuple[str, int],
        speed: float = 1.0,
        on_event: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._server = MavlinkServer(address, "the vehicle log", on_event)
        self._frames = frames
        self._speed = speed
        self._on_event = on_event

    @property
    def address(self) -> tuple[str, int]:
        """Where it plays."""
        return self._server.address

    async def run(self) -> None:
        """Play until cancelled."""
        await self._server.open()
        self._on_event(f"plays {len(self._frames)} MAVLink frames to whoever speaks to {self.address}")
        try:
            while True:
                await self._play_once()
                self._on_event("the vehicle log has ended and starts again")
        finally:
            self._server.close()

    async def _play_once(self) -> None:
        due_s = time.monotonic()
        before_s = self._frames[0].time_unix_s
        for frame in self._frames:
            gap_s = min(max(frame.time_unix_s - before_s, 0.0), LONGEST_GAP_S)
            before_s = frame.time_unix_s
            due_s += gap_s / self._speed
            while not self._server.listeners():
                await asyncio.sleep(_LOOK_FOR_PEER_S)
                due_s = time.monotonic()
            wait_s = due_s - time.monotonic()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            self._server.send(frame.data)
        await asyncio.sleep(_LOOK_FOR_PEER_S)
