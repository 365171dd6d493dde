"""The filter against textbook cases with known answers, against another implementation, and against bad input."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.ekf import ErrorStateFilter, Innovation
from bluerov_slam.navigation.measurements import (
    BlockValue,
    CompassHeading,
    Depth,
    GroundVelocity,
    HorizontalPosition,
    SensorAngles,
    WaterVelocity,
)
from bluerov_slam.navigation.process import ProcessNoise
from bluerov_slam.navigation.rotation import euler_from_rotation, exp_so3, log_so3, rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from navigation.simulated_motion import FULL, WindingDive, dive_filter, full_filter, nees, resting

BARE = StateLayout.make(without=[name for name, _ in FULL.blocks[3:]])
NO_WANDER = StateLayout.make(without=("gps_wander", "compass_wander", "compass"))


def position_fix(at_s: float, north_m: float, std_m: float = 1.0) -> HorizontalPosition:
    return HorizontalPosition(at_s, north_m, 0.0, std_m**2 * np.eye(2), wanders=False)


@dataclass(frozen=True)
class Linear:
    """Any linear measurement."""

    value: np.ndarray
    jacobian: np.ndarray
    noise: np.ndarray
    sensor: str = "linear"
    at_s: float = 0.0

    def evaluate(self, estimate, layout):
        return Innovation(self.value - self.jacobian @ estimate.values, self.jacobian, self.noise)


def test_steady_state_gain_of_the_alpha_beta_filter():
    """Constant velocity, position every second: gain and covariance settle where Kalata's tracking index says.

    With white acceleration held constant over T the known answer is lambda = T^2 sigma_a / sigma_z,
    r = (4 + lambda - sqrt(8 lambda + lambda^2)) / 4, alpha = 1 - r^2, beta = 2 (2 - alpha) - 4 sqrt(1 - alpha)
    (Kalata 1984, doi:10.1109/TAES.1984.310438). That discretisation is added here in place of the filter's own.
    """
    interval_s, sigma_a, sigma_z = 1.0, 0.3, 2.0
    core = ErrorStateFilter(NavEstimate(BARE, 0.0), BARE.vector(position=10.0, velocity=10.0, attitude=1e-6))
    held = np.array([0.5 * interval_s**2, interval_s]) * sigma_a
    result = None
    for step in range(1, 200):
        core.predict_kinematic(step * interval_s, 0.0, 0.0)
        for axis in (0, 1):
            core.covariance[np.ix_((axis, axis + 3), (axis, axis + 3))] += np.outer(held, held)
        result = core.update(position_fix(core.at_s, 0.0, sigma_z))
    index = interval_s**2 * sigma_a / sigma_z
    r = (4.0 + index - math.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r * r
    beta = 2.0 * (2.0 - alpha) - 4.0 * math.sqrt(1.0 - alpha)
    variance = core.covariance
    assert variance[0, 0] / sigma_z**2 == pytest.approx(alpha, rel=1e-9)
    assert variance[0, 3] / sigma_z**2 * interval_s == pytest.approx(beta, rel=1e-9)
    assert result.innovation_covariance[0, 0] == pytest.approx(sigma_z**2 / (1.0 - alpha), rel=1e-9)


def test_a_random_walk_settles_at_the_riccati_equations_root():
    """Scalar: P = (-q + sqrt(q^2 + 4 q r)) / 2 after each update, q being the walk's variance per step."""
    noise = ProcessNoise(depth_bias_walk_m_per_sqrt_s=0.2)
    core = full_filter(noise=noise)
    q, r = 0.2**2 * 0.5, 0.3**2
    for step in range(1, 300):
        core.predict_kinematic(0.5 * step)
        core.update(BlockValue(core.at_s, "depth_bias", np.zeros(1), np.array([[r]])))
    assert core.std("depth_bias")[0] ** 2 == pytest.approx((-q + math.sqrt(q * q + 4 * q * r)) / 2, rel=1e-9)


def test_one_update_is_the_weighted_mean():
    core = ErrorStateFilter(NavEstimate(BARE, 0.0), BARE.vector(position=2.0, velocity=1.0, attitude=0.1))
    result = core.update(position_fix(0.0, 3.0, 1.0))
    assert core.estimate.position_ned_m[0] == pytest.approx(3.0 * 4.0 / 5.0)
    assert core.std("position")[0] ** 2 == pytest.approx(4.0 / 5.0)
    assert result.nis == pytest.approx(9.0 / 5.0)
    assert (result.dof, result.weight, result.accepted, result.sensor) == (2, 1.0, True, "gps")


@given(st.integers(0, 2**32 - 1))
def test_agrees_with_filterpy_on_a_linear_problem(seed):
    """Position and velocity, white acceleration, random positions and couplings; both run the same numbers."""
    random = np.random.default_rng(seed)
    core = ErrorStateFilter(
        NavEstimate(BARE, 0.0, velocity=random.normal(size=3)),
        BARE.vector(position=3.0, velocity=1.0, attitude=1e-3),
    )
    other = KalmanFilter(dim_x=6, dim_z=2)
    other.x = core.estimate.values[:6].copy()
    other.P = core.covariance[:6, :6].copy()
    walk = 0.2
    for step in range(1, 40):
        interval_s = float(random.uniform(0.02, 2.0))
        core.predict_kinematic(core.at_s + interval_s, 0.01, walk)
        other.F = np.eye(6)
        other.F[:3, 3:] = interval_s * np.eye(3)
        third, half = interval_s**3 / 3.0 * np.eye(3), interval_s**2 / 2.0 * np.eye(3)
        other.Q = walk**2 * np.block([[third, half], [half, interval_s * np.eye(3)]])
        other.predict()
        jacobian = np.zeros((2, 9))
        jacobian[:, :6] = random.normal(size=(2, 6))
        root = random.normal(size=(2, 2))
        noise = root @ root.T + 0.1 * np.eye(2)
        value = random.normal(size=2) * 3.0
        result = core.update(Linear(value, jacobian, noise, at_s=core.at_s), None, None)
        other.update(value, R=noise, H=jacobian[:, :6])
        assert result.nis == pytest.approx(float(other.y.ravel() @ other.SI @ other.y.ravel()), rel=1e-6), step
    np.testing.assert_allclose(core.estimate.values[:6], np.asarray(other.x).ravel(), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(core.covariance[:6, :6], other.P, rtol=1e-8, atol=1e-10)


def run(dive: WindingDive, seconds: float) -> ErrorStateFilter:
    core = dive_filter(dive)
    for sample, measurements in dive.steps(seconds):
        core.predict_strapdown(sample)
        for measurement in measurements:
            core.update(measurement, robust=None)
    return core


def test_stated_errors_are_true_on_simulated_dives():
    """NEES of all 20 states after 40 s, 24 dives: their sum inside the 99.8 % band of chi-square.

    It holds for a heading that is known to some tens of degrees and a tilt that is known to some: at 6 deg of tilt the
    error's products count (mean NEES 46 instead of 20), so a start levels the vehicle by its accelerometer first.
    """
    values = []
    for seed in range(24):
        dive = WindingDive(seed)
        core = run(dive, 40.0)
        values.append(nees(dive.truth, core.estimate, core.covariance))
    dof = core.layout.size * len(values)
    assert chi_square_quantile(0.001, dof) < sum(values) < chi_square_quantile(0.999, dof)


def test_the_gyros_bias_is_found():
    dive = WindingDive(3)
    core = run(dive, 120.0)
    error = core.estimate.block("gyro_bias") - dive.truth.block("gyro_bias")
    assert np.abs(error).max() < 5e-4
    assert (np.abs(error) < 3.5 * core.std("gyro_bias")).all()


def test_covariance_stays_symmetric_and_positive_over_hours():
    """Three hours at 2 Hz with very good and very poor sensors by turns: symmetric, positive, well conditioned."""
    core = full_filter()
    for step in range(1, 3 * 3600 * 2 + 1):
        core.predict_strapdown(resting(0.5 * step, 0.5))
        if step % 4 == 0:
            core.update(Depth(core.at_s, 0.0, 1e-4))
        if step % 40 == 0:
            core.update(CompassHeading(core.at_s, 0.0, 0.03))
        if step % 2000 == 0:
            core.update(HorizontalPosition(core.at_s, 0.0, 0.0, 1e-6 * np.eye(2)), None, None)
    np.testing.assert_array_equal(core.covariance, core.covariance.T)
    scale = np.sqrt(np.diag(core.covariance))
    correlation = core.covariance / np.outer(scale, scale)
    assert np.linalg.eigvalsh(correlation).min() > 1e-12
    np.linalg.cholesky(core.covariance)
    np.testing.assert_allclose(core.estimate.rotation_ned_frd @ core.estimate.rotation_ned_frd.T, np.eye(3), atol=1e-12)


def test_an_almost_perfect_measurement_of_an_unknown_leaves_a_valid_covariance():
    """A kilometre of doubt and a fix of 10 micrometres: sixteen digits lie between the variances."""
    core = full_filter(NO_WANDER)
    core.add_uncertainty("position", 1000.0)
    for _ in range(5):
        core.update(position_fix(0.0, 10.0, 1e-5), None, None)
        np.testing.assert_array_equal(core.covariance, core.covariance.T)
        assert np.linalg.eigvalsh(core.covariance).min() > 0.0
    assert core.estimate.position_ned_m[0] == pytest.approx(10.0, abs=1e-6)
    assert core.std("position")[0] == pytest.approx(1e-5 / math.sqrt(5.0), rel=0.01)


def test_a_large_first_heading_turns_the_covariance_with_it():
    """Tilt known to 0.5 deg about north and 5 deg about east, heading unknown and then said to be 120 deg.

    Draws of that start which have this heading, seen from the corrected estimate, scatter as the covariance says.
    """
    core = full_filter()
    deviation = np.radians((0.5, 5.0, 170.0))
    core.reset_block("attitude", np.eye(3), deviation)
    heading = math.radians(120.0)
    core.update(SensorAngles(0.0, 0.0, 0.0, heading, math.radians(60.0), 1e-3), None, None)
    corrected = core.estimate.rotation_ned_frd
    np.testing.assert_allclose(corrected, rotation_from_euler(0.0, 0.0, heading), atol=0.01)
    random = np.random.default_rng(3)
    draws = random.normal(size=(4000, 2)) * deviation[:2]
    errors = [log_so3(exp_so3((north, east, heading)) @ corrected.T)[:2] for north, east in draws]
    np.testing.assert_allclose(core.covariance[6:8, 6:8], np.cov(np.transpose(errors)), rtol=0.08, atol=2e-5)
    assert np.linalg.eigvalsh(core.covariance).min() > 0.0


def test_what_nothing_on_board_can_see_is_not_learned_from_noise():
    """A DVL and thrusters in a current, ten minutes, no compass: the heading stays as unknown as it was.

    A turn of heading, velocity and current together changes no measurement. Left alone, noise in the estimate turns
    the blind direction about and takes it for knowledge: the stated error falls from 10 deg to 1.3.
    """
    layout = StateLayout.make(without=("dvl", "compass", "compass_wander", "gyro_bias", "accel_bias"))
    std = layout.vector(position=1.0, velocity=1.0, attitude=(1e-3, 1e-3, math.radians(10.0)), current=1.0)
    still = ProcessNoise(gyro_noise_rad_per_sqrt_s=1e-6, current_walk_mps_per_sqrt_s=1e-3)
    core = ErrorStateFilter(NavEstimate(layout, 0.0), std, still)
    random = np.random.default_rng(4)
    for step in range(1, 3000):
        core.predict_kinematic(0.2 * step, 1e-6, 0.05)
        ground = np.array([0.5, 0.2, 0.0]) + 0.015 * random.normal(size=3)
        core.update(GroundVelocity(core.at_s, ground, 0.015**2 * np.eye(3)), None, None)
        core.update(WaterVelocity(core.at_s, np.array([0.3, 0.0]) + 0.05 * random.normal(size=2), 0.05), None, None)
    assert math.degrees(core.std("attitude")[2]) == pytest.approx(10.0, rel=0.1)


def test_the_gate_refuses_what_one_right_value_in_a_thousand_exceeds():
    core = full_filter(NO_WANDER)
    variance = core.covariance[0, 0] + 1.0
    limit = math.sqrt(chi_square_quantile(0.999, 2) * variance)
    before = core.estimate.copy(), core.covariance.copy()
    refused = core.update(position_fix(0.0, limit * 1.001))
    assert not refused.accepted
    assert refused.weight == 0.0
    assert refused.nis > chi_square_quantile(0.999, 2)
    np.testing.assert_array_equal(core.estimate.values, before[0].values)
    np.testing.assert_array_equal(core.covariance, before[1])
    assert core.update(position_fix(0.0, limit * 0.999)).accepted
    assert core.update(position_fix(0.0, 1000.0), gate_probability=None).accepted


def test_hubers_weight_limits_the_pull_of_a_far_value():
    """Up to the limit the pull grows with the distance; beyond it the noise grows so that it hardly does."""
    pulls = {}
    for distance in (2.0, 4.0, 8.0):
        core = ErrorStateFilter(NavEstimate(BARE, 0.0), BARE.vector(position=0.1, velocity=1.0, attitude=0.1))
        result = core.update(position_fix(0.0, distance, 1.0), None)
        pulls[distance] = core.estimate.position_ned_m[0]
        limit = chi_square_quantile(0.95, 2)
        assert result.weight == pytest.approx(min(1.0, math.sqrt(limit / result.nis)))
    plain = ErrorStateFilter(NavEstimate(BARE, 0.0), BARE.vector(position=0.1, velocity=1.0, attitude=0.1))
    plain.update(position_fix(0.0, 8.0, 1.0), None, None)
    assert pulls[4.0] / pulls[2.0] < 1.3
    assert pulls[8.0] == pytest.approx(pulls[4.0], rel=0.03)
    assert plain.estimate.position_ned_m[0] > 3.0 * pulls[8.0]


BAD = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_number_never_enters(bad):
    core = full_filter()
    core.predict_strapdown(resting(0.05))
    before = core.estimate.copy(), core.covariance.copy()
    assert core.update(Depth(0.05, bad, 0.02)) is None
    assert core.update(Depth(0.05, 1.0, bad)) is None
    assert core.update(CompassHeading(0.05, bad, 0.02)) is None
    assert core.update(HorizontalPosition(0.05, 0.0, 0.0, np.diag((1.0, bad)))) is None
    assert core.refused_measurements == 4
    sample = resting(0.1)
    sample.specific_force_frd_mps2[1] = bad
    assert not core.predict_strapdown(sample)
    sample = resting(0.1)
    sample.angular_rate_frd_radps[2] = bad
    assert not core.predict_strapdown(sample)
    assert not core.predict_strapdown(resting(bad) if math.isnan(bad) else resting(0.01))
    assert not core.predict_kinematic(bad)
    assert core.refused_samples == 3
    np.testing.assert_array_equal(core.estimate.values, before[0].values)
    np.testing.assert_array_equal(core.covariance, before[1])
    assert core.at_s == 0.05


def test_a_covariance_that_is_none_is_refused():
    core = full_filter()
    assert core.update(HorizontalPosition(0.0, 0.0, 0.0, np.diag((1.0, -1e6)))) is None
    assert core.update(Linear(np.zeros(1), np.zeros((1, 29)), np.array([[-1.0]]))) is None
    assert core.refused_measurements == 2


def test_samples_from_the_past_are_refused():
    core = full_filter()
    assert core.predict_strapdown(resting(0.05))
    assert not core.predict_strapdown(resting(0.05))
    assert not core.predict_strapdown(resting(0.02))
    assert core.refused_samples == 2
    assert not core.predict_kinematic(0.05)


def test_a_gap_in_the_imu_is_bridged_and_costs_certainty():
    with_gap, without = full_filter(), full_filter()
    for core in (with_gap, without):
        core.reset_block("attitude", np.eye(3), (0.005, 0.005, 0.1))
        core.predict_strapdown(resting(0.05))
    for step in range(2, 41):
        without.predict_strapdown(resting(0.05 * step))
    with_gap.predict_strapdown(resting(2.0))
    assert with_gap.at_s == without.at_s == 2.0
    assert with_gap.std("attitude")[2] ** 2 - without.std("attitude")[2] ** 2 == pytest.approx(0.35**2 * 1.9, rel=0.01)
    assert (with_gap.std("velocity") > without.std("velocity")).all()
    np.testing.assert_allclose(with_gap.estimate.velocity_ned_mps, 0.0, atol=1e-9)


def test_a_late_sample_makes_no_gap_of_clock_jitter():
    core = full_filter()
    core.predict_strapdown(resting(0.05))
    core.predict_strapdown(resting(0.105))
    assert core.std("attitude")[2] == pytest.approx(0.2, abs=1e-3)
    assert core.at_s == 0.105


def test_a_reset_forgets_a_block_and_its_relations():
    core = full_filter()
    for step in range(1, 60):
        core.predict_strapdown(resting(0.05 * step))
        core.update(Depth(core.at_s, 1.0, 0.02))
    assert np.abs(core.covariance[2, 5]) > 0.0
    core.reset_block("position", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert core.estimate.position_ned_m.tolist() == [1.0, 2.0, 3.0]
    assert core.std("position").tolist() == [4.0, 5.0, 6.0]
    assert not core.covariance[:3, 3:].any()
    assert not core.covariance[3:, :3].any()
    core.reset_block("attitude", rotation_from_euler(0.1, 0.2, 0.3), 0.05)
    assert euler_from_rotation(core.estimate.rotation_ned_frd) == pytest.approx((0.1, 0.2, 0.3))
    np.linalg.cholesky(core.covariance)
    with pytest.raises(ValueError, match="reset of current"):
        core.reset_block("current", (math.nan, 0.0), 0.1)
    with pytest.raises(KeyError):
        core.reset_block("isbl_mounting", 0.0, 1.0)


def test_add_uncertainty_keeps_relations():
    core = full_filter()
    core.predict_kinematic(1.0)
    shared = core.covariance[0, 3]
    core.add_uncertainty("position", (3.0, 4.0, 5.0))
    assert core.covariance[0, 3] == shared != 0.0
    assert core.covariance[1, 1] - core.covariance[0, 0] == pytest.approx(7.0)


def test_health():
    core = full_filter()
    assert core.is_healthy()
    core.covariance[3, 3] = 0.0
    assert not core.is_healthy()
    broken = full_filter()
    broken.estimate.values[0] = math.nan
    assert not broken.is_healthy()


def test_a_covariance_of_the_wrong_size_is_refused():
    with pytest.raises(ValueError, match="covariance"):
        ErrorStateFilter(NavEstimate(FULL, 0.0), np.ones(28))
