"""Receivers' resonances from records alone: right, honest, and absent where records are too few."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses, estimate_responses, resonance
from bluerov_slam.acoustics.time_differences import estimate_delays
from bluerov_slam.simulation.acoustic_record import AcousticSetup, SimulatedRecords, Tolerances, simulate_records

ARRAY = ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])
SOUND_MPS = 343.0


def records(receiver_set: int, draws: int, seed: int, quality: float = 0.0) -> SimulatedRecords:
    rng = np.random.default_rng(seed)
    aside, down = np.radians(rng.uniform(-20, 20, draws)), np.radians(rng.uniform(-8, 8, draws))
    places = 2.2 * np.column_stack((np.cos(aside) * np.cos(down), np.sin(aside) * np.cos(down), np.sin(down)))
    tolerances = Tolerances(receiver_resonance=0.01, receiver_q=quality)
    setup = AcousticSetup(ARRAY, snr_db=20.0, tolerances=tolerances, receiver_set=receiver_set)
    return simulate_records(setup, places, seed)


def test_resonances_come_from_records_without_truth_and_mend_the_delays() -> None:
    learnt_from = records(3, 30, 50, quality=0.05)
    estimate = estimate_responses(learnt_from.samples, learnt_from.sample_rate_hz, ARRAY, SOUND_MPS)
    assert estimate.reason == ""
    assert estimate.records == 30
    true_share = np.log(learnt_from.receiver_hz[0] / learnt_from.receiver_hz[0].mean())
    share = np.log(estimate.responses.resonance_hz / estimate.responses.resonance_hz.mean())
    assert share == pytest.approx(true_share, abs=0.0008)
    many = records(3, 30, 51, quality=0.05)
    errors = {}
    for name, responses in (("none", None), ("learnt", estimate.responses)):
        found = [
            estimate_delays(each, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=responses) for each in many.samples
        ]
        errors[name] = np.sqrt(np.mean((np.array([each.delays_s for each in found]) - many.delays_s) ** 2))
    assert errors["learnt"] < 0.1e-6
    assert errors["learnt"] < 0.35 * errors["none"]


def test_the_remaining_error_is_within_what_is_stated() -> None:
    squared = []
    for receiver_set in range(4):
        learnt_from = records(receiver_set, 24, 60 + receiver_set)
        responses = estimate_responses(learnt_from.samples, learnt_from.sample_rate_hz, ARRAY, SOUND_MPS).responses
        many = records(receiver_set, 12, 70 + receiver_set)
        for samples, truth in zip(many.samples, many.delays_s, strict=True):
            found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=responses)
            error = found.delays_s - truth
            squared.append(error @ np.linalg.solve(found.covariance_s2, error) / 3.0)
    assert 0.2 < np.mean(squared) < 2.0


def test_few_or_unusable_records_give_nominal_responses_and_a_reason() -> None:
    some = records(1, 9, 80).samples
    some[4:, 2] = 0.0  # a dead receiver from then on
    estimate = estimate_responses(some, 851_393.19, ARRAY, SOUND_MPS)
    assert estimate.records == 4
    assert "expected 8" in estimate.reason
    assert np.isinf(estimate.responses.delay_std_s)
    assert estimate.responses.equal


def test_equal_receivers_are_their_own_reference() -> None:
    frequencies = np.linspace(36e3, 44e3, 9)
    equal = ReceiverResponses.identical(3)
    assert equal.equal
    assert equal.relative(frequencies) == pytest.approx(np.ones((3, 9)))
    assert resonance(np.array([40e3]), 40e3, 16.0)[0] == pytest.approx(1.0)
    half = resonance(np.array([40e3 * (1.0 + 0.5 / 16.0)]), 40e3, 16.0)[0]
    assert abs(half) == pytest.approx(np.sqrt(0.5), rel=0.02)
