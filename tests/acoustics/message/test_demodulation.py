"""Whole frames through the simulated way and back."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.message.demodulation import DemodulatedFrame, demodulate
from bluerov_slam.acoustics.message.frame import MESSAGE_FRAME_BITS, message_frame_bits
from bluerov_slam.acoustics.message.report import BeaconReport
from bluerov_slam.simulation.acoustic_paths import floor_below
from bluerov_slam.simulation.acoustic_record import AcousticSetup, SimulatedRecord, Tolerances, Window, simulate_record

_RATE_HZ = 106_424.0  # an eighth of the board's: what a message record needs
_PAYLOAD = BeaconReport(46.5, -124.1, 2.0, 1_234_567, 1.5).pack()


def _record(snr_db: float, seed: int = 3, **changes: object) -> SimulatedRecord:
    setup = AcousticSetup(
        ReceiverArray.cross(),
        sample_rate_hz=_RATE_HZ,
        bits=message_frame_bits(201, _PAYLOAD),
        window=Window("onset", 19_500, 600),
        snr_db=snr_db,
        **changes,  # type: ignore[arg-type]
    )
    return simulate_record(setup, (2.5, 0.4, -0.2), seed)


def _heard(record: SimulatedRecord) -> DemodulatedFrame:
    frame = demodulate(record.samples, record.sample_rate_hz)
    assert frame is not None
    return frame


def test_frame_starts_with_the_thesis_frame() -> None:
    bits = message_frame_bits(201, _PAYLOAD)

    assert len(bits) == MESSAGE_FRAME_BITS == 327
    assert bits[:14] == (1, 1, 1, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 1)


def test_message_counter_carrier_and_onset_come_back() -> None:
    record = _record(10.0)

    frame = _heard(record)

    assert frame.payload == _PAYLOAD
    assert frame.counter == 201
    assert frame.corrected_errors == 0
    assert frame.hard_bits.tolist() == list(message_frame_bits(201, _PAYLOAD))
    assert frame.carrier_hz == pytest.approx(record.carrier_hz, abs=0.05)
    assert frame.start_s == pytest.approx(float(record.toa_s.min()), abs=3e-5)


def test_nominal_and_slow_clocks_are_both_found() -> None:
    for carrier_hz in (39_750.0, 40_404.0):
        record = _record(5.0, carrier_hz=(carrier_hz, carrier_hz))
        assert _heard(record).payload == _PAYLOAD


def test_weak_signal_is_corrected() -> None:
    # An eighth of the board's samples at -9 dB hold the bit energy that all of them hold at -18 dB.
    frames = [_heard(_record(-9.0, seed)) for seed in range(6)]

    assert [frame.payload for frame in frames] == [_PAYLOAD] * 6
    assert sum(frame.corrected_errors for frame in frames) > 0


def test_strong_late_echo_is_equalised() -> None:
    mismatch = Tolerances(receiver_resonance=0.01, filter_corner=0.1)
    frames = [
        _heard(_record(10.0, seed, reflectors=(floor_below(0.66, 0.8),), tolerances=mismatch)) for seed in range(6)
    ]

    assert [frame.payload for frame in frames] == [_PAYLOAD] * 6


def test_one_dead_and_one_noisy_receiver_do_not_matter() -> None:
    record = _record(10.0)
    samples = record.samples.copy()
    samples[1] = 0.0
    samples[2] = 500.0 * np.random.default_rng(1).standard_normal(samples.shape[1])

    frame = demodulate(samples, record.sample_rate_hz)

    assert frame is not None
    assert frame.payload == _PAYLOAD


def test_noise_carries_no_message() -> None:
    noise = np.random.default_rng(4).standard_normal((4, 19_500))

    frame = demodulate(noise, _RATE_HZ)

    assert frame is not None
    assert frame.payload is None


def test_frame_cut_off_or_silent_is_no_frame() -> None:
    record = _record(10.0)

    assert demodulate(record.samples[:, :15_000], record.sample_rate_hz) is None
    assert demodulate(np.zeros((4, 19_500)), record.sample_rate_hz) is None


def test_wrong_input_is_named() -> None:
    with pytest.raises(ValueError, match="sample rate 48000"):
        demodulate(np.zeros((4, 19_500)), 48_000.0)
    with pytest.raises(ValueError, match="no numbers"):
        demodulate(np.full((4, 19_500), np.nan), _RATE_HZ)
