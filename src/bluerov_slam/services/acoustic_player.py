"""The virtual acoustic board as a sender of datagrams, in step with the virtual ESP32: both are in the same dive."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable

from bluerov_slam.simulation.acoustic_board import VirtualAcousticBoard

_TICK_S = 0.02


class AcousticPlayer:
    """Sends what the board has said by `now_s()`, virtual time, to `address`: one frame, one datagram."""

    def __init__(
        self,
        board: VirtualAcousticBoard,
        now_s: Callable[[], float],
        address: tuple[str, int],
        on_event: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.board = board
        self.address = address
        self.frames_sent = 0
        self._now_s = now_s
        self._on_event = on_event

    async def run(self) -> None:
        """Send until cancelled."""
        plan = self.board.plan
        self._on_event(
            f"the virtual acoustic board sends to {self.address[0]}:{self.address[1]}: "
            f"chain {plan.chain}, a record every {plan.record_every} pulses"
        )
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.connect(self.address)
            while True:
                for _, frame in self.board.advance(self._now_s()):
                    # Nobody may be listening yet, or any more: a datagram is then lost, as at sea.
                    with contextlib.suppress(OSError):
                        sender.send(frame)
                        self.frames_sent += 1
                await asyncio.sleep(_TICK_S)
