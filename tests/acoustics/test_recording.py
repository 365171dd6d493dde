"""The recorder: what it takes, what it rejects, and that pieces do not matter."""

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.recording import PulseRecorder, RecorderSettings, RecorderState, TriggerSettings
from bluerov_slam.simulation.acoustic_record import AcousticSetup, Window, simulate_records

ARRAY = ReceiverArray.cross()
OURS = RecorderSettings(pre_trigger_samples=448)


def _stream(pulses=3, quiet=5000, noise_counts=4.0, seed=1):
    """Samples (4, n) about mid-scale with a pulse every `quiet` + 9000 samples, and where each begins."""
    rng = np.random.default_rng(seed)
    setup = AcousticSetup(ARRAY, snr_db=None, noise_counts=0.0, window=Window("onset", 9000, 0))
    records = simulate_records(setup, np.array([2.6, 0.3, -0.2]) + rng.normal(0.0, 0.1, (pulses, 3)), seed)
    parts, onsets, length = [], [], 0
    for samples, toa_s in zip(records.samples, records.toa_s, strict=True):
        gap = quiet + int(rng.integers(0, 640))
        parts += [np.zeros((4, gap)), samples]
        onsets.append(length + gap + float(toa_s.min()) * records.sample_rate_hz)
        length += gap + 9000
    clean = np.concatenate(parts, axis=1)
    return np.rint(2048.0 + clean + noise_counts * rng.standard_normal(clean.shape)), onsets


def _same(first, second):
    assert [(r.first_sample, r.trigger_index, r.accepted) for r in first] == [
        (r.first_sample, r.trigger_index, r.accepted) for r in second
    ]
    for one, other in zip(first, second, strict=True):
        assert np.array_equal(one.samples, other.samples)


def test_a_record_begins_with_the_block_after_the_one_that_tripped():
    samples, onsets = _stream(1)
    (first, *rest) = PulseRecorder().feed(samples)
    assert first.first_sample % 64 == 0
    assert 30 < first.first_sample - onsets[0] < 3 * 64
    assert first.samples.shape == (4, 2048)
    assert first.trigger_index == 0
    assert first.accepted
    # As on the board the trigger is armed again inside the frame: its later bits make records of their own.
    assert all(record.first_sample >= first.first_sample + 2048 for record in rest)


def test_the_ring_buffer_has_the_onset():
    samples, onsets = _stream(3)
    settings = RecorderSettings(pre_trigger_samples=448, busy_samples=8000)
    records = PulseRecorder(settings).feed(samples)
    assert len(records) == 3
    for record, onset in zip(records, onsets, strict=True):
        assert record.trigger_index == 448
        assert 448 - 3 * 64 < onset - record.first_sample < 448
        assert np.array_equal(record.samples, samples[:, record.first_sample : record.first_sample + 2048])


@pytest.mark.parametrize("settings", [RecorderSettings(), OURS, RecorderSettings(busy_samples=3001)])
@pytest.mark.parametrize("piece", [1, 63, 64, 1000])
def test_any_pieces_give_the_same_records(settings, piece):
    samples, _ = _stream(2, quiet=1500)
    samples = samples[:, :14_000] if piece == 1 else samples
    whole = PulseRecorder(settings).feed(samples)
    assert whole
    recorder = PulseRecorder(settings)
    pieces = [
        record for at in range(0, samples.shape[1], piece) for record in recorder.feed(samples[:, at : at + piece])
    ]
    _same(whole, pieces)


def test_random_pieces_give_the_same_records():
    samples, _ = _stream(3)
    whole = PulseRecorder(OURS).feed(samples)
    rng = np.random.default_rng(4)
    for _ in range(20):
        cuts = np.sort(rng.integers(0, samples.shape[1], rng.integers(1, 200)))
        recorder = PulseRecorder(OURS)
        _same(whole, [record for piece in np.split(samples, cuts, axis=1) for record in recorder.feed(piece)])


def test_nothing_is_kept_that_is_not_needed():
    recorder = PulseRecorder(OURS)
    for _ in range(100):
        recorder.feed(np.full((4, 4096), 2048.0))
    assert recorder._kept.shape[1] <= 448 + 64


def test_a_receiver_that_hears_too_little_rejects_the_record():
    samples, _ = _stream(1)
    samples[2] = 2048.0 + 0.05 * (samples[2] - 2048.0)
    recorder = PulseRecorder()
    records = recorder.feed(samples)
    assert records
    assert not any(record.accepted for record in records)
    assert recorder.records_rejected == len(records)
    assert recorder.records_accepted == 0
    assert (records[0].std_counts[[0, 1, 3]] > 50.0).all()


def test_one_receiver_alone_does_not_trip():
    samples, _ = _stream(1)
    samples[1:] = 2048.0
    recorder = PulseRecorder()
    assert recorder.feed(samples) == []
    assert recorder.state is RecorderState.TRIGGERING


def _blocks(place, length=5, receivers=2, height=100.0):
    blocks = np.zeros((4, 1, 64))
    blocks[:receivers, 0, place : place + length] = height
    return blocks


def test_the_last_window_is_skipped_as_published():
    assert TriggerSettings().tripped(_blocks(58))[0]
    assert not TriggerSettings().tripped(_blocks(59))[0]
    assert TriggerSettings(skip_last_window=False).tripped(_blocks(59))[0]


def test_a_run_must_be_long_enough_and_far_from_the_mean():
    assert TriggerSettings().tripped(_blocks(20, 5))[0]
    assert not TriggerSettings().tripped(_blocks(20, 4))[0]
    # 54 counts over five of 64 samples are 49.8 from the block's own mean: not above 50.
    assert not TriggerSettings().tripped(_blocks(20, 5, height=54.0))[0]
    assert TriggerSettings().tripped(_blocks(20, 5, height=55.0))[0]
    assert TriggerSettings().tripped(_blocks(20, 5, height=-55.0))[0]


def test_a_wrong_number_of_receivers_is_refused():
    with pytest.raises(ValueError, match=r"shape \(3, 64\), expected 4 rows"):
        PulseRecorder().feed(np.zeros((3, 64)))


def test_settings_that_make_no_record_are_refused():
    with pytest.raises(ValueError, match="2048 samples before the trigger in a record of 2048"):
        RecorderSettings(pre_trigger_samples=2048)
    with pytest.raises(ValueError, match="hold no run of 5"):
        RecorderSettings(trigger=TriggerSettings(block_samples=4))
