"""How well the tool's pose is known: spreads of servos, play, rods, arms and joints carried through the derivatives.

At fixed servo commands every spread changes a leg's distance l; the plate gives way so that each is its rod's length
again: dx = -(dl/dx)^-1 dl. With n along the leg, one leg's distance has the variance

    (n . darm/dtheta)^2 (servo^2 + slop^2) + rod^2 + (n . arm direction)^2 arm^2 + 2 joint^2

(two joints, each coordinate alike, n of unit length). The legs are independent but for the settings of facing servos,
which may be correlated. Platforms are independent; the stack's derivative adds them up.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import LEGS
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.platform import arm_vectors_mm, inverse, servo_angles_rad
from bluerov_slam.rig.stack import StackPose, plate_poses, stack_jacobian, stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, ManufacturingSpread, PlatformDimensions, StackDimensions


def set_point_covariance(set_points: Floats, dimensions: PlatformDimensions, spread: ManufacturingSpread) -> Floats:
    """Covariance (..., 6, 6) of what one platform makes of its set point (..., 6), mm and rad; NaN out of reach."""
    points = np.asarray(set_points, dtype=np.float64)
    angles = servo_angles_rad(points, dimensions)
    legs = leg_lengths(points, angles, dimensions)
    arm_directions = arm_vectors_mm(angles, dimensions) / dimensions.arm_mm[..., None]
    along_arm = np.sum(legs.along * arm_directions, axis=-1)
    own = spread.rod_mm**2 + along_arm**2 * spread.arm_mm**2 + 2.0 * spread.joint_mm**2
    lengths = own[..., None, :] * np.eye(LEGS)
    lengths += legs.by_servo_mm[..., :, None] * servo_covariance(spread) * legs.by_servo_mm[..., None, :]
    back = inverse(legs.by_set_point)
    return np.asarray(back @ lengths @ np.swapaxes(back, -1, -2))


def servo_covariance(spread: ManufacturingSpread) -> Floats:
    """Of the six servo angles of a platform, (6, 6), rad^2."""
    facing = np.kron(np.eye(LEGS // 2), np.array([[0.0, 1.0], [1.0, 0.0]]))
    settings = spread.servo_rad**2 * (np.eye(LEGS) + spread.pair_correlation * facing)
    return np.asarray(settings + spread.slop_rad**2 * np.eye(LEGS))


def pose_covariance(set_points: Floats, dimensions: StackDimensions, spread: ManufacturingSpread) -> Floats:
    """Covariance (..., 6, 6) of the tool's place (mm) and turn (rad, vector in the rig frame); NaN out of reach."""
    points = np.asarray(set_points, dtype=np.float64)
    jacobian = stack_jacobian(points, dimensions)
    total = np.zeros((*points.shape[:-2], 6, 6))
    for i, platform in enumerate(dimensions.platforms):
        part = jacobian[..., 6 * i : 6 * i + 6]
        total += part @ set_point_covariance(points[..., i, :], platform, spread) @ np.swapaxes(part, -1, -2)
    # An offset's spread has no direction, so that it is the same in the rig frame whatever turned beneath it.
    total[..., range(3), range(3)] += (len(dimensions.platforms) + 2) * spread.stacking_mm**2
    return total


def sample_poses(
    set_points: Floats, dimensions: StackDimensions, spread: ManufacturingSpread, count: int, seed: int
) -> StackPose:
    """The Monte Carlo check: poses of so many rigs of that spread, all commanded to set points (platforms, 6)."""
    random = np.random.default_rng(seed)
    points = np.asarray(set_points, dtype=np.float64)
    made = [_made(points[i], platform, spread, count, random) for i, platform in enumerate(dimensions.platforms)]
    offsets = spread.stacking_mm * random.standard_normal((len(made) + 2, count, 3))
    lifted = np.stack(made, axis=1)
    pose = stack_pose(lifted, dimensions)
    beneath = plate_poses(lifted, dimensions).rotation
    moved = pose.position_mm + offsets[0] + offsets[1]
    for i in range(len(made)):
        moved = moved + np.einsum("nij,nj->ni", beneath[:, i], offsets[i + 2])
    return StackPose(moved, pose.rotation)


def _made(
    point: Floats, dimensions: PlatformDimensions, spread: ManufacturingSpread, count: int, random: np.random.Generator
) -> Floats:
    """Set points (count, 6) that platforms of that spread make when told this one."""

    def around(values: Floats, deviation: float) -> Floats:
        return values + deviation * random.standard_normal((count, *values.shape))

    servos = random.multivariate_normal(np.zeros(LEGS), servo_covariance(spread), count)
    real = replace(
        dimensions,
        base_joints_mm=around(dimensions.base_joints_mm, spread.joint_mm),
        plate_joints_mm=around(dimensions.plate_joints_mm, spread.joint_mm),
        arm_mm=around(dimensions.arm_mm, spread.arm_mm),
        rod_mm=around(dimensions.rod_mm, spread.rod_mm),
    )
    return plate_pose(servo_angles_rad(point, dimensions) + servos, real, point).set_point
