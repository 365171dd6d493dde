"""The scale is learned from what lasts, not from the errors of what it scales."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.navigation.ekf import ErrorStateFilter
from bluerov_slam.navigation.measurements import BlockValue, GroundVelocity, WaterVelocity
from bluerov_slam.navigation.process import ProcessNoise
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from bluerov_slam.navigation.steady_velocity import SteadyVelocity
from navigation.simulated_motion import FULL, initial_std


def fed(*values: float, step_s: float = 0.2) -> list[float]:
    """What is steady of surge before each value."""
    steady = SteadyVelocity()
    return [float(steady.before(step_s * k, np.array([value, 0.0]))[0]) for k, value in enumerate(values)]


def test_a_constant_velocity_is_steady_from_the_start():
    np.testing.assert_allclose(fed(*[0.5] * 100), 0.5)


def test_holds_nothing_of_the_present_value():
    assert fed(*[0.5] * 100, 0.55)[-1] == pytest.approx(fed(*[0.5] * 100, 0.45)[-1]) == pytest.approx(0.5)


def test_follows_a_change_of_speed_at_once():
    found = fed(*[0.5] * 100, *[0.0] * 20, *[0.3] * 20)
    assert found[99:103] == pytest.approx([0.5, 0.5, 0.0, 0.0], abs=2e-3)
    assert found[121:140] == pytest.approx([0.3] * 19, abs=2e-3)


def test_one_value_far_off_is_no_change():
    assert max(fed(*[0.5] * 100, 1.5, *[0.5] * 20)[100:]) < 0.53


def test_errors_about_zero_are_taken_for_nothing_and_about_a_speed_for_the_speed():
    random = np.random.default_rng(1)
    around_zero = fed(*(0.05 * random.normal(size=5000)))
    assert np.sqrt(np.mean(np.square(around_zero[100:]))) < 0.12 * 0.05
    around_speed = fed(*(0.5 + 0.05 * random.normal(size=5000)))
    assert np.std(around_speed[100:]) < 0.2 * 0.05
    assert np.mean(around_speed[100:]) == pytest.approx(0.5, abs=0.003)


def test_heavy_errors_are_not_taken_for_changes_for_long():
    random = np.random.default_rng(2)
    found = fed(*(0.5 + 0.2 * random.normal(size=3000)))
    assert np.std(found[500:]) < 0.4 * 0.2


def test_begins_anew_after_a_gap_and_when_time_goes_back():
    steady = SteadyVelocity()
    for step in range(600):
        steady.before(0.2 * step, np.array([0.5, 0.0]))
    assert steady.before(200.0, np.array([0.45, 0.1])).tolist() == [0.45, 0.1]
    assert steady.before(199.0, np.array([0.55, 0.0])).tolist() == [0.55, 0.0]


def learned_scale(*, with_steady: bool, seed: int = 3) -> tuple[float, float]:
    """Scale of surge and its stated error after 15 min on one course at 0.5 m/s, the model being off by 3 cm/s rms.

    The water's velocity is 1.05 times the model's; the current is unknown, so the course alone says nothing of it.
    """
    noise = ProcessNoise(current_walk_mps_per_sqrt_s=1e-4)
    core = ErrorStateFilter(NavEstimate(FULL, 0.0, velocity=(0.525, 0.0, 0.0)), initial_std(FULL), noise)
    steady, random = SteadyVelocity(), np.random.default_rng(seed)
    for step in range(1, 900 * 2):
        core.predict_kinematic(0.5 * step, 1e-4, 0.005)
        core.update(BlockValue(core.at_s, "velocity", np.array([0.525, 0.0, 0.0]), 1e-3 * np.eye(3)), None, None)
        model = np.array([0.5, 0.0]) + 0.03 * random.normal(size=2)
        lasting = steady.before(core.at_s, model) if with_steady else None
        core.update(WaterVelocity(core.at_s, model, 0.07, steady_frd_mps=lasting), None, None)
    place = FULL["thrust_scale"].start
    return float(core.estimate.values[place]), math.sqrt(core.covariance[place, place])


def test_errors_of_the_model_do_not_pull_its_scale_to_zero():
    scale, std = learned_scale(with_steady=True)
    assert abs(scale - 0.05) < 2.0 * std
    assert std == pytest.approx(0.1, rel=0.2)  # nothing was to be learned
    pulled, believed = learned_scale(with_steady=False)
    assert pulled < scale - 0.05
    assert believed < 0.8 * std


def dvl_scale(*, with_steady: bool) -> tuple[float, float]:
    """Scale of a DVL after ten minutes on one course, which says nothing of it, and its stated error."""
    layout = StateLayout.make(
        without=("compass", "compass_wander", "gyro_bias", "accel_bias", "current", "thrust_scale")
    )
    core = ErrorStateFilter(
        NavEstimate(layout, 0.0), layout.vector(position=1.0, velocity=0.5, attitude=1e-4, dvl=0.01)
    )
    steady, random = SteadyVelocity(), np.random.default_rng(2)
    for step in range(1, 3000):
        core.predict_kinematic(0.2 * step, 1e-6, 0.02)
        seen = np.array([0.5, 0.0, 0.0]) + 0.015 * random.normal(size=3)
        lasting = steady.before(core.at_s, seen) if with_steady else None
        core.update(GroundVelocity(core.at_s, seen, 0.015**2 * np.eye(3), steady_frd_mps=lasting), None, None)
    place = layout["dvl"].start
    return float(core.estimate.values[place]), math.sqrt(core.covariance[place, place])


def test_a_dvls_scale_does_not_drift_by_the_noise_of_the_velocity():
    scale, std = dvl_scale(with_steady=True)
    assert abs(scale) < std
    drifted, _ = dvl_scale(with_steady=False)
    assert drifted < scale - std
