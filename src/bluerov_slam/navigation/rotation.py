"""Rotations in three dimensions: matrices, rotation vectors, quaternions (w, x, y, z) and Euler angles.

A rotation is a 3 x 3 matrix named destination first: `v_ned = rotation_ned_frd @ v_frd`. Angles are radians. Everything
here works on single small arrays with plain float arithmetic, which for 3 x 3 is several times faster than array
operations; that is what a filter step is made of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = Array | Sequence[float]

SERIES_BELOW_RAD = 0.1
"""Below this angle (1 - cos a) / a^2 and its kin lose digits to cancellation: their series is used instead."""

NEAR_PI_RAD = 1e-2
"""Closer than this to half a turn the antisymmetric part of a rotation no longer holds its axis."""


def wrap_angle(angle_rad: float) -> float:
    """The same direction in [-pi, pi)."""
    return (angle_rad + math.pi) % math.tau - math.pi


def skew(vector: Vector) -> Array:
    """The matrix of the cross product: `skew(a) @ b == cross(a, b)`."""
    x, y, z = _three(vector)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Vector, b: Vector) -> Array:
    """The cross product; ten times as fast as NumPy's for two vectors."""
    ax, ay, az = _three(a)
    bx, by, bz = _three(b)
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def exp_so3(rotation_vector_rad: Vector) -> Array:
    """The rotation by |v| about v."""
    x, y, z = _three(rotation_vector_rad)
    a, b, _, _ = integral_coefficients(x * x + y * y + z * z)
    return polynomial_of_skew(x, y, z, 1.0, a, b)


def log_so3(rotation: Array) -> Array:
    """The rotation vector of a rotation matrix, of length at most pi; exact to rounding near 0 and near pi, too."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation.tolist()
    x, y, z = 0.5 * (r21 - r12), 0.5 * (r02 - r20), 0.5 * (r10 - r01)
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r00 + r11 + r22 - 1.0)
    angle = math.atan2(sine, cosine)
    if angle > math.pi - NEAR_PI_RAD:
        w, qx, qy, qz = quaternion_from_rotation(rotation)
        length = math.sqrt(qx * qx + qy * qy + qz * qz)
        factor = 2.0 * math.atan2(length, w) / length
        return np.array([factor * qx, factor * qy, factor * qz])
    factor = angle / sine if sine > 1e-9 else 1.0
    return np.array([factor * x, factor * y, factor * z])


def left_jacobian(rotation_vector_rad: Vector) -> Array:
    """J with Exp(v + d) = Exp(J d) Exp(v) to first order in d; also the mean of Exp(s v) over s in 0..1."""
    x, y, z = _three(rotation_vector_rad)
    _, a, b, _ = integral_coefficients(x * x + y * y + z * z)
    return polynomial_of_skew(x, y, z, 1.0, a, b)


def right_jacobian(rotation_vector_rad: Vector) -> Array:
    """J with Exp(v + d) = Exp(v) Exp(J d) to first order in d."""
    x, y, z = _three(rotation_vector_rad)
    return left_jacobian((-x, -y, -z))


def left_jacobian_inverse(rotation_vector_rad: Vector) -> Array:
    """J with Log(Exp(d) Exp(v)) = v + J d to first order in d; for angles below 2 pi."""
    x, y, z = _three(rotation_vector_rad)
    square = x * x + y * y + z * z
    if square < SERIES_BELOW_RAD * SERIES_BELOW_RAD:
        b = 1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1209600.0))
    else:
        angle = math.sqrt(square)
        b = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / square
    return polynomial_of_skew(x, y, z, 1.0, -0.5, b)


def right_jacobian_inverse(rotation_vector_rad: Vector) -> Array:
    """J with Log(Exp(v) Exp(d)) = v + J d to first order in d; for angles below 2 pi."""
    x, y, z = _three(rotation_vector_rad)
    return left_jacobian_inverse((-x, -y, -z))


def integral_coefficients(square: float) -> tuple[float, float, float, float]:
    """sin(a)/a, (1 - cos a)/a^2, (a - sin a)/a^3 and (a^2/2 + cos a - 1)/a^4 for the square of the angle a.

    With S = skew(v): Exp = 1 + c0 S + c1 S^2; its integral over 0..1 is 1 + c1 S + c2 S^2; the integral of that is
    1/2 + c2 S + c3 S^2.
    """
    if square < SERIES_BELOW_RAD * SERIES_BELOW_RAD:
        q = square
        return (
            1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0))),
            0.5 - q / 24.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))),
            1.0 / 6.0 - q / 120.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0))),
            1.0 / 24.0 - q / 720.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0 * (1.0 - q / 132.0))),
        )
    angle = math.sqrt(square)
    sine, half_sine = math.sin(angle), math.sin(0.5 * angle)
    one_minus_cosine = 2.0 * half_sine * half_sine
    return (
        sine / angle,
        one_minus_cosine / square,
        (angle - sine) / (square * angle),
        (0.5 * square - one_minus_cosine) / (square * square),
    )


def polynomial_of_skew(x: float, y: float, z: float, c0: float, c1: float, c2: float) -> Array:
    """c0 + c1 S + c2 S^2 for S = skew((x, y, z))."""
    xx, yy, zz = c2 * x * x, c2 * y * y, c2 * z * z
    xy, xz, yz = c2 * x * y, c2 * x * z, c2 * y * z
    sx, sy, sz = c1 * x, c1 * y, c1 * z
    return np.array(
        [
            [c0 - yy - zz, xy - sz, xz + sy],
            [xy + sz, c0 - xx - zz, yz - sx],
            [xz - sy, yz + sx, c0 - xx - yy],
        ]
    )


def normalised(rotation: Array) -> Array:
    """The rotation again, with the rounding of many products taken out (one Newton step towards orthogonality)."""
    step: Array = 1.5 * rotation - 0.5 * (rotation @ (rotation.T @ rotation))
    return step


def quaternion_from_rotation(rotation: Array) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z) with w >= 0."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation.tolist()
    # Of four equivalent formulas the one that divides by the largest component.
    if r22 < 0.0:
        if r00 > r11:
            t, q = 1.0 + r00 - r11 - r22, [r21 - r12, 0.0, r10 + r01, r02 + r20]
            q[1] = t
        else:
            t, q = 1.0 - r00 + r11 - r22, [r02 - r20, r10 + r01, 0.0, r21 + r12]
            q[2] = t
    elif r00 < -r11:
        t, q = 1.0 - r00 - r11 + r22, [r10 - r01, r02 + r20, r21 + r12, 0.0]
        q[3] = t
    else:
        t, q = 1.0 + r00 + r11 + r22, [0.0, r21 - r12, r02 - r20, r10 - r01]
        q[0] = t
    scale = 1.0 / math.sqrt(sum(value * value for value in q))
    if q[0] < 0.0:
        scale = -scale
    return (q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale)


def rotation_from_quaternion(quaternion_wxyz: Vector) -> Array:
    """The rotation of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = (float(value) for value in quaternion_wxyz)
    square = w * w + x * x + y * y + z * z
    if not square > 0.0:
        raise ValueError("a quaternion of length zero is no rotation")
    s = 2.0 / square
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )


def rotation_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """`rotation_ned_frd` of a heading `yaw_rad`, then pitch (bow up positive), then roll (starboard down positive)."""
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    sp, cp = math.sin(pitch_rad), math.cos(pitch_rad)
    sy, cy = math.sin(yaw_rad), math.cos(yaw_rad)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def euler_from_rotation(rotation_ned_frd: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw; pitch in [-pi/2, pi/2]. With the bow straight up or down roll is 0 and yaw takes it all."""
    (r00, r01, _), (r10, r11, _), (r20, r21, r22) = rotation_ned_frd.tolist()
    level = math.hypot(r00, r10)
    pitch = math.atan2(-r20, level)
    if level < 1e-9:
        return 0.0, pitch, math.atan2(-r01, r11)
    return math.atan2(r21, r22), pitch, math.atan2(r10, r00)


def _three(vector: Vector) -> tuple[float, float, float]:
    x, y, z = vector.tolist() if isinstance(vector, np.ndarray) else vector
    return x, y, z
