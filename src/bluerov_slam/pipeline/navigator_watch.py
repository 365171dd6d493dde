"""Whether a sensor's values can be believed in themselves, before any filter sees them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bluerov_slam.pipeline.navigator_words import Fault

# Arrival is the later instant by definition; a mapped clock may be wrong by this much.
FUTURE_TOLERANCE_S = 0.1
REPEATS_SHOWN = 3


def all_finite(values: Sequence[float | None]) -> bool:
    """Whether every value is a number; an unknown one is none."""
    return all(value is not None and math.isfinite(value) for value in values)


class TimeWatch:
    """Stamps of one source: each must be newer than the last, not after its arrival and not too old to be of use."""

    def __init__(self, oldest_s: float) -> None:
        self._oldest_s = oldest_s
        self._last_s = -math.inf
        self._repeats = 0

    def check(self, measured_s: float, arrived_s: float) -> Fault | None:
        """What is wrong with this stamp, None if nothing. A repeated one is refused, and named from the third on."""
        if not (math.isfinite(measured_s) and math.isfinite(arrived_s)):
            return Fault.NOT_A_NUMBER
        if measured_s > arrived_s + FUTURE_TOLERANCE_S:
            return Fault.FROM_THE_FUTURE
        if measured_s < arrived_s - self._oldest_s:
            return Fault.TOO_OLD
        if measured_s == self._last_s:
            self._repeats += 1
            return Fault.REPEATED_TIME
        self._repeats = 0
        self._last_s = max(self._last_s, measured_s)
        return None

    @property
    def hangs(self) -> bool:
        """Whether the same stamp came so often that somebody should be told."""
        return self._repeats >= REPEATS_SHOWN


class FrozenWatch:
    """A value that noise must move and that stays the same to the last digit."""

    def __init__(self, after_s: float, at_least: int) -> None:
        self._after_s = after_s
        self._at_least = at_least
        self._value: object = None
        self._since_s = 0.0
        self.count = 0

    def check(self, value: object, at_s: float) -> bool:
        """Whether the value has been frozen for so long that it is no measurement any more."""
        if value != self._value:
            self._value, self._since_s, self.count = value, at_s, 1
            return False
        self.count += 1
        return self.count >= self._at_least and at_s - self._since_s >= self._after_s
