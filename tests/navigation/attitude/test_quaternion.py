"""Quaternions of plain floats against rotation matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.attitude.quaternion import (
    IDENTITY,
    angle_between,
    conjugate,
    from_euler,
    multiply,
    rotate,
    to_euler,
    turned,
)

angle = st.floats(-math.pi, math.pi)
pitch = st.floats(-1.5, 1.5)


def matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


@given(angle, pitch, angle)
def test_angles_make_the_same_rotation_as_three_matrices(roll: float, pitch: float, yaw: float) -> None:
    q, v = from_euler(roll, pitch, yaw), (0.3, -1.2, 2.0)
    assert rotate(q, v) == pytest.approx(matrix(roll, pitch, yaw) @ v, abs=1e-12)
    assert rotate(conjugate(q), v) == pytest.approx(matrix(roll, pitch, yaw).T @ v, abs=1e-12)


@given(angle, pitch, angle)
def test_angles_come_back(roll: float, pitch: float, yaw: float) -> None:
    back = to_euler(from_euler(roll, pitch, yaw))
    # Through a rotation: -pi and pi are the same angle.
    assert angle_between(from_euler(*back), from_euler(roll, pitch, yaw)) < 1e-7


def test_a_nose_straight_up_is_no_error() -> None:
    roll, pitch, yaw = to_euler(from_euler(0.2, math.pi / 2.0, 0.5))
    assert pitch == pytest.approx(math.pi / 2.0, abs=1e-7)
    assert math.isfinite(roll + yaw)


@given(st.tuples(angle, angle, angle))
def test_a_turn_about_body_axes_has_its_angle(rotation: tuple[float, float, float]) -> None:
    start = from_euler(0.4, -0.3, 2.0)
    length = math.sqrt(sum(r * r for r in rotation))
    expected = min(length % (2 * math.pi), 2 * math.pi - length % (2 * math.pi))
    assert angle_between(start, turned(start, rotation)) == pytest.approx(expected, abs=1e-7)


def test_turning_goes_the_right_way() -> None:
    assert to_euler(turned(IDENTITY, (0.0, 0.0, 0.3)))[2] == pytest.approx(0.3)
    assert turned(IDENTITY, (1e-9, 0.0, 0.0)) == pytest.approx((1.0, 5e-10, 0.0, 0.0), abs=1e-15)
    q = multiply(from_euler(0.0, 0.0, 1.0), from_euler(0.2, 0.0, 0.0))
    assert to_euler(q) == pytest.approx((0.2, 0.0, 1.0))
