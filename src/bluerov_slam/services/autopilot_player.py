"""The virtual autopilot on its UDP endpoint, in step with the virtual board: both fly in the same dive."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from bluerov_slam.services.mavlink_server import MavlinkServer
from bluerov_slam.simulation.virtual_autopilot import VirtualAutopilot

_TICK_S = 0.02


class AutopilotPlayer:
    """Sends what the autopilot has said by `now_s()`, virtual time, to whoever speaks to `address`."""

    def __init__(
        self,
        autopilot: VirtualAutopilot,
        now_s: Callable[[], float],
        address: tuple[str, int],
        on_event: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._autopilot = autopilot
        self._now_s = now_s
        self._server = MavlinkServer(address, "the virtual autopilot", on_event)
        self._on_event = on_event

    @property
    def address(self) -> tuple[str, int]:
        """Where it speaks."""
        return self._server.address

    async def run(self) -> None:
        """Speak until cancelled."""
        await self._server.open()
        self._on_event(f"the virtual autopilot speaks to whoever speaks to {self.address}")
        try:
            while True:
                for _, data in self._autopilot.advance(self._now_s()):
                    self._server.send(data)
                await asyncio.sleep(_TICK_S)
        finally:
            self._server.close()
