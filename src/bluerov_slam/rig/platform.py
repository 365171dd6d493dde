"""One hexapod platform with rotary servos: servo angles of a set point, the set point of servo angles, derivatives.

Leg i joins the end of a servo's arm to a ball joint of the plate by a rod of fixed length. With B the servo's axis, P
the joint in the plate, q = home + translation + R P - B, a = q along the level arm and c = q upwards, the arm's end at
the angle theta satisfies |q - arm| = rod where

    a cos(theta) + c sin(theta) = K / (2 arm),  K = arm^2 + |q|^2 - rod^2
    theta = atan2(c, a) -+ acos(K / h),         h = 2 arm sqrt(a^2 + c^2)

Minus is the branch "down" of the thesis. The two angles are one: with r = sqrt(h^2 - K^2),

    theta = atan2(c K -+ a r, a K +- c r),

a single arc tangent that loses nothing where the arm and the rod are nearly in line. No root: out of reach, NaN.

Frame, units and set points: docs/rig.md. Source: thesis section 2.5.5, with equations 2.1, 2.2 (lengths exchanged) and
2.5 put right. Check (FO_SHIP_PLATFORM): 23.0 deg of all servos at home, 0.4 deg at z = +10 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, isfinite, nan, sin, sqrt
from typing import TYPE_CHECKING, Literal

import numpy as np

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.rig.dimensions import LEGS
from bluerov_slam.rig.leg_lengths import leg_lengths

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bluerov_slam.rig.dimensions import Floats, Leg, PlatformDimensions

Branch = Literal["down", "up"]

FEW = 16
"""Up to so many platforms plain sums are faster than NumPy."""
_CHUNK = 2048
"""Platforms calculated at a time: their arrays stay in the processor's cache."""


def servo_angles_rad(set_points: Floats, dimensions: PlatformDimensions, branch: Branch = "down") -> Floats:
    """Servo angles (..., 6), -pi..pi from the horizontal, up is positive; NaN for a leg that cannot reach."""
    points = np.asarray(set_points, dtype=np.float64)
    side = _side(branch)
    if dimensions.legs and points.size <= LEGS * FEW:
        legs, home = dimensions.legs, dimensions.home_height_mm
        if points.ndim == 1:
            return np.array(_angles_of_one(points.tolist(), legs, home, side))
        rows = [_angles_of_one(point, legs, home, side) for point in points.reshape(-1, 6).tolist()]
        return np.array(rows).reshape(points.shape)
    with np.errstate(invalid="ignore"):  # a root of less than nothing is NaN: out of reach
        if dimensions.batched:
            return _angles_of_unequal(points, dimensions, side)
        flat = points.reshape(-1, 6)
        found = np.empty_like(flat)
        for begin in range(0, len(flat), _CHUNK):
            found[begin : begin + _CHUNK] = _angles_of_many(flat[begin : begin + _CHUNK], dimensions, side)
        return found.reshape(points.shape)


def published_servo_angles_rad(set_points: Floats, dimensions: PlatformDimensions) -> Floats:
    """The same angles (..., 6), branch "down", by the thesis's quadratic in t = tan(theta / 2).

    (K + 2 a L) t^2 - 4 c L t + (K - 2 a L) = 0 of equation 2.11, with L the arm and R the rod (its equations 2.1 and
    2.2 exchange them) and t = z / (L + x) (its 2.5 has z / 2x). Not for use: where K + 2 a L passes zero, an arm at
    half a turn, it divides by nothing.
    """
    q = _joints_from_axes_mm(np.asarray(set_points, dtype=np.float64), dimensions)
    a, c = _in_arm_plane(q, dimensions)
    arm, rod = dimensions.arm_mm, dimensions.rod_mm
    k = arm**2 + np.sum(q**2, axis=-1) - rod**2
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (2.0 * c * arm - np.sqrt(4.0 * arm**2 * (a**2 + c**2) - k**2)) / (k + 2.0 * a * arm)
    return np.asarray(2.0 * np.arctan(t))


@dataclass(frozen=True, slots=True)
class Joints:
    """Where the joints of a platform are, mm, frame of the platform, each (..., 6, 3)."""

    base_mm: Floats
    arm_ends_mm: Floats
    plate_mm: Floats


def joints_mm(set_points: Floats, dimensions: PlatformDimensions, branch: Branch = "down") -> Joints:
    """Base joints, ends of the arms and plate joints at set points (..., 6); arm ends are NaN where out of reach."""
    points = np.asarray(set_points, dtype=np.float64)
    base = np.broadcast_to(dimensions.base_joints_mm, (*points.shape[:-1], LEGS, 3))
    arms = arm_vectors_mm(servo_angles_rad(points, dimensions, branch), dimensions)
    return Joints(base, base + arms, base + _joints_from_axes_mm(points, dimensions))


def arm_vectors_mm(angles_rad: Floats, dimensions: PlatformDimensions) -> Floats:
    """From each servo's axis to the end of its arm, (..., 6, 3)."""
    level = dimensions.arm_mm * np.cos(angles_rad)
    bearing = dimensions.arm_bearings_rad
    down = -dimensions.arm_mm * np.sin(angles_rad)
    return np.stack([level * np.cos(bearing), level * np.sin(bearing), down], axis=-1)


def servo_jacobian(set_points: Floats, dimensions: PlatformDimensions, branch: Branch = "down") -> Floats:
    """Derivative of the servo angles by the set point, (..., 6 servos, 6), rad per mm and per rad."""
    points = np.asarray(set_points, dtype=np.float64)
    found = leg_lengths(points, servo_angles_rad(points, dimensions, branch), dimensions)
    return found.by_set_point / found.by_servo_mm[..., None]


def pose_jacobian(set_points: Floats, dimensions: PlatformDimensions, branch: Branch = "down") -> Floats:
    """Derivative of the set point by the servo angles, (..., 6, 6 servos), mm and rad per rad; NaN out of reach."""
    points = np.asarray(set_points, dtype=np.float64)
    found = leg_lengths(points, servo_angles_rad(points, dimensions, branch), dimensions)
    return inverse(found.by_set_point) * found.by_servo_mm[..., None, :]


def condition(by_set_point: Floats, dimensions: PlatformDimensions) -> Floats:
    """Condition number (...) of the legs' derivative (..., 6, 6), rotations counted in mm at the plate's joints."""
    scaled = by_set_point.copy()
    scaled[..., 3:] /= dimensions.plate_radius_mm[..., None, None]
    whole = np.all(np.isfinite(scaled), axis=(-2, -1))
    return np.where(whole, np.linalg.cond(np.where(whole[..., None, None], scaled, np.eye(LEGS))), np.nan)


def inverse(matrices: Floats) -> Floats:
    """Of matrices (..., n, n); NaN for those that hold a NaN or have none."""
    whole = np.all(np.isfinite(matrices), axis=(-2, -1))
    kept = np.where(whole[..., None, None], matrices, np.eye(matrices.shape[-1]))
    singular = np.linalg.det(kept) == 0.0
    kept = np.where(singular[..., None, None], np.eye(matrices.shape[-1]), kept)
    return np.where((whole & ~singular)[..., None, None], np.linalg.inv(kept), np.nan)


def _side(branch: Branch) -> float:
    return {"down": -1.0, "up": 1.0}[branch]


def _angles_of_one(point: Sequence[float], legs: Sequence[Leg], home_mm: float, side: float) -> list[float]:
    """Six angles of one set point in plain sums."""
    x, y, z, roll, pitch, yaw = point
    if not isfinite(x + y + z + roll + pitch + yaw):
        return [nan] * LEGS
    sr, cr, sp, cp, sy, cy = sin(roll), cos(roll), sin(pitch), cos(pitch), sin(yaw), cos(yaw)
    xx, xy, xz = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    yx, yy, yz = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    zx, zy, zz = -sp, cp * sr, cp * cr
    z -= home_mm
    angles = []
    for leg in legs:
        px, py, pz = leg.plate_x, leg.plate_y, leg.plate_z
        qx = x + xx * px + xy * py + xz * pz - leg.base_x
        qy = y + yx * px + yy * py + yz * pz - leg.base_y
        c = leg.base_z - z - zx * px - zy * py - zz * pz
        a = leg.forward_x * qx + leg.forward_y * qy
        arm, rod = leg.arm_mm, leg.rod_mm
        k = arm * arm + qx * qx + qy * qy + c * c - rod * rod
        square = 4.0 * arm * arm * (a * a + c * c) - k * k
        if square < 0.0:
            angles.append(nan)
            continue
        r = side * sqrt(square)
        angles.append(atan2(c * k + a * r, a * k - c * r))
    return angles


def _angles_of_many(points: Floats, dimensions: PlatformDimensions, side: float) -> Floats:
    """The same over set points (n, 6): one product with `to_arm_planes`, then sums over all legs at once."""
    ahead, across, up = (dimensions.to_arm_planes @ _pose_numbers(points)).reshape(3, LEGS, -1)
    arm, rod = dimensions.arm_mm[:, None], dimensions.rod_mm[:, None]
    square = ahead * ahead + up * up
    k = square + across * across
    k += arm * arm - rod * rod
    return _angle(ahead, up, k, 4.0 * arm * arm * square, side).T


def _angles_of_unequal(points: Floats, dimensions: PlatformDimensions, side: float) -> Floats:
    """The same for platforms that each have dimensions of their own."""
    q = _joints_from_axes_mm(points, dimensions)
    ahead, up = _in_arm_plane(q, dimensions)
    arm, rod = dimensions.arm_mm, dimensions.rod_mm
    k = arm * arm - rod * rod + np.sum(q * q, axis=-1)
    return _angle(ahead, up, k, 4.0 * arm * arm * (ahead * ahead + up * up), side)


def _angle(ahead: Floats, up: Floats, k: Floats, h_squared: Floats, side: float) -> Floats:
    root = side * np.sqrt(h_squared - k * k)
    return np.arctan2(up * k + ahead * root, ahead * k - up * root)


def _pose_numbers(points: Floats) -> Floats:
    """Of set points (n, 6) the thirteen numbers that `to_arm_planes` takes, (13, n)."""
    found = np.empty((13, len(points)))
    found[:9] = np.moveaxis(rotations(points[:, 3:]), 0, -1).reshape(9, -1)
    found[9:12] = points[:, :3].T
    found[12] = 1.0
    return found


def _joints_from_axes_mm(points: Floats, dimensions: PlatformDimensions) -> Floats:
    """From each servo's axis to the plate joint of its leg, (..., 6, 3)."""
    turned = np.einsum("...ij,...lj->...li", rotations(points[..., 3:]), dimensions.plate_joints_mm)
    home = np.array([0.0, 0.0, -dimensions.home_height_mm])
    return np.asarray(points[..., None, :3] + home + turned - dimensions.base_joints_mm)


def _in_arm_plane(q: Floats, dimensions: PlatformDimensions) -> tuple[Floats, Floats]:
    """Along the level arm and upwards."""
    bearing = dimensions.arm_bearings_rad
    return np.cos(bearing) * q[..., 0] + np.sin(bearing) * q[..., 1], -q[..., 2]
