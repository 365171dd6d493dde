"""Bad receivers and bad records: left out by name, and an answer that is honest or absent."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.time_differences import TimeDifferences, estimate_delays
from bluerov_slam.simulation.acoustic_record import SAMPLE_RATE_HZ, AcousticSetup, simulate_records

ARRAY = ReceiverArray.cross()
SOUND_MPS = 343.0
SOURCE = np.array([[2.4, 0.5, 0.3]])
MANY = simulate_records(AcousticSetup(ARRAY, snr_db=20.0), SOURCE, 1)
TRUTH = MANY.delays_s[0]
Array = NDArray[np.float64]


def estimate(samples: Array) -> TimeDifferences:
    return estimate_delays(samples, SAMPLE_RATE_HZ, ARRAY, SOUND_MPS)


def test_a_dead_receiver_is_left_out_and_the_others_answer() -> None:
    samples = MANY.samples[0].copy()
    samples[2] = 7.0
    found = estimate(samples)
    assert found.receivers.tolist() == [0, 1, 3]
    assert found.delays_s == pytest.approx(TRUTH[[0, 2]], abs=0.1e-6)
    assert np.isnan(found.snr_db[2])
    (remark,) = found.excluded
    assert remark[0] == 2
    assert remark[1].startswith("dead")


def test_a_dead_reference_hands_its_part_to_the_next() -> None:
    samples = MANY.samples[0].copy()
    samples[0] = 0.0
    found = estimate(samples)
    assert found.reference == 1
    assert found.delays_s == pytest.approx((TRUTH - TRUTH[0])[1:], abs=0.1e-6)


def test_a_silent_receiver_is_left_out() -> None:
    samples = MANY.samples[0].copy()
    samples[3] = np.rint(20.0 * np.random.default_rng(2).standard_normal(samples.shape[1]))
    found = estimate(samples)
    assert found.receivers.tolist() == [0, 1, 2]
    assert found.excluded[0][1].startswith("silent")


def test_a_clipped_receiver_is_left_out_while_three_others_remain() -> None:
    samples = MANY.samples[0].copy()
    samples[1] = np.clip(samples[1] * 8.0, -2048, 2047)
    found = estimate(samples)
    assert found.receivers.tolist() == [0, 2, 3]
    assert found.excluded[0][1].startswith("clipped")
    two = np.clip(MANY.samples[0] * 8.0, -2048, 2047)  # all: better a clipped answer than none
    assert estimate(two).delays_s == pytest.approx(TRUTH, abs=0.5e-6)


def test_noise_alone_gives_no_delays_and_says_so() -> None:
    found = estimate(np.rint(30.0 * np.random.default_rng(3).standard_normal((4, 2048))))
    assert not found.usable
    assert found.excluded[-1][1].startswith("silent")
    assert found.excluded[0] == (-1, "fewer than two receivers heard a pulse")


def test_a_short_record_and_one_of_another_rate_are_refused_in_words() -> None:
    short = estimate(MANY.samples[0][:, :300])
    assert not short.usable
    assert "one bit of a pulse" in short.excluded[0][1]
    other = estimate_delays(MANY.samples[0], 0.5 * SAMPLE_RATE_HZ, ARRAY, SOUND_MPS)
    assert not other.usable
    assert any("not sampled at" in text for _, text in other.excluded)


def test_samples_that_are_not_numbers_give_no_delays() -> None:
    samples = MANY.samples[0].copy()
    samples[0, 5] = np.nan
    assert not estimate(samples).usable


def test_exchanged_neighbours_are_named_from_a_direction_that_shows_them() -> None:
    places = np.array([[2.3, 0.9, 0.6], [2.3, -0.8, 0.7], [2.4, 0.7, -0.6]])
    many = simulate_records(AcousticSetup(ARRAY, snr_db=20.0), places, 4)
    for samples in many.samples:
        found = estimate_delays(samples[[1, 0, 2, 3]], SAMPLE_RATE_HZ, ARRAY, SOUND_MPS)
        assert not found.usable
        named = {receiver for receiver, _ in found.excluded}
        assert {0, 1} <= named
        assert "exchanged" in found.excluded[0][1]


def test_a_record_of_another_array_is_a_mistake_of_the_caller() -> None:
    with pytest.raises(ValueError, match="expected 4 receivers"):
        estimate(MANY.samples[0][:3])
