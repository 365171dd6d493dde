"""Acoustic records from files: what was written comes back, and what is no record is named."""

import wave

import numpy as np
import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import AcousticRecord
from bluerov_slam.sinks.acoustic_records import write_mcap, write_npz, write_wav
from bluerov_slam.sources.acoustic_records import read_acoustic_records

RATE_HZ = 275e6 / 323


def _records(count=3, receivers=4, samples=2048, seed=1):
    rng = np.random.default_rng(seed)
    return [
        AcousticRecord(
            measured_s=float(number),
            arrived_s=number + 0.05,
            record_id=number,
            sample_rate_hz=RATE_HZ,
            samples=rng.integers(-2048, 2048, (receivers, samples)).astype(np.int16),
            bits=12,
            trigger_index=448,
        )
        for number in range(count)
    ]


def test_npz_keeps_everything(tmp_path):
    path = tmp_path / "records.npz"
    written = _records()
    write_npz(path, written, {"delays_s": np.zeros((3, 3))})
    read = read_acoustic_records(path)
    for one, other in zip(written, read, strict=True):
        assert np.array_equal(one.samples, other.samples)
        assert (other.sample_rate_hz, other.bits, other.trigger_index) == (RATE_HZ, 12, 448)
        assert other.measured_s == one.measured_s


def test_wav_keeps_the_samples(tmp_path):
    path = tmp_path / "record.wav"
    (written,) = _records(1, receivers=5)
    write_wav(path, written)
    (read,) = read_acoustic_records(path)
    assert np.array_equal(read.samples, written.samples)
    assert read.sample_rate_hz == 851393.0


def test_a_recording_gives_its_records_as_the_board_sent_them(tmp_path):
    path = tmp_path / "records.mcap"
    written = _records()
    write_mcap(path, written, {"source": "test"})
    read = read_acoustic_records(path)
    assert len(read) == 3
    for one, other in zip(written, read, strict=True):
        assert np.array_equal(one.samples, other.samples)
        assert (other.record_id, other.bits, other.trigger_index) == (one.record_id, 12, 448)
        assert other.sample_rate_hz == 851393
        assert other.missing_samples == 0
    assert read[2].measured_s - read[0].measured_s == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("width", [1, 3, 4])
def test_other_sample_sizes_are_read(tmp_path, width):
    path = tmp_path / "other.wav"
    values = np.array([[0, 1000, -1000, 32767, -32768], [5, -5, 256, -256, 77]])
    scaled = (values >> 8) + 128 if width == 1 else values << (8 * width - 16)
    data = b"".join(int(v).to_bytes(width, "little", signed=width > 1) for v in scaled.T.reshape(-1))
    with wave.open(str(path), "wb") as file:
        file.setparams((2, width, 192_000, 0, "NONE", ""))
        file.writeframes(data)
    (read,) = read_acoustic_records(path)
    assert read.samples.tolist() == ((values >> 8) if width == 1 else values).tolist()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"sample_rate_hz": 1.0}, "lacks 'samples'; it has sample_rate_hz"),
        ({"samples": np.zeros((4, 9))}, "lacks 'sample_rate_hz'"),
        ({"samples": np.zeros(9), "sample_rate_hz": 1.0}, r"samples of shape \(9,\)"),
        ({"samples": np.zeros((0, 4, 9)), "sample_rate_hz": 1.0}, "expected"),
        ({"samples": np.zeros((4, 9)), "sample_rate_hz": 0.0}, "expected one number above 0"),
        ({"samples": np.zeros((4, 9)), "sample_rate_hz": np.nan}, "expected one number above 0"),
        ({"samples": np.full((4, 9), np.nan), "sample_rate_hz": 1.0}, "no 16-bit counts"),
        ({"samples": np.full((4, 9), 4e4), "sample_rate_hz": 1.0}, "no 16-bit counts"),
        ({"samples": np.array([["a"] * 3] * 4), "sample_rate_hz": 1.0}, "samples of shape"),
    ],
)
def test_a_wrong_npz_is_named(tmp_path, content, message):
    path = tmp_path / "wrong.npz"
    np.savez(path, **content)
    with pytest.raises(RecordingError, match=message):
        read_acoustic_records(path)


@pytest.mark.parametrize(("name", "message"), [("noise.npz", "is no NPZ file"), ("noise.wav", "is no WAV file")])
@pytest.mark.parametrize("data", [b"", b"RIFF", bytes(range(256)) * 4])
def test_noise_in_a_file_is_named(tmp_path, name, data, message):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=message):
        read_acoustic_records(path)


def test_a_wav_without_samples_is_named(tmp_path):
    path = tmp_path / "empty.wav"
    with wave.open(str(path), "wb") as file:
        file.setparams((4, 2, 851_393, 0, "NONE", ""))
    with pytest.raises(RecordingError, match="holds no samples"):
        read_acoustic_records(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RecordingError, match="does not exist"):
        read_acoustic_records(tmp_path / "nothing.wav")
