"""Attitude from the first samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.attitude.initial import initial_attitude, quest
from bluerov_slam.navigation.attitude.quaternion import angle_between, from_euler, to_euler
from inertial_samples import FIELD_NED, samples_of

angle = st.floats(-math.pi, math.pi)


@given(angle, st.floats(-1.5, 1.5), angle)
def test_is_exact_without_noise_at_any_attitude(roll: float, pitch: float, yaw: float) -> None:
    samples = samples_of(lambda t: (roll, pitch, yaw), 0.05)
    found = initial_attitude(samples.force, samples.field)
    assert found is not None
    assert angle_between(found.quaternion_ned_frd, from_euler(roll, pitch, yaw)) < 1e-7
    assert found.heading_std_rad is not None


@given(angle, st.floats(-1.5, 1.5), angle)
def test_quest_agrees_where_the_directions_agree(roll: float, pitch: float, yaw: float) -> None:
    samples = samples_of(lambda t: (roll, pitch, yaw), 0.01)
    q = quest([samples.force[0], samples.field[0]], [(0.0, 0.0, -1.0), FIELD_NED], [1.0, 0.3])
    assert angle_between(q, from_euler(roll, pitch, yaw)) < 1e-7


def test_quest_spreads_a_disagreement_by_the_weights() -> None:
    down, north_off = (0.0, 0.0, 1.0), (math.cos(0.1), 0.0, math.sin(0.1))  # north seems 0.1 rad too low
    pitches = [
        to_euler(quest([down, north_off], [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)], [1.0, weight]))[1]
        for weight in (0.01, 1.0, 100.0)
    ]
    assert pitches == pytest.approx([0.001, 0.05, 0.099], abs=1e-3)


def test_says_how_wrong_it_may_be() -> None:
    random = np.random.default_rng(11)
    tilts, headings, stated = [], [], []
    for _ in range(300):
        yaw = random.uniform(-math.pi, math.pi)
        samples = samples_of(lambda t, yaw=yaw: (0.1, 0.05, yaw), 0.25, rate_hz=20.0)
        force = samples.force + random.normal(0.0, 0.05, 3) + random.normal(0.0, 0.02, samples.force.shape)
        field = samples.field + random.normal(0.0, 0.05, 3)
        found = initial_attitude(force, field)
        assert found is not None
        assert found.heading_std_rad is not None
        roll, pitch, estimated = to_euler(found.quaternion_ned_frd)
        tilts += [roll - 0.1, pitch - 0.05]
        headings.append(math.remainder(estimated - yaw, 2.0 * math.pi))
        stated.append((found.tilt_std_rad, found.heading_std_rad))
    tilt_std, heading_std = np.mean(stated, axis=0)
    assert float(np.std(tilts)) == pytest.approx(tilt_std, rel=0.2)
    assert float(np.std(headings)) == pytest.approx(heading_std, rel=0.2)


def test_puts_the_declination_on() -> None:
    samples = samples_of(lambda t: (0.2, -0.1, 0.6), 0.05)
    found = initial_attitude(samples.force, samples.field, declination_rad=0.05)
    assert found is not None
    assert to_euler(found.quaternion_ned_frd) == pytest.approx((0.2, -0.1, 0.65))


@pytest.mark.parametrize("field", [None, np.zeros((5, 3)), np.full((5, 3), np.nan), np.tile([0.01, 0.0, 1.0], (5, 1))])
def test_knows_no_heading_without_a_horizontal_field(field: np.ndarray | None) -> None:
    samples = samples_of(lambda t: (0.0, 0.0, 0.0), 0.05)
    found = initial_attitude(samples.force, field)
    assert found is not None
    assert found.heading_std_rad is None
    assert to_euler(found.quaternion_ned_frd) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_keeps_the_tilt_without_a_field() -> None:
    samples = samples_of(lambda t: (0.3, -0.2, 1.0), 0.05)
    found = initial_attitude(samples.force, None)
    assert found is not None
    assert to_euler(found.quaternion_ned_frd) == pytest.approx((0.3, -0.2, 0.0))


@pytest.mark.parametrize(
    "force", [np.zeros((5, 3)), np.full((5, 3), np.nan), np.zeros((0, 3)), np.tile([0.0, 0.0, -12.0], (5, 1))]
)
def test_makes_nothing_of_a_force_that_is_not_gravity(force: np.ndarray) -> None:
    assert initial_attitude(force, None) is None


def test_leaves_out_samples_that_are_not_numbers() -> None:
    samples = samples_of(lambda t: (0.1, 0.2, 0.3), 0.1)
    force, field = samples.force.copy(), samples.field.copy()
    force[2, 1], field[4, 0] = math.nan, math.inf
    found = initial_attitude(force, field)
    assert found is not None
    assert to_euler(found.quaternion_ned_frd) == pytest.approx((0.1, 0.2, 0.3))
