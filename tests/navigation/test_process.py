"""Prediction against exact motion, against finite differences, and against brute-force noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

from bluerov_slam.navigation.process import Earth, ProcessModel, ProcessNoise, normal_gravity_mps2
from bluerov_slam.navigation.rotation import exp_so3, rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from navigation.finite_differences import derivative, random_estimate, seeds

FULL = StateLayout.make(extra=(("isbl_mounting", 3),))
LAYOUTS = {
    "full": FULL,
    "no gyro bias": StateLayout.make(without=("gyro_bias",)),
    "no accelerometer bias": StateLayout.make(without=("accel_bias", "compass_wander")),
    "bare": StateLayout.make(without=[name for name, _ in StateLayout.make().blocks[3:]]),
}


def whole_transition(model: ProcessModel, top: np.ndarray, decay: np.ndarray) -> np.ndarray:
    matrix = np.diag(np.concatenate([np.ones(9), decay]))
    matrix[:9, : top.shape[1]] = top
    return matrix


@pytest.mark.parametrize("name", LAYOUTS)
@given(seed=seeds)
def test_transition_is_the_derivative_of_the_prediction(name, seed):
    layout = LAYOUTS[name]
    model = ProcessModel(layout, earth=Earth(60.0))
    random = np.random.default_rng(seed)
    force, rate = random.uniform(-12.0, 12.0, 3), random.uniform(-0.5, 0.5, 3)
    start = random_estimate(layout, seed)
    interval_s = 0.05
    end = start.copy()
    top = model.strapdown(end, force, rate, interval_s)

    def predicted(estimate: NavEstimate) -> np.ndarray:
        moved = estimate.copy()
        model.strapdown(moved, force, rate, interval_s)
        return moved.difference(end)

    decay = model.propagate(np.eye(layout.size), top, interval_s)
    transition, expected = whole_transition(model, top, decay), derivative(predicted, start, 1e-5)
    if "gyro_bias" in layout:
        # How the turn inside the step turns the force is carried to second order in the turn, here 0.04 rad.
        np.testing.assert_allclose(transition[:6, layout["gyro_bias"]], expected[:6, layout["gyro_bias"]], atol=5e-6)
        transition[:6, layout["gyro_bias"]] = expected[:6, layout["gyro_bias"]]
    # What the earth turns inside the step is not carried to the velocity: 4e-6 rad of 0.6 m/s.
    np.testing.assert_allclose(transition, expected, atol=3e-6)


@pytest.mark.parametrize("time_s", [math.inf, 4.0])
@pytest.mark.parametrize("name", LAYOUTS)
@given(seed=seeds)
def test_kinematic_transition_is_its_derivative(name, time_s, seed):
    layout = LAYOUTS[name]
    model = ProcessModel(layout)
    model.kinematic_velocity_time_s = time_s
    start = random_estimate(layout, seed)
    end = start.copy()
    top = model.kinematic(end, 0.7)

    def predicted(estimate: NavEstimate) -> np.ndarray:
        moved = estimate.copy()
        model.kinematic(moved, 0.7)
        return moved.difference(end)

    decay = model.propagate(np.eye(layout.size), top, 0.7)
    np.testing.assert_allclose(whole_transition(model, top, decay), derivative(predicted, start), atol=1e-8)


def test_without_an_imu_drag_takes_the_vehicle_along_with_the_current():
    model = ProcessModel(FULL)
    model.kinematic_velocity_time_s = 4.0
    estimate = NavEstimate(FULL, 0.0, velocity=(1.0, 0.0, 0.2), current=(-0.1, 0.3))
    for _ in range(100):
        model.kinematic(estimate, 0.4)
    assert estimate.velocity_ned_mps == pytest.approx([-0.1, 0.3, 0.0], abs=1e-4)
    # The way through the water is the speed through it for 4 s, whatever the steps.
    assert estimate.position_ned_m == pytest.approx([1.1 * 4.0 - 4.0, -0.3 * 4.0 + 12.0, 0.8], abs=1e-3)


@given(seeds)
def test_propagation_is_f_p_f_transposed_plus_q(seed):
    model = ProcessModel(FULL, ProcessNoise(extra_walk_per_sqrt_s=0.01), Earth(60.0))
    random = np.random.default_rng(seed)
    root = random.normal(size=(FULL.size, FULL.size))
    covariance = root @ root.T
    top = model.strapdown(random_estimate(FULL, seed), random.normal(size=3) * 10, random.normal(size=3), 0.05)
    moved = covariance.copy()
    decay = model.propagate(moved, top, 0.05)
    transition = whole_transition(model, top, decay)
    added = moved - transition @ covariance @ transition.T
    np.testing.assert_array_equal(moved, moved.T)
    noise = model.noise
    assert np.diag(added)[3:6] == pytest.approx(noise.accel_noise_mps_per_sqrt_s**2 * 0.05, abs=1e-9)
    assert np.diag(added)[FULL["isbl_mounting"]] == pytest.approx(0.01**2 * 0.05, abs=1e-9)
    assert np.diag(added)[FULL["current"]] == pytest.approx(noise.current_walk_mps_per_sqrt_s**2 * 0.05, abs=1e-9)
    off_diagonal = added - np.diag(np.diag(added))
    np.testing.assert_allclose(off_diagonal[9:], 0.0, atol=1e-9)


def test_a_gauss_markov_block_settles_at_its_standard_deviation():
    model = ProcessModel(FULL)
    covariance = np.zeros((FULL.size, FULL.size))
    estimate = NavEstimate(FULL, 0.0, gps_wander=(5.0, -5.0))
    for _ in range(600):
        model.propagate(covariance, model.kinematic(estimate, 1.0), 1.0)
    place = FULL["gps_wander"]
    assert np.diag(covariance)[place] == pytest.approx(model.noise.gps_wander_std_m**2, rel=1e-6)
    assert estimate.block("gps_wander") == pytest.approx([5.0 * math.exp(-10.0), -5.0 * math.exp(-10.0)])


def test_ten_small_steps_are_one_large_step():
    """Exact for constant force and rate in the body, whatever the turn: coning, sculling and all."""
    layout, force, rate = LAYOUTS["bare"], np.array([0.4, -1.0, -9.7]), np.array([0.5, -1.5, 3.0])
    model = ProcessModel(layout, earth=Earth())
    once = NavEstimate(layout, 0.0, rotation_from_euler(0.1, 0.2, 0.3), velocity=(1.0, 2.0, 3.0))
    often = once.copy()
    model.strapdown(once, force, rate, 0.5)
    for _ in range(10):
        model.strapdown(often, force, rate, 0.05)
    np.testing.assert_allclose(once.difference(often), 0.0, atol=1e-12)
    assert once.at_s == pytest.approx(often.at_s)


def test_a_circle_is_driven_as_a_circle():
    """0.5 m/s at 20 deg/s for one turn at 20 Hz, from an ideal IMU's means over each interval: back at the start."""
    layout, model = LAYOUTS["bare"], ProcessModel(LAYOUTS["bare"], earth=Earth())
    rate, speed, interval_s = math.radians(20.0), 0.5, 0.05
    estimate = NavEstimate(layout, 0.0, velocity=(speed, 0.0, 0.0))
    force = np.array([0.0, speed * rate, -model.earth.gravity_mps2])
    farthest = 0.0
    for _ in range(360):
        model.strapdown(estimate, force, np.array([0.0, 0.0, rate]), interval_s)
        farthest = max(farthest, float(np.linalg.norm(estimate.position_ned_m)))
    np.testing.assert_allclose(estimate.position_ned_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(estimate.velocity_ned_mps, [speed, 0.0, 0.0], atol=1e-9)
    assert farthest == pytest.approx(2.0 * speed / rate, rel=1e-3)


def test_at_rest_on_the_turning_earth_nothing_turns():
    earth, layout = Earth(50.0), LAYOUTS["bare"]
    model = ProcessModel(layout, earth=earth)
    attitude = rotation_from_euler(0.3, -0.2, 1.0)
    estimate = NavEstimate(layout, 0.0, attitude)
    rate = attitude.T @ earth.rate_ned_radps
    force = -attitude.T @ earth.gravity_ned_mps2
    for _ in range(1200):
        model.strapdown(estimate, force, rate, 0.05)
    np.testing.assert_allclose(estimate.rotation_ned_frd, attitude, atol=1e-12)
    np.testing.assert_allclose(estimate.velocity_ned_mps, 0.0, atol=1e-9)


def test_biases_are_taken_from_what_is_measured():
    model = ProcessModel(FULL, earth=Earth())
    bias_rate, bias_force = np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.2, -0.3])
    estimate = NavEstimate(FULL, 0.0, gyro_bias=bias_rate, accel_bias=bias_force)
    model.strapdown(estimate, bias_force - model.earth.gravity_ned_mps2, bias_rate, 1.0)
    np.testing.assert_allclose(estimate.rotation_ned_frd, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(estimate.velocity_ned_mps, 0.0, atol=1e-12)


def test_stated_noise_is_what_noisy_samples_do():
    """White noise of the stated density on every sample: 400 dead reckonings over 5 s against the covariance."""
    layout, noise = LAYOUTS["bare"], ProcessNoise(accel_noise_mps_per_sqrt_s=0.02, gyro_noise_rad_per_sqrt_s=0.002)
    model = ProcessModel(layout, noise, Earth())
    random, interval_s, steps = np.random.default_rng(7), 0.05, 100
    attitude = rotation_from_euler(0.2, -0.1, 0.7)
    rate, force = np.array([0.02, 0.05, 0.3]), np.array([0.3, 0.1, -9.8])
    truth = NavEstimate(layout, 0.0, attitude)
    covariance = np.zeros((9, 9))
    runs = [truth.copy() for _ in range(400)]
    for _ in range(steps):
        model.propagate(covariance, model.strapdown(truth, force, rate, interval_s), interval_s)
        for run in runs:
            noisy_force = force + random.normal(size=3) * 0.02 / math.sqrt(interval_s)
            noisy_rate = rate + random.normal(size=3) * 0.002 / math.sqrt(interval_s)
            model.strapdown(run, noisy_force, noisy_rate, interval_s)
    errors = np.array([run.difference(truth) for run in runs])
    normalised = errors @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    # Mean of 400 chi-square values of 9 degrees of freedom: 9 with a standard deviation of 0.21.
    assert float((normalised**2).sum(axis=1).mean()) == pytest.approx(9.0, abs=0.7)
    np.testing.assert_allclose(errors.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.15)


def test_normal_gravity():
    assert normal_gravity_mps2(0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert normal_gravity_mps2(90.0) == pytest.approx(9.8321849379, abs=1e-9)
    assert normal_gravity_mps2(45.0) == pytest.approx(9.80619777, abs=1e-8)


def test_the_earth_turns_to_the_east():
    """Standing at 60 deg north and facing north, the gyro sees a turn about the axis that points north and up."""
    rate = Earth(60.0).rate_ned_radps
    assert rate[0] == pytest.approx(math.radians(15.041 / 3600) * 0.5, rel=1e-4)
    assert rate[2] < 0.0
    assert np.linalg.norm(exp_so3(rate * 86164.1) - np.eye(3)) < 1e-4
