"""The serial line as a clock: bytes leave one after another, ten bit times each."""

from __future__ import annotations

import math
from collections import deque

BITS_PER_BYTE = 10  # 8N1
_TIME_SLACK_S = 1.0e-9


class PacedWire:
    """Blocks of bytes put on a line; `take` gives those whose last stop bit has passed.

    `clock_rate`: seconds of the sender's crystal in a true second, since its UART runs on it.
    """

    def __init__(self, baud: int, clock_rate: float = 1.0) -> None:
        self.baud = baud
        self._clock_rate = clock_rate
        self._free_at_s = 0.0
        self._blocks: deque[tuple[float, float, bytes]] = deque()

    @property
    def bytes_per_s(self) -> float:
        """What the line carries when it never rests."""
        return self.baud * self._clock_rate / BITS_PER_BYTE

    def put(self, data: bytes, now_s: float) -> None:
        """Start sending at once, or behind what is still on its way."""
        start_s = max(now_s, self._free_at_s)
        byte_s = 1.0 / self.bytes_per_s
        self._blocks.append((start_s, byte_s, data))
        self._free_at_s = start_s + len(data) * byte_s

    def cut(self, now_s: float) -> None:
        """The sender stops in the middle of a byte: what is not out by now never comes."""
        kept = self.take(now_s)
        self._blocks.clear()
        if kept:
            self._blocks.append((now_s, 0.0, kept))
        self._free_at_s = now_s

    def take(self, until_s: float) -> bytes:
        """Every byte that is on the other side by this instant and was not taken yet."""
        taken: list[bytes] = []
        while self._blocks:
            start_s, byte_s, data = self._blocks[0]
            passed = len(data) if byte_s == 0.0 else math.floor((until_s - start_s + _TIME_SLACK_S) / byte_s)
            if passed < len(data):
                if passed > 0:
                    taken.append(data[:passed])
                    self._blocks[0] = (start_s + passed * byte_s, byte_s, data[passed:])
                break
            taken.append(data)
            self._blocks.popleft()
        return b"".join(taken)
