"""The drive sequence bit for bit, its spectrum and the received waveform."""

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from bluerov_slam.acoustics.pulse_train import (
    NOMINAL_STEP_S,
    PulseTrain,
    ReceptionChain,
    drive_steps,
    frame_bits,
    one_bit_steps,
    pulse_template,
)

RATE_HZ = 275e6 / 323


def test_a_one_is_five_six_and_three_cycles_with_braked_steps_between():
    up = "+-"
    expected = up * 5 + "0" + up * 6 + "0" + up * 3 + "0" * 10
    assert "".join("-0+"[step + 1] for step in one_bit_steps().tolist()) == expected


def test_the_three_bursts_alternate_in_phase():
    steps = one_bit_steps()
    starts = (0, 11, 24)
    phases = [steps[start] * (-1) ** start for start in starts]  # against a carrier that runs on through the brakes
    assert phases == [1, -1, 1]


def test_a_frame_is_a_header_and_the_counter_with_the_most_significant_bit_first():
    assert frame_bits(241) == (1, 1, 1, 1, 0, 0, 1, 1, 1, 1, 0, 0, 0, 1)


@pytest.mark.parametrize("counter", [-1, 256])
def test_a_counter_that_does_not_fit_is_refused(counter):
    with pytest.raises(ValueError, match="expected 0 to 255"):
        frame_bits(counter)


def test_the_sequence_is_as_long_as_its_bits_and_not_longer():
    assert len(drive_steps(frame_bits(0))) == 14 * 40  # the thesis's 16 entries made 640 for a buffer of 560
    assert not drive_steps((0, 0)).any()


def test_the_nominal_carrier_and_frame_are_those_of_the_program():
    train = PulseTrain(frame_bits(1))
    assert train.carrier_hz == pytest.approx(40_404.04, abs=0.01)
    assert train.bit_s == pytest.approx(0.495e-3)
    assert train.duration_s == pytest.approx(6.93e-3)
    assert PulseTrain.at_carrier((1,), 39_800.0).carrier_hz == pytest.approx(39_800.0)


def test_the_spectrum_is_that_of_the_steps_played_one_by_one():
    train = PulseTrain(frame_bits(170))
    fine = 64  # samples per step
    played = np.repeat(drive_steps(train.bits).astype(float), fine)
    frequency_hz = np.array([0.0, 12_345.0, 39_000.0, 40_404.0, 41_000.0, 121_212.0])
    middle_s = (np.arange(len(played)) + 0.5) * NOMINAL_STEP_S / fine
    by_sum = (np.exp(-2j * np.pi * frequency_hz[:, None] * middle_s) @ played) * NOMINAL_STEP_S / fine
    # The midpoint sum of a piece of length d is short of its integral by sinc(f d).
    assert train.spectrum(frequency_hz) == pytest.approx(
        by_sum * np.sinc(frequency_hz * NOMINAL_STEP_S / fine), abs=1e-15
    )


def test_the_band_pass_has_the_published_peak():
    # 100 : 1 resistors; simulated peak of the thesis: 34.5 dB near 39 kHz with both resonances left out.
    frequency_hz = np.arange(30_000.0, 50_000.0, 10.0)
    flat = ReceptionChain(transducer_q=1e-6, receiver_q=1e-6)
    gain = np.abs(100.0 * flat.response(frequency_hz))
    assert 20.0 * np.log10(gain.max()) == pytest.approx(34.4, abs=0.2)
    assert frequency_hz[gain.argmax()] == pytest.approx(39_667.0, abs=20.0)  # root of the corners' product


def test_the_template_starts_at_its_onset_and_dies_out():
    template = pulse_template(PulseTrain.at_carrier((1,), 39_825.0), RATE_HZ)
    wave = template.samples
    assert np.abs(wave).max() == 1.0
    assert np.abs(wave[:4]).max() < 0.01
    assert np.abs(wave[-100:]).max() < 1e-3


def test_active_damping_shortens_the_ringing():
    train = PulseTrain.at_carrier((1,), 39_825.0)
    damped = np.abs(pulse_template(train, RATE_HZ).samples)
    at = int(32 * train.step_s * RATE_HZ)
    # After the last burst an undamped 14-cycle tone rings at its full height; the damped one is far below its peak.
    assert damped[at : at + 22].max() < 0.35


def test_the_template_is_the_wave_that_filters_in_time_make():
    fine = 16
    rate_hz = fine * RATE_HZ
    train = PulseTrain.at_carrier((1, 0, 1), 39_825.0)
    template = pulse_template(train, RATE_HZ).samples
    time_s = np.arange(fine * len(template)) / rate_hz
    steps = np.append(drive_steps(train.bits), 0).astype(float)
    wave = steps[np.minimum((time_s / train.step_s).astype(int), len(steps) - 1)]
    chain = ReceptionChain()
    for centre_hz, q in ((chain.transducer_hz, chain.transducer_q), (chain.receiver_hz, chain.receiver_q)):
        omega = 2.0 * np.pi * centre_hz
        wave = lfilter(*bilinear([omega / q, 0.0], [1.0, omega / q, omega**2], rate_hz), wave)
    low, high = 2.0 * np.pi * chain.band_low_hz, 2.0 * np.pi * chain.band_high_hz
    wave = lfilter(*bilinear([high, 0.0], np.polymul([1.0, low], [1.0, high]), rate_hz), wave)[::fine]
    assert np.abs(wave / np.abs(wave).max() - template).max() < 0.01
