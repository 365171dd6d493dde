"""The truth that a collection writes down: the drawn rig's, mended by the attitude that the array itself measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from bluerov_slam.geometry.platform_stack import PLATFORMS, rotations
from bluerov_slam.rig.dimensions import FO_SHIP, Floats, ManufacturingSpread
from bluerov_slam.rig.tool_truth import tool_truth
from bluerov_slam.rig.validation import logged_spread

LEVEL_STD_RAD = float(np.radians(0.2))
"""Roll and pitch by gravity, with what the mounting is off."""
YAW_STD_RAD = float(np.radians(1.0))
"""By a compass that wobbles by half a degree and was set to zero by one reading."""

STACKING_MM = 0.5
"""Of each part on the one beneath, each coordinate: printed plates, bolted. Without it the height, which hardly follows
the tilt, would pass for known to a millimetre."""


@cache
def truth_spread() -> ManufacturingSpread:
    """What the report's stated deviation comes from: gauge (facing servos pass it together, hence correlated), stated
    dimensions, the logs' play, and the stacking."""
    return replace(logged_spread(), stacking_mm=STACKING_MM)


def truth_of(set_point: Floats, attitude_rad: Floats) -> tuple[Floats, Floats]:
    """Array's centre (3,) mm and covariance (3, 3) mm2 of four platforms at one set point (6,), the array's roll,
    pitch and yaw (3,) measured. NaN where the set point cannot be reached."""
    std = np.array((LEVEL_STD_RAD, LEVEL_STD_RAD, YAW_STD_RAD))
    turn = rotations(np.asarray(attitude_rad)[None])[0]
    found = tool_truth(np.tile(set_point, (PLATFORMS, 1)), turn, std, FO_SHIP, truth_spread())
    return found.position_mm, found.covariance[:3, :3]
