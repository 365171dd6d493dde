"""The set point that given servo angles make: Newton on all six legs, in plain sums for one pose, in arrays for many.

Six rods, six unknowns: no Gauss-Newton step differs from Newton's. Servo angles have several assemblies; the one wanted
is that which the platform reaches from where it stands without taking it apart. Newton from there finds it at once or
fails; then the servos are turned to their angles in small steps, each solved from the one before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import LEGS
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.platform import condition, servo_angles_rad

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, PlatformDimensions

TOLERANCE_MM = 1e-11
_ITERATIONS = 12
_SMALL_STEPS = 24
_LARGEST_STEP = np.array([20.0, 20.0, 20.0, 0.4, 0.4, 0.4])
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
    converged: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def plate_pose(servo_angles: Floats, dimensions: PlatformDimensions, start: Floats | None = None) -> PlatePose:
    """The set points of servo angles (..., 6) rad, found from set points `start` (..., 6) or from home."""
    angles = np.asarray(servo_angles, dtype=np.float64)
    begin = np.zeros(LEGS) if start is None else np.asarray(start, dtype=np.float64)
    shape = np.broadcast_shapes(angles.shape, begin.shape, (*_lead(dimensions), LEGS))[:-1]
    flat = np.broadcast_to(angles, (*shape, LEGS)).reshape(-1, LEGS)
    points = np.broadcast_to(begin, (*shape, LEGS)).reshape(-1, LEGS).copy()
    begin = points.copy()
    worst = _newton(flat, points, dimensions)
    missed = ~(worst <= TOLERANCE_MM)
    if np.any(missed):
        some = _rows(dimensions, missed)
        points[missed], worst[missed] = _by_small_steps(flat[missed], begin[missed], some)
    converged = worst <= TOLERANCE_MM
    points[~converged] = np.nan
    found = condition(leg_lengths(points, flat, dimensions).by_set_point, dimensions)
    return PlatePose(points.reshape(*shape, LEGS), worst.reshape(shape), found.reshape(shape), converged.reshape(shape))


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


def _rows(dimensions: PlatformDimensions, rows: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> PlatformDimensions:
    """Of a batch of platforms (n, ...) some; one platform as it is."""
    if not dimensions.batched or np.all(rows):
        return dimensions
    axes = {"base_joints_mm": 2, "plate_joints_mm": 2, "arm_bearings_rad": 1, "arm_mm": 1, "rod_mm": 1}
    values = {name: getattr(dimensions, name) for name in axes}
    return replace(dimensions, **{k: v[rows] if v.ndim > axes[k] else v for k, v in values.items()})
