"""Where the vehicle has been since the start: bounded, by thinning what is old."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from bluerov_slam.protocol.navigation_json import FixOutcome, error_ellipse
from bluerov_slam.records import NavState

POINT_PERIOD_S: Final = 0.5
MAX_POINTS: Final = 20_000
MAX_FIXES: Final = 10_000
DEFAULT_POINTS: Final = 2000


class NavigationTrack:
    """One point each half second; full, every second one of the older half goes. About 3 MB at most.

    Points are told about the present origin; the track starts anew when the origin moves.
    """

    def __init__(self, unix_s: Callable[[float], float]) -> None:
        self._unix_s = unix_s
        self._origin: tuple[float, float] | None = None
        self._points: list[tuple[Any, ...]] = []
        self._fixes: list[tuple[Any, ...]] = []
        self._point_s = -math.inf

    def add(self, state: NavState) -> None:
        """Take a state, if it is time for one and its position is known."""
        if state.origin_deg != self._origin:
            self._origin = state.origin_deg
            self._points.clear()
            self._fixes.clear()
            self._point_s = -math.inf
        if state.position_ned_m is None or abs(state.measured_s - self._point_s) < POINT_PERIOD_S:
            return
        self._point_s = state.measured_s
        north_m, east_m, _ = state.position_ned_m
        ellipse, velocity = error_ellipse(state.pose_covariance), state.velocity_ned_mps
        self._points.append(
            (
                round(self._unix_s(state.measured_s), 3),
                round(north_m, 2),
                round(east_m, 2),
                None if state.depth_m is None else round(state.depth_m, 2),
                None if ellipse is None else round(ellipse.major_m, 2),
                None if velocity is None else round(math.hypot(velocity[0], velocity[1]), 3),
                state.mode.value,
            )
        )
        _thin(self._points, MAX_POINTS)

    def add_fix(self, fix: FixOutcome) -> None:
        """Take a fix."""
        if fix.north_m is None or fix.east_m is None:
            return
        at, std_m = round(self._unix_s(fix.measured_s), 3), None if fix.std_m is None else round(fix.std_m, 2)
        self._fixes.append((at, round(fix.north_m, 2), round(fix.east_m, 2), std_m, fix.source, fix.accepted))
        _thin(self._fixes, MAX_FIXES)

    def listing(self, since_unix_s: float = -math.inf, points: int = DEFAULT_POINTS) -> dict[str, Any]:
        """What GET /api/navigation/track answers; the newest point is always among them."""
        latitude_deg, longitude_deg = self._origin or (None, None)
        return {
            "origin": {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg},
            "points": _chosen([p for p in self._points if p[0] > since_unix_s], points),
            "fixes": _chosen([f for f in self._fixes if f[0] > since_unix_s], points),
        }


def _thin(items: list[tuple[Any, ...]], limit: int) -> None:
    if len(items) > limit:
        half = len(items) // 2
        items[:half] = items[:half:2]


def _chosen(items: list[tuple[Any, ...]], count: int) -> list[tuple[Any, ...]]:
    """At most `count` of them, evenly spread, the last one included."""
    if len(items) <= count:
        return items
    step = (len(items) - 1) / max(count - 1, 1)
    return [items[len(items) - 1 - round(step * i)] for i in range(count)][::-1]
