"""The bounds reproduce the study that the targets come from (slam.md 4.3), and textbook cases."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.evaluation.bounds import (
    CALM,
    HARD,
    Beacon,
    Bound,
    Fixes,
    Gyro,
    Track,
    Uncertainty,
    bound,
    causal_bound,
    lawnmower,
)

pytest.importorskip("scipy", reason="SciPy is not installed: pip install 'bluerov-slam[survey]'")

TRACK = lawnmower()
START = Fixes([0], 1.5)
BOTH_ENDS = Fixes([0, TRACK.steps], 1.5)
CENTRE = Beacon((90.0, 40.0), 10.0, math.radians(3.0), 5)
STUDIED = 0.10  # how close the published figures have to be met: they are rounded to two or three digits


def row(name: str, uncertainty: Uncertainty) -> Bound:
    match name:
        case "a":
            return bound(TRACK, uncertainty, START)
        case "b":
            return bound(TRACK, uncertainty, BOTH_ENDS)
        case "m":
            return bound(TRACK, uncertainty.with_dvl(), START)
        case "o":
            return bound(TRACK, uncertainty, Fixes(range(0, 400, 5), 1.0))
        case "i":
            return bound(TRACK, uncertainty, START, beacon=CENTRE)
    raise AssertionError(name)


@pytest.mark.parametrize(
    ("name", "water", "ate_m", "end_percent"),
    [
        ("a", HARD, 323.0, 57.0),
        ("a", CALM, 83.0, 15.0),
        ("b", HARD, 15.0, None),
        ("b", CALM, 7.8, None),
        ("m", HARD, 16.5, 2.9),
        ("m", CALM, 11.1, 1.9),
        ("o", HARD, 34.0, 6.7),
        ("o", CALM, 22.0, 4.1),
        ("i", HARD, 1.9, None),
        ("i", CALM, 1.5, None),
    ],
)
def test_reproduces_the_published_study(name: str, water: Uncertainty, ate_m: float, end_percent: float | None) -> None:
    got = row(name, water)
    assert got.ate_m == pytest.approx(ate_m, rel=STUDIED)
    if end_percent is not None:
        assert 100.0 * got.end_m / TRACK.distance_m == pytest.approx(end_percent, rel=STUDIED)


def straight(steps: int, speed_mps: float = 1.0) -> Track:
    north = np.arange(steps + 1) * speed_mps
    return Track(
        1.0, np.column_stack((north, 0.0 * north)), np.zeros(steps), np.full(steps, speed_mps), np.zeros(steps)
    )


NOTHING_BUT_NOISE = Uncertainty(0.0, 0.0, 1e-9, 1e-9, 1e-9, odometry_mps_rt_s=0.1, slip_share=0.0)


def test_white_odometry_noise_grows_with_the_square_root_of_time() -> None:
    got = bound(straight(400), NOTHING_BUT_NOISE, Fixes([0], 1e-6))
    assert got.end_m == pytest.approx(0.1 * math.sqrt(2 * 400), rel=1e-3)
    assert got.ate_m == pytest.approx(0.1 * math.sqrt(2 * 200), rel=0.01)
    assert got.end_dof == pytest.approx(2.0, rel=1e-3)


def test_two_fixes_make_a_brownian_bridge() -> None:
    got = bound(straight(400), NOTHING_BUT_NOISE, Fixes([0, 400], 1e-6), epochs=np.array([200]))
    assert got.end_m == pytest.approx(0.1 * math.sqrt(2 * 400 / 4), rel=1e-3)


def test_a_heading_error_turns_a_straight_line_about_its_start() -> None:
    only_compass = Uncertainty(0.0, 0.0, 1e-6, math.radians(3.0), 1e-6, odometry_mps_rt_s=1e-3, slip_share=0.0)
    got = bound(straight(400), only_compass, Fixes([0], 1e-3))
    # To the north the deviation is A + B: two of the three thirds of the variance.
    assert got.end_m == pytest.approx(400 * math.radians(3.0) * math.sqrt(2 / 3), rel=1e-3)
    assert got.end_dof == pytest.approx(1.0, abs=1e-3)


def test_fixes_that_wander_together_are_worth_one_not_many() -> None:
    standing = straight(100, 0.0)
    still = Uncertainty(0.0, 0.0, 1e-9, 1e-9, 1e-9, odometry_mps_rt_s=1e-6, slip_share=0.0)
    white = bound(standing, still, Fixes(range(101), 1.5))
    assert white.end_m == pytest.approx(1.5 * math.sqrt(2 / 101), rel=1e-3)
    wandering = bound(standing, still, Fixes(range(101), 0.1, 1.5, correlation_s=1e6))
    assert wandering.end_m == pytest.approx(1.5 * math.sqrt(2), rel=0.01)


def test_a_perfect_gyro_shows_the_deviation_that_turns_with_the_vehicle() -> None:
    hard_dvl = HARD.with_dvl()
    without = bound(TRACK, hard_dvl, BOTH_ENDS)
    gyro = Gyro(noise_rad_rt_s=1e-6, bias_radps=1e-9, bias_walk_radps_rt_s=1e-12, compass_noise_rad=math.radians(1.0))
    with_gyro = bound(TRACK, hard_dvl, BOTH_ENDS, gyro=gyro)
    assert with_gyro.ate_m < 0.6 * without.ate_m
    useless = Gyro(noise_rad_rt_s=1.0, bias_radps=1.0, bias_walk_radps_rt_s=1e-3, compass_noise_rad=1e-6)
    assert bound(TRACK, hard_dvl, BOTH_ENDS, gyro=useless).ate_m == pytest.approx(without.ate_m, rel=0.01)


def test_what_comes_later_does_not_help_a_causal_estimate() -> None:
    epochs = np.array([500, 1500, TRACK.steps])
    smoothed = bound(TRACK, HARD, BOTH_ENDS, epochs=epochs)
    smoothed_m = np.sqrt(np.diag(smoothed.covariance_m2)[:3] + np.diag(smoothed.covariance_m2)[3:])
    causal_m = causal_bound(TRACK, HARD, BOTH_ENDS, epochs.tolist())
    assert causal_m[0] > 3.0 * smoothed_m[0]
    assert causal_m[1] > 3.0 * smoothed_m[1]
    assert causal_m[2] == pytest.approx(smoothed_m[2], rel=1e-6)


def test_a_sampled_error_has_the_covariance_the_bound_says() -> None:
    """Random worlds solved by least squares, without the bound's own machinery, spread as the bound says."""
    rng = np.random.default_rng(4)
    track = straight(60)
    water = Uncertainty(0.1, 1e-6, 0.1, 1e-9, 1e-9, odometry_mps_rt_s=0.2, slip_share=0.0)
    fixed = [0, 20, 60]
    expected = bound(track, water, Fixes(fixed, 0.5), epochs=np.array([40])).covariance_m2
    # North: position at each step is start + (current + scale) t + walk; known are the fixes and the odometry.
    worlds, steps = 4000, 60
    drift = rng.normal(0, 0.1, worlds) + rng.normal(0, 0.1, worlds)
    walk = np.cumsum(rng.normal(0, 0.2, (worlds, steps)), axis=1)
    error = np.column_stack((np.zeros(worlds), walk)) + drift[:, None] * np.arange(steps + 1)
    seen = error[:, fixed] + rng.normal(0, 0.5, (worlds, 3))
    times = np.array([*fixed, 40.0])
    covariance = 0.04 * np.minimum.outer(times, times) + 0.02 * np.outer(times, times) + 1e6
    noisy = covariance[:3, :3] + 0.25 * np.eye(3)
    estimate = seen @ np.linalg.solve(noisy, covariance[:3, 3])
    assert np.var(estimate - error[:, 40]) == pytest.approx(expected[0, 0], rel=0.08)


def test_a_mounting_error_turns_the_velocity_but_not_the_compass() -> None:
    crooked = replace(NOTHING_BUT_NOISE, odometry_mps_rt_s=1e-3, mounting_rad=math.radians(1.0))
    got = bound(straight(400), crooked, Fixes([0], 1e-3))
    assert got.end_m == pytest.approx(400 * math.radians(1.0), rel=1e-3)


def test_a_scale_of_its_own_for_the_sideways_velocity_leaves_the_forward_one_alone() -> None:
    crabbing = replace(straight(400), sideways_mps=np.full(400, 0.5))
    scaled = replace(NOTHING_BUT_NOISE, odometry_mps_rt_s=1e-3, speed_scale=0.1, sway_share=0.5)
    end = bound(crabbing, scaled, Fixes([0], 1e-3)).end_covariance_m2()
    assert np.sqrt(np.diag(end)) == pytest.approx((40.0, 10.0), rel=1e-3)
