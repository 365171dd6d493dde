"""A stack of platforms as lines in space, for drawing: every plate, arm and rod in the rig frame; and its margins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.limits import FO_SHIP_LIMITS, platform_margins
from bluerov_slam.rig.platform import joints_mm, servo_angles_rad
from bluerov_slam.rig.stack import StackPose, plate_poses, stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions
    from bluerov_slam.rig.limits import Limit, PlatformLimits


@dataclass(frozen=True, slots=True)
class StackScene:
    """What there is to draw of set points (..., P, 6), mm, rig frame.

    Attributes:
        base_mm: servo axes, (..., P, 6, 3).
        arm_ends_mm: ends of the servos' arms, (..., P, 6, 3); NaN where a leg does not reach.
        plate_mm: joints of the plates, (..., P, 6, 3).
        servo_rad: servo angles, (..., P, 6); NaN where a leg does not reach.
        tool: pose of the tool.
    """

    base_mm: Floats
    arm_ends_mm: Floats
    plate_mm: Floats
    servo_rad: Floats
    tool: StackPose


def stack_scene(set_points: Floats, dimensions: StackDimensions = FO_SHIP) -> StackScene:
    """The scene at set points (..., P, 6), base to top, also where they cannot be reached."""
    points = np.asarray(set_points, dtype=np.float64)
    plates = plate_poses(points, dimensions)
    lead = points.shape[:-2]
    foot = np.broadcast_to(dimensions.foot_mm, (*lead, 1, 3))
    level = np.broadcast_to(np.eye(3), (*lead, 1, 3, 3))
    beneath = np.concatenate([level, plates.rotation[..., :-1, :, :]], axis=-3)
    axes_mm = np.concatenate([foot, plates.position_mm[..., :-1, :]], axis=-2) + beneath @ dimensions.base_mm
    base, arms, plate = (np.empty((*points.shape[:-1], 6, 3)) for _ in range(3))
    angles = np.empty((*points.shape[:-1], 6))
    for place, platform in enumerate(dimensions.platforms):
        joints = joints_mm(points[..., place, :], platform)
        turn, origin = np.swapaxes(beneath[..., place, :, :], -1, -2), axes_mm[..., place, None, :]
        base[..., place, :, :] = origin + joints.base_mm @ turn
        arms[..., place, :, :] = origin + joints.arm_ends_mm @ turn
        plate[..., place, :, :] = origin + joints.plate_mm @ turn
        angles[..., place, :] = servo_angles_rad(points[..., place, :], platform)
    return StackScene(base, arms, plate, angles, stack_pose(points, dimensions))


@dataclass(frozen=True, slots=True)
class MarginShare:
    """How much of a platform's room to one limit is left: 1 at home, 0 at it, NaN where the legs do not reach."""

    limit: Limit
    share: float


def margin_shares(
    set_point: Floats, platform: int, dimensions: StackDimensions = FO_SHIP, limits: PlatformLimits = FO_SHIP_LIMITS
) -> tuple[MarginShare, ...]:
    """Of one platform's set point (6,), the least first; what breaks a limit is negative."""
    of = dimensions.platforms[platform]
    here = platform_margins(set_point, of, limits).by_limit()
    home = platform_margins(np.zeros(6), of, limits).by_limit()
    shares = [MarginShare(limit, float(here[limit] / home[limit])) for limit in here if np.isfinite(home[limit])]
    return tuple(sorted(shares, key=lambda one: (not np.isnan(one.share), one.share)))
