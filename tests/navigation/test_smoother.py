"""The smoother against exact solutions of linear problems, against another implementation, and for its honesty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.ekf import ErrorStateFilter, Innovation
from bluerov_slam.navigation.measurements import BlockValue, HorizontalPosition
from bluerov_slam.navigation.process import ProcessNoise
from bluerov_slam.navigation.smoother import PredictionStep, StepRecorder, smooth
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from navigation.simulated_motion import FULL, LEAN, WindingDive, dive_filter, full_filter, nees, resting

BARE = StateLayout.make(without=[name for name, _ in FULL.blocks[3:]])


def test_the_middle_of_a_long_random_walk_has_the_known_variance():
    """Scalar walk of variance q per step, measured with variance r: far from both ends q r / sqrt(q^2 + 4 q r).

    Forward and backward filters are each other's mirror images there: 1/P = 1/P+ + 1/(P+ + q) with P+^2 + q P+ = q r.
    """
    recorder = StepRecorder(0.0)
    core = full_filter(noise=ProcessNoise(depth_bias_walk_m_per_sqrt_s=0.2), recorder=recorder)
    q, r = 0.2**2 * 0.5, 0.3**2
    for step in range(1, 200):
        core.predict_kinematic(0.5 * step)
        core.update(BlockValue(core.at_s, "depth_bias", np.zeros(1), np.array([[r]])))
    middle = smooth(recorder.steps)[100]
    place = FULL["depth_bias"].start
    assert middle.covariance[place, place] == pytest.approx(q * r / math.sqrt(q * q + 4 * q * r), rel=1e-9)


def linear_run(recorder: StepRecorder, seed: int = 5) -> tuple[ErrorStateFilter, list[tuple[float, np.ndarray]]]:
    """Position and velocity in three dimensions, walks of the velocity, 30 fixes; and the fixes."""
    random = np.random.default_rng(seed)
    std = BARE.vector(position=3.0, velocity=1.0, attitude=1e-3)
    core = ErrorStateFilter(NavEstimate(BARE, 0.0, velocity=(0.3, -0.2, 0.0)), std, recorder=recorder)
    fixes = []
    for _ in range(30):
        core.predict_kinematic(core.at_s + float(random.uniform(0.2, 2.0)), 0.0, 0.2)
        north, east = 0.4 * core.at_s + random.normal(size=2)
        fixes.append((core.at_s, np.array([north, east])))
        core.update(HorizontalPosition(core.at_s, north, east, np.eye(2)), None, None)
    return core, fixes


def test_smoothing_is_the_exact_solution_of_the_whole_linear_problem():
    """Against the joint Gaussian of all instants, solved at once: means and covariances of every instant."""
    recorder = StepRecorder(0.0)
    _, fixes = linear_run(recorder)
    smoothed = smooth(recorder.steps)
    times = np.array([0.0] + [t for t, _ in fixes])
    count = len(times)
    # One axis: x(t) = p0 + v0 t + the walk's integral. Its covariance between instants in closed form.
    early, late = np.minimum.outer(times, times), np.maximum.outer(times, times)
    position = 3.0**2 + 1.0**2 * np.outer(times, times) + 0.2**2 * (early**2 * late / 2.0 - early**3 / 6.0)
    velocity = 1.0**2 + 0.2**2 * early
    integral = np.where(times[:, None] <= times[None, :], times[:, None] ** 2 / 2.0, 0.0)
    cross_late = times[:, None] * times[None, :] - times[None, :] ** 2 / 2.0
    both = np.where(times[:, None] <= times[None, :], integral, cross_late)
    cross = 1.0**2 * times[:, None] + 0.2**2 * both  # of position at row's, velocity at column's instant
    joint = np.block([[position, cross], [cross.T, velocity]])
    observe = np.zeros((count - 1, 2 * count))
    observe[np.arange(count - 1), np.arange(1, count)] = 1.0
    gain = joint @ observe.T @ np.linalg.inv(observe @ joint @ observe.T + np.eye(count - 1))
    left = joint - gain @ observe @ joint
    for axis, speed in ((0, 0.3), (1, -0.2)):
        mean = np.concatenate([speed * times, np.full(count, speed)])
        mean = mean + gain @ (np.array([fix[axis] for _, fix in fixes]) - observe @ mean)
        for index, state in enumerate(smoothed):
            places = (axis, axis + 3)
            np.testing.assert_allclose(state.estimate.values[list(places)], mean[[index, count + index]], atol=1e-9)
            np.testing.assert_allclose(
                state.covariance[np.ix_(places, places)],
                left[np.ix_((index, count + index), (index, count + index))],
                atol=1e-9,
            )
    assert [state.at_s for state in smoothed] == pytest.approx(times)


def test_a_linear_filter_never_knows_more_than_its_smoother():
    """Filtered minus smoothed covariance has no negative eigenvalue at any instant."""
    recorder = StepRecorder(0.0)
    core, _ = linear_run(recorder)
    for step, state in zip(
        [step for step in recorder.steps if isinstance(step, PredictionStep)], smooth(recorder.steps), strict=True
    ):
        assert np.linalg.eigvalsh(step.covariance - state.covariance).min() > -1e-12
    np.testing.assert_allclose(smooth(recorder.steps)[-1].covariance, core.covariance, atol=1e-12)


def test_agrees_with_the_smoother_of_filterpy():
    recorder = StepRecorder(0.0)
    _, fixes = linear_run(recorder, 8)
    other = KalmanFilter(dim_x=6, dim_z=2)
    other.x = np.array([0, 0, 0, 0.3, -0.2, 0.0])
    other.P = np.diag([9.0, 9, 9, 1, 1, 1])
    other.H = np.eye(2, 6)
    means, covariances, transitions, noises, before = [], [], [], [], 0.0
    for at_s, fix in fixes:
        dt, before = at_s - before, at_s
        other.F = np.eye(6)
        other.F[:3, 3:] = dt * np.eye(3)
        third, half = dt**3 / 3.0 * np.eye(3), dt**2 / 2.0 * np.eye(3)
        other.Q = 0.2**2 * np.block([[third, half], [half, dt * np.eye(3)]])
        other.predict()
        other.update(fix, R=np.eye(2))
        means.append(other.x.copy())
        covariances.append(other.P.copy())
        transitions.append(other.F)
        noises.append(other.Q)
    # filterpy predicts step k to k + 1 with the matrices of k + 1.
    x, p, _, _ = other.rts_smoother(np.array(means), np.array(covariances), transitions, noises)
    for ours, mean, covariance in zip(smooth(recorder.steps)[1:], x, p, strict=True):
        np.testing.assert_allclose(ours.estimate.values[:6], mean, atol=1e-8)
        np.testing.assert_allclose(ours.covariance[:6, :6], covariance, atol=1e-8)


def smoothed_dive(seed: int, seconds: float, gps_until_s: float = math.inf):
    """The filter, smoothed states, and by instant truth, filtered estimate and covariance. Its start is known well.

    A smoothed start 10 deg off the filter's would have to be linearised anew: products of errors are left out.
    """
    dive = WindingDive(seed, gps_until_s=gps_until_s, attitude=(0.005, 0.005, 0.03))
    recorder = StepRecorder(1.0)
    core = dive_filter(dive, recorder=recorder)
    known = {0.0: (dive.truth.copy(), core.estimate.copy(), core.covariance.copy())}
    for sample, measurements in dive.steps(seconds):
        core.predict_strapdown(sample)
        for measurement in measurements:
            core.update(measurement, robust=None)
        known[round(core.at_s, 6)] = dive.truth.copy(), core.estimate.copy(), core.covariance.copy()
    if gps_until_s < seconds:
        for _ in range(5):
            north, east = dive.truth.position_ned_m[:2]
            core.update(HorizontalPosition(core.at_s, north, east, 0.2 * np.eye(2)), robust=None)
    return core, smooth(recorder.steps), known


def test_smoothed_errors_are_true_on_simulated_dives():
    """NEES of all 20 states at the start, in the middle and at the end of 16 dives of 40 s: each sum in its band."""
    sums = np.zeros(3)
    for seed in range(16):
        _, states, known = smoothed_dive(100 + seed, 40.0)
        chosen = (states[0], states[len(states) // 2], states[-1])
        sums += [nees(known[round(state.at_s, 6)][0], state.estimate, state.covariance) for state in chosen]
    dof = LEAN.size * 16
    low, high = chi_square_quantile(0.001, dof), chi_square_quantile(0.999, dof)
    assert (low < sums).all(), sums
    assert (sums < high).all(), sums


def test_smoothing_never_makes_it_worse_and_bridges_an_outage():
    """Fixes stop after 20 s and come back at the end: between, the smoothed position is several times as good."""
    _, states, known = smoothed_dive(42, 120.0, 20.0)
    ours, theirs = [], []
    for state in states:
        truth, estimate, covariance = known[round(state.at_s, 6)]
        # The two are about different attitudes: half the turn between them mixes the attitude's variances a little.
        assert (np.sqrt(np.diag(state.covariance)) < 1.003 * np.sqrt(np.diag(covariance))).all()
        assert np.linalg.eigvalsh(state.covariance).min() > 0.0
        if 40.0 < state.at_s < 119.0:
            ours.append(np.linalg.norm((truth.position_ned_m - state.estimate.position_ned_m)[:2]))
            theirs.append(np.linalg.norm((truth.position_ned_m - estimate.position_ned_m)[:2]))
    assert np.sqrt(np.mean(np.square(ours))) < 0.5 * np.sqrt(np.mean(np.square(theirs)))


def test_the_end_of_a_run_is_what_the_filter_says():
    core, states, _ = smoothed_dive(7, 10.0)
    np.testing.assert_allclose(states[-1].estimate.difference(core.estimate), 0.0, atol=2e-4)
    np.testing.assert_allclose(np.diag(states[-1].covariance), np.diag(core.covariance), rtol=1e-4)


def test_a_reset_keeps_what_came_later_from_what_was_before():
    """After a reset of the position, later fixes say nothing of the position before it."""
    recorder = StepRecorder(0.0)
    core = full_filter(recorder=recorder)
    core.predict_strapdown(resting(0.05))
    before = core.estimate.position_ned_m.copy(), core.covariance[:2, :2].copy()
    core.reset_block("position", (100.0, 0.0, 0.0), 1.0)
    core.predict_strapdown(resting(0.1))
    core.update(HorizontalPosition(0.1, 101.0, 0.0, 1e-4 * np.eye(2), wanders=False), None, None)
    first, second, third = smooth(recorder.steps)
    assert second.estimate.position_ned_m == pytest.approx(before[0], abs=1e-3)
    np.testing.assert_allclose(second.covariance[:2, :2], before[1], rtol=1e-6)
    assert first.estimate.position_ned_m[0] == pytest.approx(0.0, abs=1e-2)
    assert third.estimate.position_ned_m[0] == pytest.approx(101.0, abs=1e-2)


@dataclass(frozen=True)
class ShareOfWander:
    """A position with a share of GPS's slow error in it."""

    at_s: float
    value: np.ndarray
    share: np.ndarray
    sensor: str = "test"

    def evaluate(self, estimate, layout):
        place = layout["gps_wander"]
        jacobian = np.zeros((2, layout.size))
        jacobian[:, :2] = np.eye(2)
        jacobian[:, place] = self.share
        expected = estimate.values[:2] + self.share @ estimate.values[place]
        return Innovation(self.value - expected, jacobian, 0.04 * np.eye(2))


def test_errors_that_were_mixed_are_a_change_of_variables():
    """What is later measured of the mixed position is the same as if it had been measured of the old ones."""
    share = np.array([[0.5, 0.2], [0.0, -0.3], [0.0, 0.0]])
    recorders = StepRecorder(0.0), StepRecorder(0.0)
    cores = [full_filter(recorder=recorder) for recorder in recorders]
    fixes = np.random.default_rng(4).normal(size=(4, 2))
    for core in cores:
        core.predict_kinematic(1.0, 1e-3, 0.1)
        core.update(HorizontalPosition(1.0, *fixes[0], np.eye(2), "gps", (0.0, 0.0, 0.0), True))
    # Only once and without time between: the two differ in what the wander's decay does to the mixed position.
    cores[0].mix_errors("position", "gps_wander", share)
    for fix in fixes[1:]:
        cores[0].update(ShareOfWander(1.0, fix, np.zeros((2, 2))), None, None)
        cores[1].update(ShareOfWander(1.0, fix, share[:2]), None, None)
    for mixed, plain in zip(*(smooth(recorder.steps) for recorder in recorders), strict=True):
        np.testing.assert_allclose(mixed.covariance, plain.covariance, atol=1e-12)
    change = np.eye(FULL.size)
    change[:3, FULL["gps_wander"]] = share
    np.testing.assert_allclose(cores[0].covariance, change @ cores[1].covariance @ change.T, atol=1e-12)


def test_states_are_kept_as_far_apart_as_asked_and_the_ends_always():
    recorder = StepRecorder(0.25)
    core = full_filter(recorder=recorder)
    for step in range(1, 38):
        core.predict_strapdown(resting(0.05 * step))
    times = [state.at_s for state in smooth(recorder.steps)]
    assert times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 1.85])


def test_rewinding_forgets_what_came_after():
    once, twice = StepRecorder(0.1), StepRecorder(0.1)
    cores = full_filter(recorder=once), full_filter(recorder=twice)
    for step in range(1, 12):
        mark = twice.mark()
        estimate, covariance = cores[1].estimate.copy(), cores[1].covariance.copy()
        for core in cores:
            core.predict_strapdown(resting(0.05 * step))
            core.update(HorizontalPosition(core.at_s, 0.1 * step, 0.0, np.eye(2)))
        cores[1].predict_kinematic(core.at_s + 1.0)
        twice.rewind(mark)
        cores[1].estimate, cores[1].covariance = estimate, covariance
        cores[1].predict_strapdown(resting(0.05 * step))
        cores[1].update(HorizontalPosition(cores[1].at_s, 0.1 * step, 0.0, np.eye(2)))
    assert len(once.steps) == len(twice.steps)
    for ours, theirs in zip(smooth(once.steps), smooth(twice.steps), strict=True):
        assert ours.at_s == theirs.at_s
        np.testing.assert_array_equal(ours.estimate.values, theirs.estimate.values)
        np.testing.assert_array_equal(ours.covariance, theirs.covariance)


def test_nothing_recorded_is_nothing_smoothed():
    assert smooth([]) == []
