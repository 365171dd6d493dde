"""Reads acoustic records from files: WAV (one record), NPZ (many), or a recorded dive with ACOUSTIC_RECORD frames."""

from __future__ import annotations

import wave
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import AcousticRecord
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import decode

MOST_SAMPLES = 50_000_000
"""Of one file, all receivers: more is no record of pulses."""

_WAV_BYTES = {1: 8, 2: 16, 3: 24, 4: 32}


def read_acoustic_records(path: Path) -> list[AcousticRecord]:
    """The records in a file, in its order. Raises RecordingError saying what is wrong with it.

    NPZ: `samples` (records, receivers, samples) or (receivers, samples), `sample_rate_hz`; `bits`, `trigger_index`
    and `measured_s` if known. WAV: PCM, one channel per receiver; samples beyond 16 bits are rounded to 16.
    """
    if not path.exists():
        raise RecordingError(f"{path} does not exist")
    try:
        if path.suffix.lower() == ".wav":
            return [_read_wav(path)]
        if path.suffix.lower() == ".npz":
            return _read_npz(path)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    found = [record for record in decode(open_recording(path)) if isinstance(record, AcousticRecord)]
    if not found:
        raise RecordingError(f"{path} holds no acoustic record (0x09): was the array's board told to send any?")
    return found


def _read_wav(path: Path) -> AcousticRecord:
    try:
        with wave.open(str(path), "rb") as file:
            channels, width = file.getnchannels(), file.getsampwidth()
            rate_hz, frames = file.getframerate(), file.getnframes()
            if frames * channels > MOST_SAMPLES:
                raise RecordingError(f"{path} holds {frames} samples of {channels} channels: too long for a record")
            data = file.readframes(frames)
    except (wave.Error, EOFError) as error:
        raise RecordingError(f"{path} is no WAV file of plain samples (PCM): {error}") from error
    if width not in _WAV_BYTES:
        raise RecordingError(f"{path} has samples of {width} bytes, expected 1 to 4")
    if rate_hz < 1 or channels < 1 or len(data) < channels * width:
        raise RecordingError(f"{path} holds no samples")
    whole = len(data) // (channels * width)
    samples = _pcm(data[: whole * channels * width], width).reshape(whole, channels).T
    return _record(path, samples, float(rate_hz), 0, min(16, _WAV_BYTES[width]), 0, 0.0)


def _pcm(data: bytes, width: int) -> NDArray[np.int64]:
    """PCM samples as 16-bit counts; one byte per sample is unsigned, as the format has it."""
    if width == 1:
        return np.frombuffer(data, np.uint8).astype(np.int64) - 128
    raw = np.frombuffer(data, np.uint8).reshape(-1, width).astype(np.int64)
    values = sum(raw[:, place] << (8 * place) for place in range(width))
    assert not isinstance(values, int)
    values = np.where(values >= 1 << (8 * width - 1), values - (1 << (8 * width)), values)
    return values if width == 2 else np.clip((values + (1 << (8 * width - 17))) >> (8 * width - 16), -32768, 32767)


def _read_npz(path: Path) -> list[AcousticRecord]:
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files if not name.startswith("true_")}
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise RecordingError(f"{path} is no NPZ file: {error}") from error
    for name in ("samples", "sample_rate_hz"):
        if name not in content:
            raise RecordingError(f"{path} lacks '{name}'; it has {', '.join(content) or 'nothing'}")
    samples = content["samples"]
    samples = samples[None] if samples.ndim == 2 else samples
    rate_hz = np.asarray(content["sample_rate_hz"])
    if samples.ndim != 3 or samples.dtype.kind not in "iuf" or not samples.size or samples.size > MOST_SAMPLES:
        raise RecordingError(f"{path}: samples of shape {samples.shape}, expected (records, receivers, samples)")
    if rate_hz.size != 1 or not np.isfinite(rate_hz).all() or float(rate_hz) <= 0.0:
        raise RecordingError(f"{path}: sample_rate_hz {rate_hz}, expected one number above 0")
    bits = int(content.get("bits", 16))
    trigger = int(content.get("trigger_index", 0))
    measured_s = np.broadcast_to(content.get("measured_s", np.zeros(len(samples))), (len(samples),))
    return [
        _record(path, each, float(rate_hz), number, bits, trigger, float(at_s))
        for number, (each, at_s) in enumerate(zip(samples, measured_s, strict=True))
    ]


def _record(
    path: Path, samples: NDArray[np.generic], rate_hz: float, number: int, bits: int, trigger: int, measured_s: float
) -> AcousticRecord:
    values = np.asarray(samples, np.float64)
    if not np.isfinite(values).all() or np.abs(values).max() > 32768.0:
        raise RecordingError(f"{path}: record {number} holds samples that are no 16-bit counts")
    counts = np.clip(np.rint(values), -32768, 32767).astype(np.int16)
    return AcousticRecord(
        measured_s=measured_s,
        arrived_s=measured_s,
        record_id=number,
        sample_rate_hz=rate_hz,
        samples=counts,
        bits=bits,
        trigger_index=trigger,
    )
