"""Simulated records against the physics that made them."""

import dataclasses

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.pulse_train import PulseTrain, frame_bits, pulse_template
from bluerov_slam.simulation.acoustic_paths import floor_below
from bluerov_slam.simulation.acoustic_record import (
    SAMPLE_RATE_HZ,
    AcousticSetup,
    Tolerances,
    Window,
    simulate_record,
    simulate_records,
)

ARRAY = ReceiverArray.cross(sample_skew_s=[0.0, 0.42e-6, 0.0, 0.42e-6])
SOURCE_M = np.array([2.6, 0.4, -0.2])
WHOLE = AcousticSetup(ARRAY, snr_db=200.0, quantised=False, window=Window("onset", 9000, 400))


def _phase_delay_s(first, second, expected_s):
    """Delay of `first` behind `second` by the phase of their cross spectrum near the carrier, about an expected one."""
    frequency_hz = np.fft.rfftfreq(len(first), 1.0 / SAMPLE_RATE_HZ)
    band = (frequency_hz > 39_000.0) & (frequency_hz < 40_500.0)
    cross = np.fft.rfft(first)[band] * np.conj(np.fft.rfft(second)[band])
    turned = (cross * np.exp(2j * np.pi * frequency_hz[band] * expected_s)).sum()
    return expected_s - np.angle(turned) / (2.0 * np.pi * 39_800.0)


def test_delays_and_skew_in_the_samples_are_the_true_ones():
    record = simulate_record(WHOLE, SOURCE_M, 7)
    skew_s = ARRAY.sample_skew_s
    range_m = np.linalg.norm(SOURCE_M - ARRAY.positions_m, axis=1)
    assert record.delays_s == pytest.approx((range_m[0] - range_m[1:]) / 343.0, abs=1e-15)
    for i in (1, 2, 3):
        in_samples_s = record.delays_s[i - 1] - (skew_s[0] - skew_s[i])
        measured_s = _phase_delay_s(record.samples[0], record.samples[i], in_samples_s)
        assert measured_s == pytest.approx(in_samples_s, abs=1e-12)


def test_the_wave_is_the_template_at_its_arrival():
    record = simulate_record(WHOLE, SOURCE_M, 3)
    template = pulse_template(
        PulseTrain.at_carrier(record.bits, record.carrier_hz), SAMPLE_RATE_HZ, ring_s=2e-3
    ).samples
    padded = np.zeros(9000)
    padded[: len(template)] = template
    measured_s = _phase_delay_s(record.samples[0], padded, record.toa_s[0])
    assert measured_s == pytest.approx(record.toa_s[0], abs=1e-11)


def test_the_quiet_before_the_onset_is_quiet():
    record = simulate_record(WHOLE, SOURCE_M, 5)
    onset = int(record.toa_s.min() * SAMPLE_RATE_HZ)
    assert 395 <= onset <= 402
    assert np.abs(record.samples[:, : onset - 2]).max() < 1e-3 * np.abs(record.samples).max()


@pytest.mark.parametrize("snr_db", [0.0, 20.0])
def test_the_noise_is_what_the_ratio_says(snr_db):
    setup = dataclasses.replace(WHOLE, snr_db=snr_db, window=Window(), carrier_hz=(39_800.0, 39_800.0))
    noisy = simulate_records(setup, np.tile(SOURCE_M, (50, 1)), 1)
    clean = simulate_records(dataclasses.replace(setup, snr_db=300.0), np.tile(SOURCE_M, (50, 1)), 1)
    noise = noisy.samples - clean.samples
    ratio_db = 10.0 * np.log10(np.mean(clean.samples**2) / np.mean(noise**2))
    assert ratio_db == pytest.approx(snr_db, abs=0.1)
    assert noisy.snr_db.mean() == pytest.approx(snr_db, abs=0.3)


def test_the_thesis_window_loses_the_onset_and_ends_in_the_zero_after_four_ones():
    records = simulate_records(AcousticSetup(ARRAY), np.tile(SOURCE_M, (200, 1)), 2)
    assert records.samples.shape == (200, 4, 2048)
    assert records.triggered.all()
    first_s = records.toa_s.min(axis=1)
    assert (first_s < 0.0).all()
    assert (first_s > -0.5e-3).all()  # inside bit 1
    ends_in_bit = (2048 / SAMPLE_RATE_HZ - first_s) / (40 * 0.5 / records.carrier_hz)
    assert (ends_in_bit > 4.8).all()
    assert (ends_in_bit < 6.0).all()


def test_the_ring_buffer_keeps_the_onset():
    setup = AcousticSetup(ARRAY, window=Window("ring", 2048, 448))
    records = simulate_records(setup, np.tile(SOURCE_M, (100, 1)), 2)
    assert (records.toa_s.min(axis=1) > 0.0).all()
    assert records.trigger_index == 448


def test_a_set_of_receivers_stays_the_same_over_draws_and_seeds():
    setup = AcousticSetup(ARRAY, tolerances=Tolerances(receiver_resonance=0.01), receiver_set=4)
    first = simulate_records(setup, np.tile(SOURCE_M, (3, 1)), 1).receiver_hz
    again = simulate_records(setup, np.tile(SOURCE_M, (3, 1)), 2).receiver_hz
    assert np.ptp(first, axis=0).max() == 0.0
    assert first.tolist() == again.tolist()
    assert np.std(first[0]) > 50.0
    fresh = simulate_records(dataclasses.replace(setup, receiver_set=None), np.tile(SOURCE_M, (300, 1)), 1).receiver_hz
    assert fresh.std() / 40_000.0 == pytest.approx(0.01, rel=0.15)


def test_a_floor_echo_arrives_late_by_its_detour():
    pulse = dataclasses.replace(WHOLE, bits=(1,), carrier_hz=(39_800.0, 39_800.0))
    source_m = np.array([1.3, 0.0, 0.0])
    image_m = np.array([1.3, 0.0, 1.32])
    direct = simulate_record(pulse, source_m, 1)
    both = simulate_record(dataclasses.replace(pulse, reflectors=(floor_below(0.66, 0.5),)), source_m, 1)
    echo = np.abs(both.samples / np.abs(both.samples).max() - direct.samples / np.abs(direct.samples).max())
    begins_s = np.argmax(echo > 0.02 * echo.max(axis=1, keepdims=True), axis=1) / SAMPLE_RATE_HZ
    arrival_s = (
        direct.toa_s
        + (np.linalg.norm(image_m - ARRAY.positions_m, axis=1) - np.linalg.norm(source_m - ARRAY.positions_m, axis=1))
        / 343.0
    )
    assert (begins_s - arrival_s > 0.0).all()
    assert (begins_s - arrival_s < 0.08e-3).all()


def test_the_converter_clips_and_says_so():
    setup = AcousticSetup(ARRAY, peak_counts=3000.0)
    records = simulate_records(setup, np.tile(SOURCE_M, (2, 1)), 1)
    assert records.clipped.any()
    assert records.samples.max() == 2047.0
    assert records.samples.min() == -2048.0
    assert (records.samples == np.rint(records.samples)).all()


def test_out_of_range_nothing_trips():
    setup = AcousticSetup(ARRAY, peak_counts=None, snr_db=None, noise_counts=3.0)
    records = simulate_records(setup, np.array([[300.0, 0.0, 0.0], [3.0, 0.0, 0.0]]), 1)
    assert records.triggered.tolist() == [False, True]


def test_the_same_seed_gives_the_same_records_and_another_seed_others():
    one = simulate_record(AcousticSetup(ARRAY), SOURCE_M, 11).samples
    assert np.array_equal(one, simulate_record(AcousticSetup(ARRAY), SOURCE_M, 11).samples)
    assert not np.array_equal(one, simulate_record(AcousticSetup(ARRAY), SOURCE_M, 12).samples)


def test_the_message_counter_is_drawn_when_no_bits_are_given():
    records = simulate_records(AcousticSetup(ARRAY), np.tile(SOURCE_M, (20, 1)), 1)
    assert len({tuple(row) for row in records.bits.tolist()}) > 10
    assert (records.bits[:, :6] == np.array(frame_bits(0)[:6])).all()
