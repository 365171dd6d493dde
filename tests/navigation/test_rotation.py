"""Rotations against their definitions, against each other, and where formulas lose digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.rotation import (
    cross,
    euler_from_rotation,
    exp_so3,
    left_jacobian,
    left_jacobian_inverse,
    log_so3,
    normalised,
    polynomial_of_skew,
    quaternion_from_rotation,
    right_jacobian,
    right_jacobian_inverse,
    rotation_from_euler,
    rotation_from_quaternion,
    skew,
    wrap_angle,
)

directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 1e-3)
angles = st.one_of(
    st.floats(0.0, math.pi - 1e-9),
    st.sampled_from([0.0, 1e-12, 1e-8, 1e-5, 0.0999, 0.1001, 3.13, math.pi - 1e-4, math.pi - 1e-7, math.pi - 1e-12]),
)


def vector_of(direction: tuple[float, float, float], angle: float) -> np.ndarray:
    return np.array(direction) / math.hypot(*direction) * angle


def power_series_exp(vector: np.ndarray) -> np.ndarray:
    total, term = np.eye(3), np.eye(3)
    for n in range(1, 60):
        term = term @ skew(vector) / n
        total = total + term
    return total


@given(directions, angles)
def test_exp_is_the_matrix_exponential_and_log_undoes_it(direction, angle):
    vector = vector_of(direction, angle)
    rotation = exp_so3(vector)
    np.testing.assert_allclose(rotation, power_series_exp(vector), atol=1e-13)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(log_so3(rotation), vector, atol=1e-12)


def test_log_of_half_a_turn_is_half_a_turn():
    for axis in np.eye(3):
        found = log_so3(2.0 * np.outer(axis, axis) - np.eye(3))
        assert np.linalg.norm(found) == pytest.approx(math.pi, abs=1e-15)
        np.testing.assert_allclose(np.abs(found), math.pi * axis, atol=1e-15)


def test_log_keeps_the_digits_of_a_tiny_rotation():
    vector = np.array([3e-11, -4e-11, 1e-12])
    np.testing.assert_allclose(log_so3(exp_so3(vector)), vector, rtol=1e-6)


@given(directions, st.one_of(st.floats(0.0, 6.0), st.sampled_from([0.0, 1e-9, 0.0999999, 0.1000001])))
def test_jacobians_are_the_derivatives_of_exp(direction, angle):
    vector, step = vector_of(direction, angle), 1e-6
    left, right = np.zeros((3, 3)), np.zeros((3, 3))
    for axis in range(3):
        ahead, behind = vector.copy(), vector.copy()
        ahead[axis] += step
        behind[axis] -= step
        turn = exp_so3(ahead) @ exp_so3(behind).T
        left[:, axis] = log_so3(turn) / (2 * step)
        right[:, axis] = log_so3(exp_so3(behind).T @ exp_so3(ahead)) / (2 * step)
    np.testing.assert_allclose(left_jacobian(vector), left, atol=1e-8)
    np.testing.assert_allclose(right_jacobian(vector), right, atol=1e-8)
    np.testing.assert_allclose(left_jacobian_inverse(vector) @ left_jacobian(vector), np.eye(3), atol=1e-10)
    np.testing.assert_allclose(right_jacobian_inverse(vector) @ right_jacobian(vector), np.eye(3), atol=1e-10)


def test_polynomial_of_skew_is_one():
    x, y, z = 0.3, -1.2, 0.7
    s = skew((x, y, z))
    np.testing.assert_allclose(polynomial_of_skew(x, y, z, 2.0, -0.5, 0.25), 2 * np.eye(3) - 0.5 * s + 0.25 * s @ s)
    np.testing.assert_allclose(s @ [1.0, 2.0, 3.0], np.cross([x, y, z], [1.0, 2.0, 3.0]))
    np.testing.assert_allclose(cross((x, y, z), np.array([1.0, 2.0, 3.0])), s @ [1.0, 2.0, 3.0])


@given(directions, angles)
def test_quaternion_and_back(direction, angle):
    rotation = exp_so3(vector_of(direction, angle))
    quaternion = quaternion_from_rotation(rotation)
    assert quaternion[0] >= 0.0
    assert math.hypot(*quaternion) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation, atol=1e-14)
    np.testing.assert_allclose(rotation_from_quaternion([-3.0 * q for q in quaternion]), rotation, atol=1e-14)


def test_quaternion_of_known_turns():
    half = math.sqrt(0.5)
    assert quaternion_from_rotation(rotation_from_euler(0, 0, math.pi / 2)) == pytest.approx((half, 0, 0, half))
    assert quaternion_from_rotation(rotation_from_euler(math.pi, 0, 0)) == pytest.approx((0, 1, 0, 0))
    assert quaternion_from_rotation(rotation_from_euler(0, math.pi / 2, 0)) == pytest.approx((half, 0, half, 0))
    with pytest.raises(ValueError, match="length zero"):
        rotation_from_quaternion((0, 0, 0, 0))


@given(st.floats(-3.14, 3.14), st.floats(-1.57, 1.57), st.floats(-3.14, 3.14))
def test_euler_angles_and_back(roll, pitch, yaw):
    rotation = rotation_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(
        rotation, exp_so3((0, 0, yaw)) @ exp_so3((0, pitch, 0)) @ exp_so3((roll, 0, 0)), atol=1e-14
    )
    np.testing.assert_allclose(rotation_from_euler(*euler_from_rotation(rotation)), rotation, atol=1e-12)
    if abs(pitch) < 1.5:
        assert euler_from_rotation(rotation) == pytest.approx((roll, pitch, yaw), abs=1e-9)


def test_signs_of_the_euler_angles():
    """Heading east: the bow shows east. Bow up: pitch positive. Starboard side down: roll positive."""
    np.testing.assert_allclose(rotation_from_euler(0, 0, math.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    assert (rotation_from_euler(0, 0.1, 0) @ [1, 0, 0])[2] < 0.0
    assert (rotation_from_euler(0.1, 0, 0) @ [0, 1, 0])[2] > 0.0


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_straight_up_or_down_has_some_euler_angles(pitch):
    rotation = rotation_from_euler(0.4, pitch, 1.1)
    roll, found, yaw = euler_from_rotation(rotation)
    assert roll == 0.0
    np.testing.assert_allclose(rotation_from_euler(roll, found, yaw), rotation, atol=1e-9)


def test_normalised_takes_out_rounding():
    rotation = exp_so3((0.3, 0.2, -0.9))
    worn = rotation + 1e-6 * np.arange(9.0).reshape(3, 3)
    np.testing.assert_allclose(normalised(worn) @ normalised(worn).T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(normalised(rotation), rotation, atol=1e-15)


def test_wrap_angle():
    assert wrap_angle(math.pi) == -math.pi
    assert wrap_angle(-math.pi) == -math.pi
    assert wrap_angle(7.0) == pytest.approx(7.0 - math.tau)
