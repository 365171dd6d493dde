"""Unit quaternions (w, x, y, z) as plain floats: what an inner loop needs, without arrays.

`quaternion_ned_frd` turns a body vector into NED: v_ned = q v_frd q*. Angles are Z-Y-X: yaw, then pitch, then roll.
"""

from __future__ import annotations

import math

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product: first b, then a."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation."""
    return q[0], -q[1], -q[2], -q[3]


def normalised(q: Quaternion) -> Quaternion:
    """The same rotation with length 1."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] / length, q[1] / length, q[2] / length, q[3] / length


def rotate(q: Quaternion, v: Vector) -> Vector:
    """q v q*, by v + 2 w (u x v) + 2 u x (u x v)."""
    w, x, y, z = q
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Quaternion of roll, pitch and yaw."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def to_euler(q: Quaternion) -> Vector:
    """(roll, pitch, yaw), rad; at a pitch of +-90 degrees the split between roll and yaw is arbitrary."""
    w, x, y, z = q
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def turned(q: Quaternion, rotation_frd_rad: Vector) -> Quaternion:
    """q followed by a rotation about body axes: exact for any angle."""
    rx, ry, rz = rotation_frd_rad
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    k = 0.5 - angle * angle / 48.0 if angle < 1e-3 else math.sin(0.5 * angle) / angle
    return normalised(multiply(q, (math.cos(0.5 * angle), k * rx, k * ry, k * rz)))


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """The rotation from a to b, rad, 0..pi."""
    _, x, y, z = difference = multiply(conjugate(a), b)
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(difference[0]))
