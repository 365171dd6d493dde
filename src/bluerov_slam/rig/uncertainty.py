"""How well the tool's pose is known: what a rig's build and its servos' play make of it, by the derivatives.

At fixed servo commands an error changes a leg's distance l by dl; the plate gives way so that each is its rod's length
again: dx = -(dl/dx)^-1 dl. Every error of a build is one number of unit variance with a column of its own: what it does
to the set points. The same columns at two poses tell how much of their errors is shared, which no covariance of one
pose can: the build stays over a motion, only the play is another at each pose.

The two joints of a leg, its arm, rod, servo's zero and gain are independent but for the zeros of facing servos. Errors
"alike" are one number for all platforms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.rig.dimensions import LEGS
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.platform import arm_vectors_mm, inverse, servo_angles_rad
from bluerov_slam.rig.stack import StackPose, plate_poses, stack_jacobian, stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, ManufacturingSpread, PlatformDimensions, StackDimensions

OWN, ALIKE = 11 * LEGS, 13
"""Numbers of a platform's own build, and of what all platforms have alike."""


@dataclass(frozen=True, slots=True, eq=False)
class SetPointErrors:
    """What errors of unit variance do to a platform's set point, mm and rad; NaN out of reach.

    Attributes:
        own: (..., 6, OWN): zeros, gains, rods, arms of its six legs, then base joints, plate joints
            and the gain of each axis.
        alike: (..., 6, ALIKE): servo gain, arms, base (3), gain of each axis (6), lean in roll and in pitch.
        play: (..., 6, 6), of the six servos.
    """

    own: Floats
    alike: Floats
    play: Floats


def set_point_errors(
    set_points: Floats, dimensions: PlatformDimensions, spread: ManufacturingSpread, told_rad: Floats | None = None
) -> SetPointErrors:
    """Of one platform at set points (..., 6); `told_rad`: its servos' commands (..., 6), where it is known that the
    set points are not what was commanded."""
    points = np.asarray(set_points, dtype=np.float64)
    angles = servo_angles_rad(points, dimensions)
    legs = leg_lengths(points, angles, dimensions)
    arm_directions = arm_vectors_mm(angles, dimensions) / dimensions.arm_mm[..., None]
    along_arm = np.sum(legs.along * arm_directions, axis=-1)
    back = inverse(legs.by_set_point)
    by_servo = back * legs.by_servo_mm[..., None, :]
    by_arm = back * along_arm[..., None, :]
    base = (back[..., None] * legs.along[..., None, :, :]).reshape(*back.shape[:-1], 3 * LEGS)
    in_plate = legs.along @ rotations(points[..., 3:])
    plate = (back[..., None] * in_plate[..., None, :, :]).reshape(*back.shape[:-1], 3 * LEGS)
    turned = by_servo * (angles if told_rad is None else told_rad)[..., None, :]
    zeros = by_servo @ zero_factor(spread)
    own = [zeros, spread.gain * turned, spread.rod_mm * back, spread.arm_mm * by_arm]
    own += [spread.joint_mm * base, -spread.joint_mm * plate]
    one = np.broadcast_to(np.eye(LEGS), back.shape)
    own.append(points[..., None] * one * np.array(spread.axis_gain_apart))
    alike = [
        spread.gain_alike * np.sum(turned, axis=-1, keepdims=True),
        spread.arm_alike_mm * np.sum(by_arm, axis=-1, keepdims=True),
        spread.base_alike_mm * one[..., :3],
        points[..., None] * one * np.array(spread.axis_gain),
        spread.lean_rad * one[..., 3:5],
    ]
    return SetPointErrors(np.concatenate(own, axis=-1), np.concatenate(alike, axis=-1), spread.slop_rad * by_servo)


def set_point_covariance(set_points: Floats, dimensions: PlatformDimensions, spread: ManufacturingSpread) -> Floats:
    """Covariance (..., 6, 6) of what one platform makes of its set point (..., 6), mm and rad; NaN out of reach."""
    errors = set_point_errors(set_points, dimensions, spread)
    every = np.concatenate([errors.own, errors.alike, errors.play], axis=-1)
    return np.asarray(every @ np.swapaxes(every, -1, -2))


def set_points_covariance(set_points: Floats, dimensions: StackDimensions, spread: ManufacturingSpread) -> Floats:
    """Covariance (6 platforms, 6 platforms) of what a stack makes of its set points (platforms, 6)."""
    count = len(dimensions.platforms)
    total = np.zeros((6 * count, 6 * count))
    alike = np.zeros((6 * count, ALIKE))
    for i, platform in enumerate(dimensions.platforms):
        part, errors = slice(6 * i, 6 * i + 6), set_point_errors(set_points[i], platform, spread)
        total[part, part] = errors.own @ errors.own.T + errors.play @ errors.play.T
        alike[part] = errors.alike
    return total + alike @ alike.T


def zero_factor(spread: ManufacturingSpread) -> Floats:
    """(6, 6): times independent numbers it is the servos' zeros, rad."""
    apart = np.sqrt(1.0 - spread.pair_correlation**2)
    pair = np.array([[1.0, 0.0], [spread.pair_correlation, apart]])
    return np.asarray(spread.servo_rad * np.kron(np.eye(LEGS // 2), pair))


def pose_covariance(set_points: Floats, dimensions: StackDimensions, spread: ManufacturingSpread) -> Floats:
    """Covariance (..., 6, 6) of the tool's place (mm) and turn (rad, vector in the rig frame); NaN out of reach."""
    points = np.asarray(set_points, dtype=np.float64)
    jacobian = stack_jacobian(points, dimensions)
    total = np.zeros((*points.shape[:-2], 6, 6))
    alike = np.zeros((*points.shape[:-2], 6, ALIKE))
    for i, platform in enumerate(dimensions.platforms):
        part, errors = jacobian[..., 6 * i : 6 * i + 6], set_point_errors(points[..., i, :], platform, spread)
        single = part @ np.concatenate([errors.own, errors.play], axis=-1)
        total += single @ np.swapaxes(single, -1, -2)
        alike += part @ errors.alike
    total += alike @ np.swapaxes(alike, -1, -2)
    # An offset's spread has no direction, so that it is the same in the rig frame whatever turned beneath it.
    total[..., range(3), range(3)] += (len(dimensions.platforms) + 2) * spread.stacking_mm**2
    return total


def sample_poses(
    set_points: Floats, dimensions: StackDimensions, spread: ManufacturingSpread, count: int, seed: int
) -> StackPose:
    """The Monte Carlo check: poses of so many rigs of that spread, all commanded to set points (platforms, 6)."""
    random = np.random.default_rng(seed)
    points = np.asarray(set_points, dtype=np.float64)
    alike = {
        "gain": 1.0 + spread.gain_alike * random.standard_normal((count, 1)),
        "arm": spread.arm_alike_mm * random.standard_normal((count, 1)),
    }
    made = [_made(points[i], each, spread, alike, random) for i, each in enumerate(dimensions.platforms)]
    lifted = np.stack(made, axis=1)
    gains = np.array(spread.axis_gain) * random.standard_normal((count, 1, 6))
    gains = gains + np.array(spread.axis_gain_apart) * random.standard_normal((count, len(made), 6))
    lifted = lifted + gains * points
    lifted[..., 3:5] += spread.lean_rad * random.standard_normal((count, 1, 2))
    lifted[..., :3] += spread.base_alike_mm * random.standard_normal((count, 1, 3))
    offsets = spread.stacking_mm * random.standard_normal((len(made) + 2, count, 3))
    pose = stack_pose(lifted, dimensions)
    beneath = plate_poses(lifted, dimensions).rotation
    moved = pose.position_mm + offsets[0] + offsets[1]
    for i in range(len(made)):
        moved = moved + np.einsum("nij,nj->ni", beneath[:, i], offsets[i + 2])
    return StackPose(moved, pose.rotation)


def _made(
    point: Floats,
    dimensions: PlatformDimensions,
    spread: ManufacturingSpread,
    alike: dict[str, Floats],
    random: np.random.Generator,
) -> Floats:
    """Set points (count, 6) that platforms of that spread make when told this one."""
    count = len(alike["gain"])

    def around(values: Floats, deviation: float) -> Floats:
        return values + deviation * random.standard_normal((count, *values.shape))

    settings = spread.servo_rad**2 * np.kron(np.eye(LEGS // 2), _pair(spread.pair_correlation))
    zeros = random.multivariate_normal(np.zeros(LEGS), settings + spread.slop_rad**2 * np.eye(LEGS), count)
    real = replace(
        dimensions,
        base_joints_mm=around(dimensions.base_joints_mm, spread.joint_mm),
        plate_joints_mm=around(dimensions.plate_joints_mm, spread.joint_mm),
        arm_mm=around(dimensions.arm_mm, spread.arm_mm) + alike["arm"],
        rod_mm=around(dimensions.rod_mm, spread.rod_mm),
    )
    gain = alike["gain"] + spread.gain * random.standard_normal((count, LEGS))
    return plate_pose(gain * servo_angles_rad(point, dimensions) + zeros, real, point).set_point


def _pair(correlation: float) -> Floats:
    return np.array([[1.0, correlation], [correlation, 1.0]])
