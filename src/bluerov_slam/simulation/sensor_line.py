"""A sensor's UART towards the board: messages go out one behind the other, ten bit times a byte."""

from __future__ import annotations

import heapq
import itertools

from bluerov_slam.simulation.wire import BITS_PER_BYTE

_SLACK_S = 1.0e-9


class SensorLine:
    """Messages that wait for their turn, and the time when each has passed.

    A message that is ready earlier goes first; one that is under way is never interrupted.
    """

    def __init__(self, baud: int) -> None:
        self.baud = baud
        self._free_s = 0.0
        self._waiting: list[tuple[float, int, bytes]] = []
        self._order = itertools.count()

    @property
    def _byte_s(self) -> float:
        return BITS_PER_BYTE / self.baud

    @property
    def next_s(self) -> float:
        """When the next message will have passed; infinity when none waits."""
        if not self._waiting:
            return float("inf")
        ready_s, _, data = self._waiting[0]
        return max(ready_s, self._free_s) + len(data) * self._byte_s

    def send(self, data: bytes, ready_s: float) -> None:
        """A message that may start at this instant."""
        heapq.heappush(self._waiting, (ready_s, next(self._order), data))

    def pop(self) -> bytes:
        """The next message; it has passed at `next_s`."""
        self._free_s = self.next_s
        return heapq.heappop(self._waiting)[2]

    def cut(self, now_s: float) -> bytes:
        """The sensor falls silent: what has passed of the message under way; everything else never comes."""
        came = b""
        if self._waiting:
            ready_s, _, data = self._waiting[0]
            came = data[: self._passed(max(ready_s, self._free_s), now_s)]
        self._waiting.clear()
        self._free_s = max(self._free_s, now_s)
        return came

    def skip(self, now_s: float) -> None:
        """Nobody listened until now: what has passed is lost, the beginning of the message under way too."""
        while self.next_s <= now_s:
            self.pop()
        if self._waiting:
            ready_s, order, data = self._waiting[0]
            start_s = max(ready_s, self._free_s)
            count = self._passed(start_s, now_s)
            if count:
                self._free_s = start_s + count * self._byte_s
                heapq.heapreplace(self._waiting, (ready_s, order, data[count:]))

    def _passed(self, start_s: float, now_s: float) -> int:
        """Bytes that are through of a message that starts then."""
        return max(0, int((now_s - start_s + _SLACK_S) / self._byte_s))
