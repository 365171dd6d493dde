"""The endless survey that the virtual vehicle is sent on: a closed track and a dive profile by mission time alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bluerov_slam.simulation.pilot import Target

LINE_LENGTH_M = 50.0
LINE_SPACING_M = 10.0
LINE_COUNT = 6
SPEED_MPS = 0.6
SURFACE_TIME_S = 20.0
SURVEY_TIME_S = 330.0
SURFACING_TIME_S = 30.0
_DESCENT_RATE_MPS = 0.3
_RAMP_S = 4.0
_AFLOAT_M = 0.16


@dataclass(frozen=True, slots=True)
class SurveyRoute:
    """Holds still at the surface, dives, mows parallel lines, comes up for a fix, and goes on for ever."""

    survey_depth_m: float
    line_count: int = LINE_COUNT

    def target(self, schedule_s: float) -> Target:
        """Where to be at a mission time (0 = floating at the surface, before the first dive)."""
        depth_m = self._depth(schedule_s)
        distance_m, speed_mps = _distance(schedule_s)
        north_m, east_m, course_rad = self._track(distance_m)
        return Target(north_m, east_m, depth_m if depth_m > _AFLOAT_M else None, course_rad, speed_mps, course_rad)

    def _depth(self, mission_s: float) -> float:
        """The depth to keep; afloat the middle of the vehicle lies 0.15 m below the surface."""
        travel_s = self.survey_depth_m / _DESCENT_RATE_MPS
        cycle_s = SURFACE_TIME_S + travel_s + SURVEY_TIME_S + travel_s + (SURFACING_TIME_S - SURFACE_TIME_S)
        phase_s = mission_s % cycle_s
        surface_m = 0.15
        reach_m = self.survey_depth_m - surface_m
        if phase_s < SURFACE_TIME_S:
            return surface_m
        phase_s -= SURFACE_TIME_S
        if phase_s < travel_s:
            return surface_m + reach_m * _smoothstep(phase_s / travel_s)
        phase_s -= travel_s
        if phase_s < SURVEY_TIME_S:
            return self.survey_depth_m
        phase_s -= SURVEY_TIME_S
        if phase_s < travel_s:
            return self.survey_depth_m - reach_m * _smoothstep(phase_s / travel_s)
        return surface_m

    def _track(self, distance_m: float) -> tuple[float, float, float]:
        """Position and unwrapped course at an arc length of the closed track."""
        radius_m = LINE_SPACING_M / 2.0
        turn_m = math.pi * radius_m
        corner_m = turn_m / 2.0
        lines_m = self.line_count * LINE_LENGTH_M + (self.line_count - 1) * turn_m
        return_m = (self.line_count - 1) * LINE_SPACING_M - 2.0 * radius_m
        rest_m = distance_m % (lines_m + return_m + 2.0 * corner_m)
        if rest_m < lines_m:
            return _mowing(rest_m, radius_m)
        # The last line runs south; two right-hand corners and a stretch westward lead back to the first line.
        rest_m -= lines_m
        last_east_m = (self.line_count - 1) * LINE_SPACING_M
        if rest_m < corner_m:
            return _arc(0.0, last_east_m - radius_m, radius_m, math.pi, rest_m / radius_m, 1.0)
        rest_m -= corner_m
        if rest_m < return_m:
            return -radius_m, last_east_m - radius_m - rest_m, 1.5 * math.pi
        return _arc(0.0, radius_m, radius_m, 1.5 * math.pi, (rest_m - return_m) / radius_m, 1.0)


def _mowing(distance_m: float, radius_m: float) -> tuple[float, float, float]:
    leg_m = LINE_LENGTH_M + math.pi * radius_m
    line, rest_m = int(distance_m // leg_m), distance_m % leg_m
    east_m = line * LINE_SPACING_M
    northward = line % 2 == 0
    course = 0.0 if northward else math.pi
    if rest_m < LINE_LENGTH_M:
        return (rest_m if northward else LINE_LENGTH_M - rest_m), east_m, course
    centre_north_m = LINE_LENGTH_M if northward else 0.0
    side = 1.0 if northward else -1.0
    return _arc(centre_north_m, east_m + radius_m, radius_m, course, (rest_m - LINE_LENGTH_M) / radius_m, side)


def _arc(
    centre_north_m: float, centre_east_m: float, radius_m: float, course_rad: float, angle_rad: float, side: float
) -> tuple[float, float, float]:
    """A point on a circular turn entered on `course_rad`; `side` +1 turns to starboard, -1 to port."""
    course = course_rad + side * angle_rad
    bearing = course - side * math.pi / 2.0
    return (
        centre_north_m + radius_m * math.cos(bearing),
        centre_east_m + radius_m * math.sin(bearing),
        course,
    )


def _distance(mission_s: float) -> tuple[float, float]:
    """Distance along the track and speed: still while first at the surface, then a gentle start."""
    moving_s = mission_s - SURFACE_TIME_S
    if moving_s <= 0.0:
        return 0.0, 0.0
    if moving_s < _RAMP_S:
        return SPEED_MPS * moving_s**2 / (2.0 * _RAMP_S), SPEED_MPS * moving_s / _RAMP_S
    return SPEED_MPS * (moving_s - _RAMP_S / 2.0), SPEED_MPS


def _smoothstep(x: float) -> float:
    return x * x * (3.0 - 2.0 * x)
