"""Where a dive goes: a route along straight legs, a place to stay, a slow turn on the spot, and dive profiles."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from bluerov_slam.simulation.pilot import Target

_RATE_MPS = 0.3  # of descent and ascent


@dataclass(frozen=True, slots=True)
class DepthPlan:
    """`changes`: (from when, to what depth in m or None for afloat), in order; the way between takes its time."""

    changes: tuple[tuple[float, float | None], ...]

    def depth_m(self, schedule_s: float) -> float | None:
        """The depth to keep; None afloat."""
        wanted: float | None = None
        depth_m = 0.0
        for number, (from_s, to_m) in enumerate(self.changes):
            if schedule_s < from_s:
                break
            until_s = self.changes[number + 1][0] if number + 1 < len(self.changes) else math.inf
            spent_s = min(schedule_s, until_s) - from_s
            aim_m = 0.0 if to_m is None else to_m
            way_m = aim_m - depth_m if from_s > self.changes[0][0] else math.copysign(math.inf, aim_m)
            depth_m = (
                aim_m
                if abs(way_m) <= _RATE_MPS * spent_s or number == 0
                else depth_m + math.copysign(_RATE_MPS * spent_s, way_m)
            )
            wanted = None if to_m is None and depth_m <= 0.0 else depth_m
        return wanted


class LegRoute:
    """Straight legs between corners (north, east in m) at one speed over ground, after a time at rest."""

    def __init__(
        self, corners: Sequence[tuple[float, float]], speed_mps: float, depth: DepthPlan, rest_s: float = 0.0
    ) -> None:
        self.rest_s = rest_s
        self._corners = list(corners)
        self._speed_mps = speed_mps
        self._depth = depth
        lengths = [math.dist(a, b) for a, b in itertools.pairwise(corners)]
        self._until_m = [sum(lengths[: n + 1]) for n in range(len(lengths))]

    @property
    def length_m(self) -> float:
        """From the first corner to the last."""
        return self._until_m[-1]

    @property
    def end_s(self) -> float:
        """When the schedule reaches the last corner."""
        return self.rest_s + self.length_m / self._speed_mps

    def target(self, schedule_s: float) -> Target:
        way_m = min(max(0.0, (schedule_s - self.rest_s) * self._speed_mps), self.length_m)
        leg = min(bisect.bisect_right(self._until_m, way_m), len(self._until_m) - 1)
        (n0, e0), (n1, e1) = self._corners[leg], self._corners[leg + 1]
        before_m = self._until_m[leg - 1] if leg else 0.0
        share = (way_m - before_m) / (self._until_m[leg] - before_m)
        course = math.atan2(e1 - e0, n1 - n0)
        moving = 0.0 < way_m < self.length_m
        return Target(
            n0 + share * (n1 - n0),
            e0 + share * (e1 - e0),
            self._depth.depth_m(schedule_s),
            course,
            self._speed_mps if moving else 0.0,
            course,
        )


class SwingRoute:
    """Stays at the origin and turns there: `turns` full turns to starboard, `turn_s` each, after a time at rest."""

    def __init__(self, turns: float, turn_s: float, depth: DepthPlan, rest_s: float = 20.0) -> None:
        self.end_s = rest_s + turns * turn_s
        self._rest_s, self._turn_s = rest_s, turn_s
        self._depth = depth

    def target(self, schedule_s: float) -> Target:
        turning_s = min(max(0.0, schedule_s - self._rest_s), self.end_s - self._rest_s)
        heading = 2.0 * math.pi * turning_s / self._turn_s
        return Target(0.0, 0.0, self._depth.depth_m(schedule_s), heading, 0.0, heading)


class JoinedRoutes:
    """One route behind another: the second's schedule starts when the first's is over."""

    def __init__(self, first: SwingRoute | LegRoute, second: SwingRoute | LegRoute) -> None:
        self._first, self._second = first, second
        self.end_s = first.end_s + second.end_s

    def target(self, schedule_s: float) -> Target:
        if schedule_s < self._first.end_s:
            return self._first.target(schedule_s)
        return self._second.target(schedule_s - self._first.end_s)


def lawnmower_corners(legs: int = 5, leg_m: float = 180.0, spacing_m: float = 20.0) -> list[tuple[float, float]]:
    """Parallel legs north and south, the next one to the east each time, starting at the origin."""
    corners: list[tuple[float, float]] = []
    for leg in range(legs):
        there, back = (0.0, leg_m) if leg % 2 == 0 else (leg_m, 0.0)
        corners += [(there, leg * spacing_m), (back, leg * spacing_m)]
    return corners
