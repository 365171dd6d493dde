"""Delays from simulated records: every method on a clear one, and what the joint estimate adds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses
from bluerov_slam.acoustics.pulse_train import PulseTrain, pulse_template
from bluerov_slam.acoustics.time_differences import METHODS, DelayPrior, Method, estimate_delays
from bluerov_slam.simulation.acoustic_paths import floor_below
from bluerov_slam.simulation.acoustic_record import (
    SAMPLE_RATE_HZ,
    AcousticSetup,
    Tolerances,
    Window,
    simulate_records,
)

ARRAY = ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])
SOUND_MPS = 343.0
PERIOD_S = 1.0 / 39_850.0
SLIP_S = 8e-6
SOURCES = np.array([[2.5, 0.4, -0.2], [1.3, -0.3, 0.1], [3.7, 0.9, 0.4]])
EQUAL = ReceiverResponses.identical(4)
ONSET = Window("ring", 2048, 448)

Array = NDArray[np.float64]


def sources(seed: int, draws: int, range_m: float) -> Array:
    rng = np.random.default_rng(seed)
    aside, down = np.radians(rng.uniform(-20, 20, draws)), np.radians(rng.uniform(-8, 8, draws))
    return range_m * np.column_stack((np.cos(aside) * np.cos(down), np.sin(aside) * np.cos(down), np.sin(down)))


@pytest.mark.parametrize("method", [each for each in METHODS if each != "phat"])
def test_a_clear_record_gives_the_true_delays(method: Method) -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=30.0), SOURCES, 3)
    template = pulse_template(PulseTrain.at_carrier((1, 1, 1, 1, 0, 0), 39_825.0), SAMPLE_RATE_HZ).samples
    tolerance = {"joint": 0.02e-6, "band_limited": 0.1e-6, "matched": 0.3e-6, "envelope": 20e-6}.get(method, 1.1e-6)
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, method, template=template)
        assert found.reference == 0
        assert found.receivers.tolist() == [0, 1, 2, 3]
        assert np.abs(found.delays_s - truth).max() < tolerance


def test_the_published_method_is_the_plain_correlation_in_whole_samples_without_skew() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=20.0), SOURCES, 4)
    for samples in many.samples:
        centred = samples - samples.mean(axis=1, keepdims=True)
        whole = [
            int(np.argmax(np.correlate(centred[0], centred[other], "full"))) - samples.shape[1] + 1
            for other in (1, 2, 3)
        ]
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, "thesis")
        assert found.delays_s * many.sample_rate_hz == pytest.approx(whole, abs=1e-9)


def test_no_slip_and_little_more_than_the_bound_at_0_db() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=0.0), sources(1, 150, 2.6), 5)
    errors = []
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=EQUAL)
        errors.append(found.delays_s - truth)
    assert np.abs(errors).max() < SLIP_S
    # 0.126 us is the bound of a pair of whole records; 150 x 3 errors scatter by 5 %.
    assert np.sqrt(np.mean(np.square(errors))) < 1.15 * 0.126e-6


def test_a_cut_off_pulse_leaves_no_floor() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=60.0, quantised=False), sources(2, 20, 2.6), 6)
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=EQUAL)
        assert np.abs(found.delays_s - truth).max() < 2e-9


def test_covariance_carrier_and_signal_to_noise_ratio_are_honest() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=10.0), sources(3, 60, 2.6), 7)
    squared = []
    for samples, truth, snr_db, carrier in zip(many.samples, many.delays_s, many.snr_db, many.carrier_hz, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=EQUAL)
        error = found.delays_s - truth
        squared.append(error @ np.linalg.solve(found.covariance_s2, error) / 3.0)
        assert found.slip_probability < 1e-3
        # The window common to all is a little quieter or louder than the record.
        assert found.snr_db == pytest.approx(snr_db, abs=2.0)
        assert found.carrier_hz == pytest.approx(carrier, rel=0.015)
    assert 0.7 < np.mean(squared) < 1.4


def test_unequal_receivers_are_within_what_is_said_of_uncalibrated_ones() -> None:
    setup = AcousticSetup(ARRAY, snr_db=20.0, tolerances=Tolerances(receiver_resonance=0.01))
    many = simulate_records(setup, sources(4, 60, 2.6), 8)
    squared = []
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS)
        error = found.delays_s - truth
        assert np.abs(error).max() < SLIP_S
        squared.append(error @ np.linalg.solve(found.covariance_s2, error) / 3.0)
    assert 0.5 < np.mean(squared) < 2.0


def test_five_receivers_and_three_work_as_well() -> None:
    centre = ReceiverArray.cross(centre=True)
    three = ReceiverArray(np.array([[0.0, 0.0, 0.2], [0.0, 0.2, -0.1], [0.1, -0.2, -0.1]]))
    for array in (centre, three):
        many = simulate_records(AcousticSetup(array, snr_db=20.0), SOURCES, 9)
        for samples, truth in zip(many.samples, many.delays_s, strict=True):
            found = estimate_delays(samples, many.sample_rate_hz, array, SOUND_MPS)
            assert np.abs(found.delays_s - truth).max() < 0.1e-6


def test_a_prior_a_cell_away_wins_over_the_weak_evidence_of_the_envelope() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=0.0), SOURCES[:1], 10)
    truth = many.delays_s[0]
    away = truth + PERIOD_S * np.array([1.0, 1.0, 0.0])  # closes: a whole direction one cell off
    sure = np.eye(3) * (0.5e-6) ** 2
    told = estimate_delays(
        many.samples[0], many.sample_rate_hz, ARRAY, SOUND_MPS, prior=DelayPrior(away, sure), responses=EQUAL
    )
    assert np.abs(told.delays_s - away).max() < 2e-6
    free = estimate_delays(many.samples[0], many.sample_rate_hz, ARRAY, SOUND_MPS, responses=EQUAL)
    vague = estimate_delays(
        many.samples[0],
        many.sample_rate_hz,
        ARRAY,
        SOUND_MPS,
        prior=DelayPrior(truth + 3e-6, np.eye(3) * (20e-6) ** 2),
        responses=EQUAL,
    )
    assert vague.delays_s == pytest.approx(free.delays_s, abs=1e-12)  # never moves a delay inside its cell


def test_alternatives_are_other_cells_with_their_probability() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=-9.0), sources(5, 12, 2.6), 11)
    seen = 0
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS)
        total = sum(probability for _, probability in found.alternatives)
        if not found.usable:
            continue
        assert total <= found.slip_probability + 1e-9
        for delays, _ in found.alternatives:
            assert np.abs(delays - found.delays_s).max() > 0.5 * PERIOD_S
            seen += 1
        near = [delays for delays, _ in found.alternatives if np.abs(delays - truth).max() < SLIP_S]
        assert near or np.abs(found.delays_s - truth).max() < SLIP_S
    assert seen > 0


@pytest.mark.parametrize("echo", [0.3, 0.6])
def test_an_echo_from_the_floor_does_not_move_the_cell_of_a_record_with_its_onset(echo: float) -> None:
    wrong = {"ring": 0, "blocks": 0}
    for mode in wrong:
        setup = AcousticSetup(
            ARRAY,
            reflectors=(floor_below(0.66, echo),),
            tolerances=Tolerances(receiver_resonance=0.01, filter_corner=0.1),
            snr_db=15.0,
            window=ONSET if mode == "ring" else Window(),
        )
        places = sources(6, 40, 3.8)
        places[:, 2] = 0.0
        many = simulate_records(setup, places, 12)
        for samples, truth in zip(many.samples, many.delays_s, strict=True):
            found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS)
            wrong[mode] += not found.usable or bool(np.abs(found.delays_s - truth).max() > SLIP_S)
    assert wrong["ring"] == 0
    assert echo < 0.5 or wrong["blocks"] > 10  # without the onset nothing tells the echo from the pulse


def test_without_an_echo_the_whole_record_is_used() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=15.0, window=ONSET), sources(7, 30, 3.8), 13)
    found = [
        estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=EQUAL) for samples in many.samples
    ]
    assert not any(each.onset_only for each in found)


def test_a_common_line_is_named_and_taken_out() -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=20.0, window=ONSET), sources(8, 12, 2.6), 14)
    line = 100.0 * np.cos(2.0 * np.pi * 39_000.0 * np.arange(2048) / many.sample_rate_hz + 1.0)
    errors = []
    subtracted = 0
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples + line, many.sample_rate_hz, ARRAY, SOUND_MPS)
        assert found.remark.startswith("common pick-up of ")
        subtracted += found.remark.endswith("subtracted")
        assert np.abs(found.delays_s - truth).max() < SLIP_S
        if found.remark.endswith("subtracted"):
            errors.append(found.delays_s - truth)
    assert subtracted > 6  # the others hold too little before the onset
    assert np.sqrt(np.mean(np.square(errors))) < 0.1e-6
