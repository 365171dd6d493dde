"""Writes acoustic records to files that `sources/acoustic_records.py` reads back."""

from __future__ import annotations

import wave
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.protocol.acoustic_messages import pack_record_chunk, record_chunks
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AcousticRecord
from bluerov_slam.sinks.mcap_log import McapLog, to_ns

_LINE_BYTES_PER_S = 92_160.0  # 921600 baud


def write_wav(path: Path, record: AcousticRecord) -> None:
    """One record as 16-bit PCM, one channel per receiver; the rate is rounded to whole hertz. Raises OSError."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(len(record.samples))
        file.setsampwidth(2)
        file.setframerate(round(record.sample_rate_hz))
        file.writeframes(record.samples.T.astype("<i2").tobytes())


def write_npz(path: Path, records: Sequence[AcousticRecord], truth: Mapping[str, NDArray[np.generic]]) -> None:
    """Records of one length and rate, and what is true about them under names that begin with `true_`."""
    first = records[0]
    with path.open("wb") as stream:
        np.savez_compressed(
            stream,
            samples=np.stack([record.samples for record in records]),
            sample_rate_hz=np.float64(first.sample_rate_hz),
            bits=np.int64(first.bits),
            trigger_index=np.int64(first.trigger_index),
            measured_s=np.array([record.measured_s for record in records]),
            **{f"true_{name}": values for name, values in truth.items()},  # type: ignore[arg-type]
        )


def write_mcap(path: Path, records: Sequence[AcousticRecord], session: dict[str, str]) -> None:
    """A recording as if the board had sent these records over the link; `session` adds metadata. Raises OSError."""
    log = McapLog(path, 0, {"wall_clock": "unknown", "wall_offset_ns": "0", **session})
    try:
        for record in records:
            write_raw_record(log, record)
        log.flush()
    finally:
        log.finish()


def write_raw_record(log: McapLog, record: AcousticRecord) -> None:
    """The frames that the board would have sent of a record, at the pace of its line."""
    at_s = record.arrived_s
    for chunk in record_chunks(record, round(record.measured_s * 1e6)):
        frame = encode_frame(MessageType.ACOUSTIC_RECORD, pack_record_chunk(chunk))
        at_s += len(frame) / _LINE_BYTES_PER_S
        log.write_raw(frame, to_ns(at_s))
