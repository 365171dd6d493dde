"""Who calls: one transmitter, two of them, or another than ours, told from the directions and times of the pulses.

Two transmitters are heard in turn. Their directions alternate, and a pulse of one follows one of the other sooner than
any transmitter follows itself; an echo comes instead of its own pulse, so it never does. What is not ours is held back.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.records import AcousticMessage

    Array = NDArray[np.float64]

TWO_TEXT: Final = "two transmitters are heard in turn, and nothing tells which is ours; switch one of them off"
PLACES_TEXT: Final = (
    "the direction jumps between two places; two transmitters are on, or a wall's echo is as strong as the sound itself"
)
OTHER_TEXT: Final = "a pulse of another transmitter, from elsewhere than ours; switch the other one off"
WRONG_TEXT: Final = (
    "the sound does not come from where the transmitter should be; another one is heard, or acoustics.beacon, "
    "acoustics.mounting_rpy_deg or the order of the receivers is wrong"
)
HELD_TEXTS: Final = frozenset((TWO_TEXT, PLACES_TEXT, OTHER_TEXT, WRONG_TEXT))

# Directions further apart than this, and than the vehicle can have moved, are not those of one transmitter.
APART_RAD: Final = math.radians(12.0)
LARGEST_MOVE_RAD: Final = math.radians(45.0)
FASTEST_MPS: Final = 1.5
REMEMBERED: Final = 16
MOST_CALLERS: Final = 4
# To and fro and to: two visits to each of two places are no chance.
SWITCHES: Final = 3
# Without an early pulse as a proof it takes more, since an echo may come now and then.
SWITCHES_OF_ECHOES: Final = 6
# Of a transmitter's own period: what follows sooner is another one.
TOO_SOON: Final = 0.75
# A record and the delays of one pulse are one call.
ONE_CALL_S: Final = 0.05
# Where ours should be, at most so far off; and what is further off than the second is not ours.
FITTING_RAD: Final = math.radians(15.0)
CONTRADICTING_RAD: Final = math.radians(25.0)
CONTRADICTED: Final = 3  # of the last 4: one may have come by an echo
JUDGED: Final = 4
# An expectation less sure than this tells nothing.
LARGEST_STD_RAD: Final = math.radians(20.0)


@dataclass(frozen=True, eq=False)
class Expected:
    """Where the transmitter should be, as a unit vector (3,) in NED, and how sure that is."""

    direction_ned: Array
    std_rad: float


@dataclass(eq=False)
class _Caller:
    direction: Array
    heard_s: float
    message: AcousticMessage | None = None


class Callers:
    """`hear` every direction in the order of arrival; it says in words why a pulse is held back."""

    def __init__(self) -> None:
        self._callers: list[_Caller] = []
        self._calls: deque[tuple[float, _Caller]] = deque(maxlen=REMEMBERED)
        self._contradicts: deque[bool] = deque(maxlen=JUDGED)
        self._level = False
        self.ours: _Caller | None = None
        self.two = False

    def hear(
        self,
        at_s: float,
        direction: Array,
        level: bool,
        range_m: float | None,
        expected: Expected | None,
        message: AcousticMessage | None = None,
    ) -> str:
        """Take a direction (3,), in NED where `level`, else in the body's axes; empty: nothing is against it."""
        if level != self._level:
            self._level = level
            self._callers.clear()
            self._calls.clear()
        caller = self._caller_of(at_s, direction, range_m)
        if message is not None:
            caller.message = message
        if not self._calls or abs(at_s - self._calls[-1][0]) > ONE_CALL_S:
            self._calls.append((at_s, caller))
        pair, sure = self._pair()
        self.two = pair is not None
        if pair is None:
            self.ours = None
            return self._against(direction, expected)
        self._contradicts.clear()
        self.ours = _fitting(pair, expected)
        if self.ours is None:
            return TWO_TEXT if sure else PLACES_TEXT
        return "" if caller is self.ours else OTHER_TEXT

    def _caller_of(self, at_s: float, direction: Array, range_m: float | None) -> _Caller:
        """Whose pulse this is, by its direction alone."""
        nearest = min(self._callers, key=lambda each: _angle(each.direction, direction), default=None)
        if nearest is not None:
            moved = 0.0
            if range_m is not None:
                moved = min(LARGEST_MOVE_RAD, FASTEST_MPS * abs(at_s - nearest.heard_s) / max(range_m, 1.0))
            if _angle(nearest.direction, direction) < APART_RAD + moved:
                nearest.direction, nearest.heard_s = direction, at_s
                return nearest
        made = _Caller(direction, at_s)
        self._callers.append(made)
        if len(self._callers) > MOST_CALLERS:
            self._callers.remove(min(self._callers, key=lambda each: each.heard_s))
        return made

    def _pair(self) -> tuple[tuple[_Caller, _Caller] | None, bool]:
        """Two callers that took turns, and whether they are two transmitters for sure."""
        calls = sorted(self._calls, key=lambda call: call[0])
        for pair in combinations(self._callers, 2):
            turns = [(at_s, caller) for at_s, caller in calls if caller in pair]
            switches = sum(before[1] is not after[1] for before, after in pairwise(turns))
            if switches < SWITCHES:
                continue
            own_s = [
                after - before
                for caller in pair
                for before, after in pairwise([at_s for at_s, each in turns if each is caller])
            ]
            soon = sum(
                before[1] is not after[1] and after[0] - before[0] < TOO_SOON * min(own_s, default=0.0)
                for before, after in pairwise(turns)
            )
            if soon >= 2:
                return pair, True
            if switches >= SWITCHES_OF_ECHOES:
                return pair, False
        return None, False

    def _against(self, direction: Array, expected: Expected | None) -> str:
        """One caller that is not where ours should be, pulse after pulse."""
        if expected is None or expected.std_rad > LARGEST_STD_RAD:
            self._contradicts.clear()
            return ""
        off = _angle(direction, expected.direction_ned) > max(CONTRADICTING_RAD, 4.0 * expected.std_rad)
        self._contradicts.append(off)
        return WRONG_TEXT if off and sum(self._contradicts) >= CONTRADICTED else ""


def _fitting(pair: tuple[_Caller, _Caller], expected: Expected | None) -> _Caller | None:
    """The one that is where ours should be, if the other one is not."""
    if expected is None or expected.std_rad > LARGEST_STD_RAD:
        return None
    off = [_angle(each.direction, expected.direction_ned) for each in pair]
    near = max(FITTING_RAD, 3.0 * expected.std_rad)
    fits = [each for each, angle in zip(pair, off, strict=True) if angle < near]
    return fits[0] if len(fits) == 1 and max(off) > min(off) + APART_RAD else None


def _angle(first: Array, second: Array) -> float:
    return math.acos(min(1.0, max(-1.0, float(first @ second))))
