"""Bounds: against closed forms, numbers, and estimates that reach them."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.acoustics import bounds
from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.position import solve_source
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_records

RATE_HZ = 851_393.19
ARRAY = ReceiverArray.cross()
SOUND_MPS = 343.0


def test_two_equal_receivers_have_the_textbook_variance() -> None:
    wave = np.sin(2.0 * np.pi * 40e3 * np.arange(2048) / RATE_HZ)
    energy = (2.0 * np.pi * 40e3) ** 2 * 1024
    assert bounds.derivative_energy(wave[None], RATE_HZ)[0] == pytest.approx(energy, rel=0.005)
    assert bounds.pair_timing_std_s(wave, RATE_HZ, 0.1) == pytest.approx(0.1 * np.sqrt(2.0 / energy), rel=0.003)


def test_a_pair_at_0_db_is_timed_to_an_eighth_of_a_microsecond() -> None:
    quiet = AcousticSetup(ARRAY, snr_db=300.0, quantised=False)
    clean = simulate_records(quiet, np.array([[2.6, 0.0, 0.0]]), 1).samples[0, 0]
    least = bounds.pair_timing_std_s(clean, RATE_HZ, float(np.std(clean)))
    assert least == pytest.approx(0.126e-6, rel=0.04)  # the reference's study


def test_delays_to_a_common_reference_share_its_error() -> None:
    covariance = bounds.delay_covariance(np.full(4, 8.0), np.full(4, 2.0))
    assert covariance == pytest.approx((np.eye(3) + 1.0) * 0.25)
    deaf = bounds.delay_covariance(np.array([8.0, 8.0, 1e-9]), np.full(3, 2.0))
    assert deaf[0, 0] == pytest.approx(0.5)
    assert deaf[1, 1] > 1e8


def test_what_one_record_holds_alone_does_not_count() -> None:
    rng = np.random.default_rng(0)
    wave = rng.standard_normal(3000)
    wave = np.convolve(wave, np.ones(9) / 9.0, "same")
    late = 500
    pair = np.stack((wave[late : late + 2000], wave[:2000]))  # the second hears the same later
    apart = bounds.record_delay_covariance(pair, np.array([0.0, late / RATE_HZ]), RATE_HZ, 0.1)
    common = np.gradient(wave[late:2000]) ** 2
    whole = np.gradient(pair[0]) ** 2
    expected = np.sqrt(whole.sum() / common.sum())
    together = bounds.record_delay_covariance(np.stack((pair[0], pair[0])), np.zeros(2), RATE_HZ, 0.1)
    assert np.sqrt(apart[0, 0] / together[0, 0]) == pytest.approx(expected, rel=0.1)


def test_position_and_direction_follow_from_the_delays() -> None:
    covariance = bounds.delay_covariance(np.full(4, 1.0), np.full(4, (0.1e-6) ** 2))
    source = np.array([2.6, 0.4, -0.1])
    exact = bounds.position_covariance(ARRAY.positions_m, covariance, SOUND_MPS, source, 0.0, (1, 0, 0))
    assert exact[0] == pytest.approx(np.zeros(3), abs=1e-20)
    loose = bounds.position_covariance(ARRAY.positions_m, covariance, SOUND_MPS, source, 0.05, (1, 0, 0))
    assert np.sqrt(loose[0, 0]) == pytest.approx(0.05, rel=0.05)
    assert np.sqrt(loose[1, 1]) == pytest.approx(0.05 * 0.4 / 2.6, rel=0.2)  # depth enters as the angle's tangent


def test_far_away_direction_and_position_say_the_same() -> None:
    covariance = bounds.delay_covariance(np.full(4, 1.0), np.full(4, (0.1e-6) ** 2))
    ahead = np.array([1.0, 0.0, 0.0])
    direction = bounds.direction_covariance(ARRAY.positions_m, covariance, SOUND_MPS, ahead)
    position = bounds.position_covariance(ARRAY.positions_m, covariance, SOUND_MPS, 1e4 * ahead, 0.0, ahead)
    assert position == pytest.approx(1e8 * direction, rel=1e-6, abs=1e-12)
    # Two baselines of 2h on each axis, each timed to sqrt(2) of an arrival: u_y is known to c sd / (2h).
    assert np.sqrt(direction[1, 1]) == pytest.approx(SOUND_MPS * 0.1e-6 / (2.0 * 0.25 / np.sqrt(2.0)), rel=1e-9)


def test_weighted_least_squares_reaches_the_bound() -> None:
    rng = np.random.default_rng(1)
    covariance = bounds.delay_covariance(np.full(4, 1.0), np.full(4, (0.1e-6) ** 2))
    source = np.array([2.6, 0.5, 0.2])
    truth = ARRAY.delays_s(source, SOUND_MPS)
    root = np.linalg.cholesky(covariance)
    errors = []
    for _ in range(300):
        delays = truth + root @ rng.standard_normal(3)
        depth = source[0] + 1e-3 * rng.standard_normal()
        found = solve_source(
            ARRAY.positions_m, delays, covariance, SOUND_MPS, depth=(depth, 1e-3), down=(1.0, 0.0, 0.0)
        )
        if found.position_m is not None:  # one in a thousand is withheld
            errors.append(found.position_m - source)
    least = bounds.position_covariance(ARRAY.positions_m, covariance, SOUND_MPS, source, 1e-3, (1.0, 0.0, 0.0))
    assert len(errors) > 295
    ratio = np.mean(np.square(errors), axis=0)[1:] / np.diag(least)[1:]
    assert np.all((ratio > 0.8) & (ratio < 1.25))
