"""How the distance between an arm's end and its plate joint changes: the one equation behind all derivatives.

A set point x and servo angles theta belong together where every leg's distance l(x, theta) is its rod's length. With n
the unit vector from the arm's end to the plate joint, v the plate joint from the plate's middle and m = v x n:

    dl = n . dtranslation + (first column of R) . m droll + (-sin yaw, cos yaw, 0) . m dpitch + m_z dyaw
         - (n . darm/dtheta) dtheta
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.geometry.platform_stack import cross, rotations

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, PlatformDimensions


@dataclass(frozen=True, slots=True)
class LegLengths:
    """Of every leg.

    Attributes:
        excess_mm: distance less the rod's length, (..., 6).
        by_set_point: derivative of the distance by the set point, (..., 6, 6), mm per mm and per rad.
        by_servo_mm: what a distance loses per radian of its servo, (..., 6).
        along: unit vectors from arm end to plate joint, (..., 6, 3).
    """

    excess_mm: Floats
    by_set_point: Floats
    by_servo_mm: Floats
    along: Floats


def leg_lengths(set_points: Floats, angles_rad: Floats, dimensions: PlatformDimensions) -> LegLengths:
    """Distances and derivatives at set points (..., 6) and servo angles (..., 6)."""
    turn = rotations(set_points[..., 3:])
    v = dimensions.plate_joints_mm @ np.swapaxes(turn, -1, -2)
    middle = set_points[..., :3] - np.array([0.0, 0.0, dimensions.home_height_mm])
    level, upright = np.cos(angles_rad), np.sin(angles_rad)
    forward = np.stack([np.cos(dimensions.arm_bearings_rad), np.sin(dimensions.arm_bearings_rad)], axis=-1)
    arm = dimensions.arm_mm[..., None]
    arm_end = arm * np.concatenate([level[..., None] * forward, -upright[..., None]], axis=-1)
    arm_rate = arm * np.concatenate([-upright[..., None] * forward, -level[..., None]], axis=-1)
    leg = middle[..., None, :] + v - dimensions.base_joints_mm - arm_end
    length = np.sqrt(np.sum(leg * leg, axis=-1))
    n = leg / length[..., None]
    m = cross(v, n)
    yaw = set_points[..., 5, None]
    by_set_point = np.empty((*length.shape, 6))
    by_set_point[..., :3] = n
    by_set_point[..., 3] = (m @ turn[..., :, :1])[..., 0]
    by_set_point[..., 4] = np.cos(yaw) * m[..., 1] - np.sin(yaw) * m[..., 0]
    by_set_point[..., 5] = m[..., 2]
    return LegLengths(length - dimensions.rod_mm, by_set_point, np.sum(n * arm_rate, axis=-1), n)
