"""The vehicle at one instant, as sonars and surveys see it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Pose and velocity at one instant. World NED about the survey origin, body FRD, yaw from true north.

    `fix_possible` says whether the antenna is out of the water; `course_rad` is None where it is the heading.
    """

    north_m: float
    east_m: float
    depth_m: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    speed_mps: float
    fix_possible: bool
    course_rad: float | None = None
