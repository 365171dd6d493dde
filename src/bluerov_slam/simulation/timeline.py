"""Virtual time: actions at instants, in order, ties in the order they were asked for."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable

Action = Callable[[], None]


class Timeline:
    """A clock that only moves when an action is due or its owner says so."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._actions: list[tuple[float, int, Action]] = []
        self._order = itertools.count()

    @property
    def next_s(self) -> float:
        """When the next action is due; infinity when none is."""
        return self._actions[0][0] if self._actions else math.inf

    def at(self, at_s: float, action: Action) -> None:
        """Do this then; at once if that is past."""
        heapq.heappush(self._actions, (max(at_s, self.now_s), next(self._order), action))

    def run_next(self) -> None:
        """Go to the next action and do it."""
        self.now_s, _, action = heapq.heappop(self._actions)
        action()
