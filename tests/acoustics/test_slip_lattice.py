"""The lattice filter where the truth is known: simulated slips, and plain Kalman filtering as its special case."""

import math

import numpy as np
import pytest

from acoustics.slip_samples import (
    CELLS_MM,
    RANGE_MM,
    SD_MM,
    SIDE_MM,
    WAVELENGTH_MM,
    as_fixes,
    cell_probability,
    slipped_fixes,
)
from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.slip_lattice import Cells, Fixes, LatticeSettings, lattice_vectors_mm, run_lattice

ONE_CELL = np.zeros((1, 2))
NO_OUTLIERS = 1e-12


def plain_fixes(at_mm, interval_s, turn_deg=None):
    count = len(at_mm)
    turn = np.zeros((count, 3)) if turn_deg is None else turn_deg
    return Fixes(at_mm, interval_s, np.zeros((count, 2)), turn, RANGE_MM, Cells(ONE_CELL, np.ones(1), SD_MM))


def test_a_slip_of_one_period_moves_a_fix_by_a_lattice_vector():
    """Least squares over the three delays to receiver 0 of the thesis's square array, each slipped by one period."""
    receivers = ReceiverArray.cross(arm_m=0.25).positions_m * 1e3
    rows = (receivers[1:] - receivers[0])[:, 1:]  # delay to a direction (u_y, u_z), times the speed of sound
    vectors = lattice_vectors_mm(RANGE_MM, 0.0, WAVELENGTH_MM, 2.0 * 250.0 / math.sqrt(2.0))
    for pair in range(3):
        slip = np.zeros(3)
        slip[pair] = WAVELENGTH_MM
        moved = np.linalg.lstsq(rows, slip, rcond=None)[0] * RANGE_MM
        steps = np.linalg.solve(vectors.T, moved)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
        assert np.any(np.round(steps))


def test_the_bands_lie_as_far_apart_as_the_reference_says():
    for range_mm, spacing_mm in ((1300.0, 10.6), (1940.0, 15.8), (2520.0, 20.5), (3770.0, 30.6)):
        vectors = lattice_vectors_mm(range_mm, 0.0, 8.6, SIDE_MM)
        assert abs(vectors[1, 1]) == pytest.approx(spacing_mm, abs=0.15)


def test_one_cell_without_outliers_is_a_kalman_filter_and_its_smoother():
    rng = np.random.default_rng(1)
    interval = rng.uniform(1.0, 8.0, 40)
    truth = np.cumsum(rng.normal(0.0, 4.0, (40, 2)), axis=0)
    fixes = truth + rng.normal(0.0, SD_MM, truth.shape)
    settings = LatticeSettings(3.0, 5.0, yaw_sd_deg=0.2, yaw_time_s=30.0, outlier_share=NO_OUTLIERS)
    expected = full_filter(fixes, interval, settings)
    for smoothed, (at_mm, variance) in zip((False, True), expected, strict=True):
        found = run_lattice([plain_fixes(fixes, interval)], settings, smoothed=smoothed)
        np.testing.assert_allclose(found.at_mm[0], at_mm, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(found.variance_mm2[0], variance, rtol=1e-8)


def full_filter(fixes, interval, settings):
    """Three states (y, z, yaw error) with full matrices: filtered and smoothed positions with variances."""
    wobble = (math.radians(settings.yaw_sd_deg) * RANGE_MM) ** 2
    h = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    x, p = np.append(fixes[0], 0.0), np.diag([80.0**2, 80.0**2, wobble])
    after, before, steps = [], [], []
    for i, (fix, dt) in enumerate(zip(fixes, interval, strict=True)):
        decay = math.exp(-dt / settings.yaw_time_s)
        f = np.diag([1.0, 1.0, decay if i else 1.0])
        q = np.diag([settings.walk_y * dt, settings.walk_z * dt, wobble * (1.0 - decay**2)]) * (i > 0)
        x, p = f @ x, f @ p @ f.T + q
        before.append((x, p))
        k = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag(np.square(SD_MM)))
        x, p = x + k @ (fix - h @ x), p - k @ h @ p
        after.append((x, p))
        steps.append(f)
    smooth = [after[-1]]
    for i in range(len(fixes) - 2, -1, -1):
        (x, p), (x_next, p_next) = after[i], before[i + 1]
        g = p @ steps[i + 1].T @ np.linalg.inv(p_next)
        smooth.append((x + g @ (smooth[-1][0] - x_next), p + g @ (smooth[-1][1] - p_next) @ g.T))
    return [
        (np.array([x[:2] for x, _ in track]), np.array([np.diag(p)[:2] for _, p in track]))
        for track in (after, smooth[::-1])
    ]


@pytest.fixture
def still():
    """A platform that stands still while most fixes slip."""
    probability = cell_probability([0.35, 0.2, 0.15, 0.1, 0.1, 0.05, 0.05])
    truth = np.tile([30.0, -640.0], (400, 1))
    return truth, slipped_fixes(truth, probability, np.random.default_rng(5)), probability


def test_finds_a_still_platform_far_better_than_the_mean_of_slipped_fixes(still):
    truth, fixes, probability = still
    found = run_lattice([as_fixes(fixes, probability)], LatticeSettings(0.01, 0.01), smoothed=True).at_mm[0]
    largest = np.max(np.linalg.norm(found - truth, axis=1))
    assert largest < 2.0
    assert np.linalg.norm(fixes.mean(axis=0) - truth[0]) > 2.0 * largest


def test_a_walking_platform_is_followed_and_smoothing_helps():
    rng = np.random.default_rng(6)
    probability = cell_probability([0.6, 0.1, 0.1, 0.05, 0.05, 0.05, 0.05])
    truth = np.cumsum(rng.normal(0.0, math.sqrt(3.0 * 3.0), (600, 2)), axis=0)
    fixes = as_fixes(slipped_fixes(truth, probability, rng), probability)
    settings = LatticeSettings(3.0, 3.0)
    rms = {}
    for smoothed in (False, True):
        found = run_lattice([fixes], settings, smoothed=smoothed)
        error = found.at_mm[0] - truth
        rms[smoothed] = np.sqrt(np.mean(error**2))
        nees = np.mean(error**2 / found.variance_mm2[0])
        assert 0.5 < nees < 1.6
    plain = run_lattice([plain_fixes(fixes.at_mm, fixes.interval_s)], settings).at_mm[0] - truth
    assert rms[True] < rms[False] < 0.5 * np.sqrt(np.mean(plain**2))


def test_outliers_off_the_lattice_do_not_move_it(still):
    truth, fixes, probability = still
    fixes[50::40] += 600.0
    found = run_lattice([as_fixes(fixes, probability)], LatticeSettings(0.01, 0.01)).at_mm[0]
    assert np.max(np.linalg.norm(found[30:] - truth[30:], axis=1)) < 4.0


def test_cells_that_change_their_liking_do_not_move_a_still_platform(still):
    truth, fixes, probability = still
    fixes = np.concatenate([fixes, fixes + CELLS_MM[5]])
    settings = LatticeSettings(1e-3, 1e-3, learning=0.02)
    found = run_lattice([as_fixes(fixes, probability)], settings).at_mm[0]
    assert np.linalg.norm(found[-1] - truth[0]) < 3.0


def test_uses_displacements_as_far_as_they_are_trusted_and_turns_as_doubt():
    jump = np.zeros((60, 2))
    jump[30] = (100.0, 40.0)
    truth = np.cumsum(jump, axis=0)
    fixes = as_fixes(truth + np.random.default_rng(2).normal(0.0, SD_MM, truth.shape), np.eye(len(CELLS_MM))[0])
    told = as_fixes(fixes.at_mm, fixes.cells.probability, displacement_mm=jump)
    settings = LatticeSettings(0.01, 0.01, displacement_y=1.0, displacement_z=1.0)
    assert np.linalg.norm(run_lattice([told], settings).at_mm[0][31] - truth[31]) < 4.0
    turn = np.zeros((60, 3))
    turn[30, 0] = 8.0
    turning = as_fixes(fixes.at_mm, fixes.cells.probability, turn_deg=turn)
    doubting = LatticeSettings(0.01, 0.01, turn_y=300.0, turn_z=300.0)
    assert np.linalg.norm(run_lattice([turning], doubting).at_mm[0][31] - truth[31]) < 6.0


def test_logs_side_by_side_do_not_know_of_each_other(still):
    _, fixes, probability = still
    both = [as_fixes(fixes[:120], probability), as_fixes(fixes[100:], probability)]
    settings = LatticeSettings(0.1, 0.1, yaw_sd_deg=0.1)
    for smoothed in (False, True):
        together = run_lattice(both, settings, smoothed=smoothed)
        for place, alone in enumerate(both):
            single = run_lattice([alone], settings, smoothed=smoothed)
            np.testing.assert_allclose(together.at_mm[place][: len(alone.at_mm)], single.at_mm[0], atol=1e-9)
            assert together.log_likelihood[place] == pytest.approx(single.log_likelihood[0])
