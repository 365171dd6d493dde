"""Attitude from the first few samples: gravity says down, the field says north.

The thesis waited 48 s for its filter to settle; five samples give the same at once, with an error that can be stated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude.quaternion import Quaternion, from_euler, multiply
from bluerov_slam.navigation.rotation import quaternion_from_rotation

STANDARD_GRAVITY_MPS2 = 9.80665
# More than this off one g on average: the vehicle is being thrown about, or the accelerometer is not one.
_GRAVITY_TOLERANCE = 0.1
# A field steeper than this has too little horizontal part for a heading.
_STEEPEST_FIELD_RAD = math.radians(86.0)


@dataclass(frozen=True, slots=True)
class InitialAttitude:
    """One-sigma errors: tilt about each horizontal axis, heading about the vertical.

    Without a usable field the heading is unknown: `heading_std_rad` is None and the quaternion has yaw 0.
    """

    quaternion_ned_frd: Quaternion
    tilt_std_rad: float
    heading_std_rad: float | None


def initial_attitude(
    specific_force_mps2: NDArray[np.float64],
    magnetic_field: NDArray[np.float64] | None,
    declination_rad: float = 0.0,
    accelerometer_bias_std_mps2: float = 0.05,
    field_error: float = 0.05,
) -> InitialAttitude | None:
    """Attitude from (n, 3) samples, averaged; body FRD, towards true north. None where gravity cannot be made out.

    `accelerometer_bias_std_mps2` and `field_error` (share of the field's length) are what averaging does not take away:
    0.05 m/s2 is 0.3 degrees of tilt, 5 % of the field about 3 to 8 degrees of heading, by its dip.
    """
    forces = specific_force_mps2[np.isfinite(specific_force_mps2).all(axis=1)]
    if len(forces) == 0:
        return None
    force = forces.mean(axis=0)
    length = float(np.linalg.norm(force))
    if abs(length / STANDARD_GRAVITY_MPS2 - 1.0) > _GRAVITY_TOLERANCE:
        return None
    scatter = float(np.sqrt(forces.var(axis=0).sum() / (2.0 * len(forces))))
    tilt_std_rad = math.hypot(scatter, accelerometer_bias_std_mps2) / length
    down = -force / length
    field = _mean_field(magnetic_field)
    if field is not None:
        field_down = float(field @ down)
        horizontal = math.sqrt(max(0.0, 1.0 - field_down * field_down))
        if horizontal > math.cos(_STEEPEST_FIELD_RAD):
            # A tilt error turns the steep part of the field into heading.
            heading_std_rad = math.hypot(field_error / horizontal, tilt_std_rad * abs(field_down) / horizontal)
            east = np.cross(down, field) / horizontal
            half = 0.5 * declination_rad
            to_true = (math.cos(half), 0.0, 0.0, math.sin(half))
            attitude = multiply(to_true, quaternion_from_rotation(np.stack([np.cross(east, down), east, down])))
            return InitialAttitude(attitude, tilt_std_rad, heading_std_rad)
    roll, pitch = math.atan2(down[1], down[2]), math.asin(max(-1.0, min(1.0, -float(down[0]))))
    return InitialAttitude(from_euler(roll, pitch, 0.0), tilt_std_rad, None)


def quest(
    directions_frd: Sequence[Sequence[float]], directions_ned: Sequence[Sequence[float]], weights: Sequence[float]
) -> Quaternion:
    """The attitude that fits two or more pairs of directions best (Wahba's problem, Davenport's q method).

    Source: Markley and Mortari (2000), Quaternion attitude estimation using vector observations. Unlike
    gravity-first above, it spreads a disagreement over all directions by their weights.
    """
    profile = np.einsum("i,ij,ik->jk", np.asarray(weights, float), _units(directions_ned), _units(directions_frd))
    z = np.array([profile[2, 1] - profile[1, 2], profile[0, 2] - profile[2, 0], profile[1, 0] - profile[0, 1]])
    davenport = np.empty((4, 4))
    davenport[0, 0] = np.trace(profile)
    davenport[0, 1:] = davenport[1:, 0] = z
    davenport[1:, 1:] = profile + profile.T - np.trace(profile) * np.eye(3)
    _, vectors = np.linalg.eigh(davenport)
    w, x, y, z_ = (float(value) for value in vectors[:, -1] * math.copysign(1.0, vectors[0, -1]))
    return w, x, y, z_


def _units(vectors: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    array = np.asarray(vectors, float)
    units: NDArray[np.float64] = array / np.linalg.norm(array, axis=1, keepdims=True)
    return units


def _mean_field(magnetic_field: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    if magnetic_field is None:
        return None
    fields = magnetic_field[np.isfinite(magnetic_field).all(axis=1)]
    if len(fields) == 0:
        return None
    mean = fields.mean(axis=0)
    length = float(np.linalg.norm(mean))
    unit: NDArray[np.float64] | None = mean / length if length > 0.0 else None
    return unit
