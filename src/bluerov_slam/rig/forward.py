"""The set point that given servo angles make: Newton on all six legs, in plain sums for one pose, in arrays for many.

Six rods, six unknowns: no Gauss-Newton step differs from Newton's. Servo angles have several assemblies; the one wanted
is that which the platform reaches from where it stands without taking it apart. Newton from there finds it at once or
fails; then the servos are turned to their angles in small steps, each solved from the one before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, isfinite, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import LEGS
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.platform import condition, servo_angles_rad

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, Leg, PlatformDimensions

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

TOLERANCE_MM = 1e-11
_CHUNK = 2048
_ITERATIONS = 12
_SMALL_STEPS = 24
_HOME = np.zeros(LEGS)
_LARGEST_STEP = (20.0, 20.0, 20.0, 0.4, 0.4, 0.4)
"""A Newton step beyond this (mm, rad) leaves the neighbourhood where its derivative means anything."""


@dataclass(frozen=True, slots=True)
class PlatePose:
    """What servo angles make.

    Attributes:
        set_point: (..., 6); NaN where no assembly was found.
        residual_mm: largest distance of a rod's length from what the joints leave it, (...).
        condition: number of the legs' derivative, rotations in mm at the plate's joints, (...).
        converged: (...).
    """

    set_point: Floats
    residual_mm: Floats
    condition: Floats
    converged: Mask


def plate_pose(servo_angles: Floats, dimensions: PlatformDimensions, start: Floats | None = None) -> PlatePose:
    """The set points of servo angles (..., 6) rad, found from set points `start` (..., 6) or from home."""
    angles = np.asarray(servo_angles, dtype=np.float64)
    angles = np.where(np.isfinite(angles), angles, np.nan)
    begin = _HOME if start is None else np.asarray(start, dtype=np.float64)
    if dimensions.legs and angles.ndim == begin.ndim == 1:
        found = _newton_of_one(angles.tolist(), begin.tolist(), dimensions)
        if found is not None:
            return found
    shape = np.broadcast_shapes(angles.shape, begin.shape, (*_lead(dimensions), LEGS))[:-1]
    flat = np.broadcast_to(angles, (*shape, LEGS)).reshape(-1, LEGS)
    points = np.broadcast_to(begin, (*shape, LEGS)).reshape(-1, LEGS).copy()
    worst, number = np.empty(len(points)), np.empty(len(points))
    for first in range(0, len(points), _CHUNK):
        some = slice(first, first + _CHUNK)
        worst[some], number[some] = _poses_of_many(flat[some], points[some], _rows(dimensions, some))
    converged = worst <= TOLERANCE_MM
    return PlatePose(
        points.reshape(*shape, LEGS), worst.reshape(shape), number.reshape(shape), converged.reshape(shape)
    )


def _poses_of_many(angles: Floats, points: Floats, dimensions: PlatformDimensions) -> tuple[Floats, Floats]:
    """Improve the points (n, 6) in place; worst residuals and condition numbers (n,)."""
    begin = points.copy()
    worst = _newton(angles, points, dimensions)
    missed = worst > TOLERANCE_MM
    if np.any(missed):
        some = _rows(dimensions, missed)
        points[missed], worst[missed] = _by_small_steps(angles[missed], begin[missed], some)
    points[~(worst <= TOLERANCE_MM)] = np.nan
    return worst, condition(leg_lengths(points, angles, dimensions).by_set_point, dimensions)


def _newton_of_one(angles: list[float], point: list[float], dimensions: PlatformDimensions) -> PlatePose | None:
    """Newton in plain sums, where an array of one would cost ten times the time; None if it does not converge."""
    if not isfinite(sum(angles) + sum(point)):
        return None
    ends = [_arm_end_of_one(leg, angle) for leg, angle in zip(dimensions.legs, angles, strict=True)]
    for _ in range(_ITERATIONS):
        excess, rows = _legs_of_one(point, ends, dimensions)
        worst = max(map(abs, excess))
        matrix = np.array(rows)
        if worst <= TOLERANCE_MM:
            return PlatePose(np.array(point), np.array(worst), _condition_of_one(matrix, dimensions), np.array(True))
        try:
            step = np.linalg.solve(matrix, excess).tolist()
        except np.linalg.LinAlgError:
            return None
        share = 1.0 / max(1.0, *(abs(change) / largest for change, largest in zip(step, _LARGEST_STEP, strict=True)))
        point = [value - share * change for value, change in zip(point, step, strict=True)]
    return None


def _arm_end_of_one(leg: Leg, angle: float) -> tuple[float, float, float]:
    level = leg.arm_mm * cos(angle)
    return leg.base_x + level * leg.forward_x, leg.base_y + level * leg.forward_y, leg.base_z - leg.arm_mm * sin(angle)


def _legs_of_one(
    point: list[float], ends: list[tuple[float, float, float]], dimensions: PlatformDimensions
) -> tuple[list[float], list[list[float]]]:
    """Excess of each leg's distance over its rod, and the derivative's rows, as `leg_lengths` has them."""
    x, y, z, roll, pitch, yaw = point
    sr, cr, sp, cp, sy, cy = sin(roll), cos(roll), sin(pitch), cos(pitch), sin(yaw), cos(yaw)
    xx, xy, xz = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    yx, yy, yz = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    zx, zy, zz = -sp, cp * sr, cp * cr
    z -= dimensions.home_height_mm
    excess, rows = [], []
    for leg, (end_x, end_y, end_z) in zip(dimensions.legs, ends, strict=True):
        px, py, pz = leg.plate_x, leg.plate_y, leg.plate_z
        vx = xx * px + xy * py + xz * pz
        vy = yx * px + yy * py + yz * pz
        vz = zx * px + zy * py + zz * pz
        nx, ny, nz = x + vx - end_x, y + vy - end_y, z + vz - end_z
        length = sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / length, ny / length, nz / length
        mx, my, mz = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
        excess.append(length - leg.rod_mm)
        rows.append([nx, ny, nz, xx * mx + yx * my + zx * mz, cy * my - sy * mx, mz])
    return excess, rows


def _condition_of_one(by_set_point: Floats, dimensions: PlatformDimensions) -> Floats:
    by_set_point[:, 3:] /= dimensions.plate_radius_mm
    values = np.linalg.svd(by_set_point, compute_uv=False)
    return np.asarray(values[0] / values[-1])


def _newton(angles: Floats, points: Floats, dimensions: PlatformDimensions) -> Floats:
    """Improve the points (n, 6) in place; their worst residuals (n,)."""
    worst = np.full(len(points), np.nan)
    open_ = np.all(np.isfinite(angles), axis=-1) & np.all(np.isfinite(points), axis=-1)
    for _ in range(_ITERATIONS):
        legs = leg_lengths(points[open_], angles[open_], _rows(dimensions, open_))
        worst[open_] = np.max(np.abs(legs.excess_mm), axis=-1)
        rest = worst[open_] > TOLERANCE_MM
        open_[open_] = rest
        if not np.any(rest):
            break
        points[open_] -= _step(legs.by_set_point[rest], legs.excess_mm[rest])
    return worst


def _step(by_set_point: Floats, excess_mm: Floats) -> Floats:
    regular = np.abs(np.linalg.det(by_set_point)) > 0.0
    matrices = np.where(regular[:, None, None], by_set_point, np.eye(LEGS))
    step = np.linalg.solve(matrices, excess_mm[..., None])[..., 0]
    too_far = np.max(np.abs(step) / _LARGEST_STEP, axis=-1, keepdims=True)
    return np.asarray(step / np.maximum(too_far, 1.0))


def _by_small_steps(angles: Floats, begin: Floats, dimensions: PlatformDimensions) -> tuple[Floats, Floats]:
    at_begin = servo_angles_rad(begin, dimensions)
    points = begin.copy()
    worst = np.full(len(points), np.nan)
    for share in np.linspace(0.0, 1.0, _SMALL_STEPS + 1)[1:]:
        worst = _newton(at_begin + share * (angles - at_begin), points, dimensions)
    return points, worst


def _lead(dimensions: PlatformDimensions) -> tuple[int, ...]:
    return np.broadcast_shapes(
        dimensions.base_joints_mm.shape[:-2], dimensions.plate_joints_mm.shape[:-2],
        dimensions.arm_bearings_rad.shape[:-1], dimensions.arm_mm.shape[:-1], dimensions.rod_mm.shape[:-1],
    )  # fmt: skip


def _rows(dimensions: PlatformDimensions, rows: slice | Mask) -> PlatformDimensions:
    """Of a batch of platforms (n, ...) some; one platform as it is."""
    if not dimensions.batched:
        return dimensions
    axes = {"base_joints_mm": 2, "plate_joints_mm": 2, "arm_bearings_rad": 1, "arm_mm": 1, "rod_mm": 1}
    values = {name: getattr(dimensions, name) for name in axes}
    return replace(dimensions, **{k: v[rows] if v.ndim > axes[k] else v for k, v in values.items()})
