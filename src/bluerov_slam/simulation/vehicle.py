"""The simulated vehicle: a closed survey track and a dive profile, as a function of mission time alone.

Nothing is integrated, so any instant can be asked for in any order and always gives the same answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LINE_LENGTH_M = 50.0
LINE_SPACING_M = 10.0
LINE_COUNT = 6
SPEED_MPS = 0.6
SURFACE_TIME_S = 20.0
SURVEY_TIME_S = 330.0
SURFACING_TIME_S = 30.0
_DESCENT_RATE_MPS = 0.3
_RAMP_S = 4.0


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Pose and velocity at one instant. World NED about the survey origin, body FRD, yaw from true north.

    `fix_possible` says whether the antenna is out of the water.
    """

    north_m: float
    east_m: float
    depth_m: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    speed_mps: float
    fix_possible: bool


@dataclass(frozen=True, slots=True)
class SurveyVehicle:
    """Holds still at the surface, dives, mows parallel lines, comes up for a fix, and goes on for ever."""

    survey_depth_m: float
    line_count: int = LINE_COUNT

    def state(self, mission_s: float) -> VehicleState:
        """The state at a mission time (0 = floating at the surface, before the first dive)."""
        depth_m, descent_mps = self._depth(mission_s)
        distance_m, speed_mps = _distance(mission_s)
        north_m, east_m, course_rad, turn_per_m = self._track(distance_m)
        waves = math.exp(-depth_m / 1.5)
        t = mission_s
        roll = 0.030 * math.sin(0.83 * t) + 0.018 * math.sin(2.1 * t + 1.0) + 0.09 * waves * math.sin(1.7 * t)
        pitch = 0.022 * math.sin(0.61 * t + 0.4) + 0.012 * math.sin(1.9 * t) + 0.06 * waves * math.sin(1.5 * t + 2.0)
        yaw = course_rad + 0.030 * math.sin(0.37 * t) + 0.012 * math.sin(1.3 * t + 0.7)
        return VehicleState(
            north_m=north_m,
            east_m=east_m,
            depth_m=depth_m + 0.04 * waves * math.sin(1.6 * t) + 0.03 * (1.0 - waves) * math.sin(0.21 * t),
            roll_rad=roll + 0.25 * turn_per_m * speed_mps,
            pitch_rad=pitch - 0.35 * descent_mps,
            yaw_rad=math.remainder(yaw, 2.0 * math.pi),
            speed_mps=speed_mps,
            fix_possible=depth_m < 0.25,
        )

    def _depth(self, mission_s: float) -> tuple[float, float]:
        """Depth and rate of descent; the antenna floats 0.15 m above the pressure sensor."""
        travel_s = self.survey_depth_m / _DESCENT_RATE_MPS
        cycle_s = SURFACE_TIME_S + travel_s + SURVEY_TIME_S + travel_s + (SURFACING_TIME_S - SURFACE_TIME_S)
        phase_s = mission_s % cycle_s
        surface_m = 0.15
        reach_m = self.survey_depth_m - surface_m
        if phase_s < SURFACE_TIME_S:
            return surface_m, 0.0
        phase_s -= SURFACE_TIME_S
        if phase_s < travel_s:
            share, slope = _smoothstep(phase_s / travel_s)
            return surface_m + reach_m * share, reach_m * slope / travel_s
        phase_s -= travel_s
        if phase_s < SURVEY_TIME_S:
            return self.survey_depth_m, 0.0
        phase_s -= SURVEY_TIME_S
        if phase_s < travel_s:
            share, slope = _smoothstep(phase_s / travel_s)
            return self.survey_depth_m - reach_m * share, -reach_m * slope / travel_s
        return surface_m, 0.0

    def _track(self, distance_m: float) -> tuple[float, float, float, float]:
        """Position, unwrapped course and curvature at an arc length of the closed track."""
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
            return -radius_m, last_east_m - radius_m - rest_m, 1.5 * math.pi, 0.0
        return _arc(0.0, radius_m, radius_m, 1.5 * math.pi, (rest_m - return_m) / radius_m, 1.0)


def _mowing(distance_m: float, radius_m: float) -> tuple[float, float, float, float]:
    leg_m = LINE_LENGTH_M + math.pi * radius_m
    line, rest_m = int(distance_m // leg_m), distance_m % leg_m
    east_m = line * LINE_SPACING_M
    northward = line % 2 == 0
    course = 0.0 if northward else math.pi
    if rest_m < LINE_LENGTH_M:
        return (rest_m if northward else LINE_LENGTH_M - rest_m), east_m, course, 0.0
    centre_north_m = LINE_LENGTH_M if northward else 0.0
    side = 1.0 if northward else -1.0
    return _arc(centre_north_m, east_m + radius_m, radius_m, course, (rest_m - LINE_LENGTH_M) / radius_m, side)


def _arc(
    centre_north_m: float, centre_east_m: float, radius_m: float, course_rad: float, angle_rad: float, side: float
) -> tuple[float, float, float, float]:
    """A point on a circular turn entered on `course_rad`; `side` +1 turns to starboard, -1 to port."""
    course = course_rad + side * angle_rad
    bearing = course - side * math.pi / 2.0
    return (
        centre_north_m + radius_m * math.cos(bearing),
        centre_east_m + radius_m * math.sin(bearing),
        course,
        side / radius_m,
    )


def _distance(mission_s: float) -> tuple[float, float]:
    """Distance along the track and speed: still while first at the surface, then a gentle start."""
    moving_s = mission_s - SURFACE_TIME_S
    if moving_s <= 0.0:
        return 0.0, 0.0
    if moving_s < _RAMP_S:
        return SPEED_MPS * moving_s**2 / (2.0 * _RAMP_S), SPEED_MPS * moving_s / _RAMP_S
    return SPEED_MPS * (moving_s - _RAMP_S / 2.0), SPEED_MPS


def _smoothstep(x: float) -> tuple[float, float]:
    return x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x)
