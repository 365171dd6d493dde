"""Payloads of the acoustic board's frames: ACOUSTIC_TDOA (0x08), ACOUSTIC_RECORD (0x09) and ACOUSTIC_MESSAGE (0x0A).

Exact integers of the wire in, the same out; `unpack_*` returns None for a payload whose content does not add up. The
layout is `docs/protocol.md`.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import BugError
from bluerov_slam.protocol.fixed_point import I32_MAX, I32_MIN, U16_MAX, U32_MAX, saturated
from bluerov_slam.records import AcousticMessage, AcousticRecord, TimeDifferenceReading

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

MAX_RECEIVERS = 16
# Of all receivers together: 38 ms of four at 851 kHz, 0.3 s at 106 kHz. Nobody can make a record grow without bound.
MAX_RECORD_VALUES = 0x20000
RECORD_PAYLOAD_BYTES = 512
NO_FRAME_BITS = U16_MAX
FRAME_BITS = 14
NO_DELAY_NS = I32_MIN

_TDOA_HEAD = struct.Struct("<IBB")
_RECORD_HEAD = struct.Struct("<IIIBBHHH")
_MESSAGE_HEAD = struct.Struct("<IBB")
_MAX_MESSAGE_BYTES = 255


@dataclass(frozen=True, slots=True)
class TdoaFields:
    """ACOUSTIC_TDOA in wire integers; `delays_ns` ascend by receiver, without the reference."""

    t_us: int
    reference: int
    delays_ns: tuple[int, ...]
    signal_std: tuple[int, ...]
    frame_bits: int


def pack_tdoa(fields: TdoaFields) -> bytes:
    """Payload of 0x08."""
    receivers = len(fields.signal_std)
    return (
        _TDOA_HEAD.pack(fields.t_us, receivers, fields.reference)
        + struct.pack(f"<{receivers - 1}i", *fields.delays_ns)
        + struct.pack(f"<{receivers + 1}H", *fields.signal_std, fields.frame_bits)
    )


def unpack_tdoa(payload: bytes) -> TdoaFields | None:
    """Fields of 0x08; None when the receivers and the length disagree or the frame has more than 14 bits."""
    if len(payload) < _TDOA_HEAD.size:
        return None
    t_us, receivers, reference = _TDOA_HEAD.unpack_from(payload)
    if not 2 <= receivers <= MAX_RECEIVERS or reference >= receivers or len(payload) != 4 + 6 * receivers:
        return None
    at = _TDOA_HEAD.size
    delays_ns = struct.unpack_from(f"<{receivers - 1}i", payload, at)
    *signal_std, frame_bits = struct.unpack_from(f"<{receivers + 1}H", payload, at + 4 * (receivers - 1))
    if frame_bits != NO_FRAME_BITS and frame_bits >> FRAME_BITS:
        return None
    return TdoaFields(t_us, reference, delays_ns, tuple(signal_std), frame_bits)


def time_difference_reading(fields: TdoaFields, measured_s: float, arrived_s: float) -> TimeDifferenceReading:
    """The record of a 0x08 frame."""
    delays_s = np.array([math.nan if ns == NO_DELAY_NS else ns * 1e-9 for ns in fields.delays_ns])
    frame_bits = None if fields.frame_bits == NO_FRAME_BITS else fields.frame_bits
    signal_std = np.array(fields.signal_std, float)
    return TimeDifferenceReading(measured_s, arrived_s, fields.reference, delays_s, signal_std, frame_bits)


def tdoa_fields(
    t_us: int,
    reference: int,
    delays_s: NDArray[np.float64],
    signal_std_counts: NDArray[np.float64],
    frame_bits: int | None,
) -> TdoaFields:
    """Wire fields; NaN delays become "not measured", what does not fit saturates."""
    return TdoaFields(
        t_us=t_us & U32_MAX,
        reference=reference,
        delays_ns=tuple(NO_DELAY_NS if math.isnan(d) else saturated(d * 1e9, I32_MIN + 1, I32_MAX) for d in delays_s),
        signal_std=tuple(saturated(counts, 0, U16_MAX) for counts in signal_std_counts),
        frame_bits=NO_FRAME_BITS if frame_bits is None else frame_bits,
    )


@dataclass(frozen=True, slots=True)
class RecordChunk:
    """ACOUSTIC_RECORD: some samples of all receivers. `samples`: int16 (samples, receivers), as interleaved."""

    record_id: int
    t_us: int
    sample_rate_hz: int
    bits: int
    first_sample: int
    trigger_index: int
    samples: NDArray[np.int16]


def pack_record_chunk(chunk: RecordChunk) -> bytes:
    """Payload of 0x09."""
    count, receivers = chunk.samples.shape
    head = _RECORD_HEAD.pack(
        chunk.record_id,
        chunk.t_us,
        chunk.sample_rate_hz,
        receivers,
        chunk.bits,
        count,
        chunk.first_sample,
        chunk.trigger_index,
    )
    return head + chunk.samples.astype("<i2").tobytes()


def unpack_record_chunk(payload: bytes) -> RecordChunk | None:
    """Fields of 0x09; None when the samples and the length disagree or a figure is impossible."""
    if len(payload) < _RECORD_HEAD.size:
        return None
    record_id, t_us, rate_hz, receivers, bits, count, first, trigger = _RECORD_HEAD.unpack_from(payload)
    if len(payload) != _RECORD_HEAD.size + 2 * count * receivers or count == 0 or rate_hz == 0:
        return None
    if not 1 <= receivers <= MAX_RECEIVERS or not 1 <= bits <= 16 or (first + count) * receivers > MAX_RECORD_VALUES:
        return None
    samples = np.frombuffer(payload, "<i2", offset=_RECORD_HEAD.size).reshape(count, receivers)
    return RecordChunk(record_id, t_us, rate_hz, bits, first, trigger, samples)


def record_chunks(
    record: AcousticRecord, t_us: int, payload_bytes: int = RECORD_PAYLOAD_BYTES
) -> Iterator[RecordChunk]:
    """A record cut into chunks whose payloads hold at most `payload_bytes`."""
    receivers, total = record.samples.shape
    size = (payload_bytes - _RECORD_HEAD.size) // (2 * receivers)
    if size < 1 or receivers * total > MAX_RECORD_VALUES or total > U16_MAX + 1:
        raise BugError(f"a record of {receivers} x {total} samples does not fit into chunks of {payload_bytes} bytes")
    for first in range(0, total, size):
        yield RecordChunk(
            record_id=record.record_id & U32_MAX,
            t_us=t_us & U32_MAX,
            sample_rate_hz=round(record.sample_rate_hz),
            bits=record.bits,
            first_sample=first,
            trigger_index=min(record.trigger_index, U16_MAX),
            samples=record.samples[:, first : first + size].T,
        )


@dataclass(frozen=True, slots=True)
class MessageFields:
    """ACOUSTIC_MESSAGE in wire integers."""

    t_us: int
    corrected_errors: int
    payload: bytes


def pack_message(fields: MessageFields) -> bytes:
    """Payload of 0x0A."""
    if not 0 < len(fields.payload) <= _MAX_MESSAGE_BYTES:
        raise BugError(f"an acoustic message of {len(fields.payload)} bytes, 1 to {_MAX_MESSAGE_BYTES} fit")
    return _MESSAGE_HEAD.pack(fields.t_us, fields.corrected_errors, len(fields.payload)) + fields.payload


def unpack_message(payload: bytes) -> MessageFields | None:
    """Fields of 0x0A; None when its length byte and its length disagree, or nothing was said."""
    if len(payload) <= _MESSAGE_HEAD.size:
        return None
    t_us, corrected_errors, length = _MESSAGE_HEAD.unpack_from(payload)
    if len(payload) != _MESSAGE_HEAD.size + length:
        return None
    return MessageFields(t_us, corrected_errors, payload[_MESSAGE_HEAD.size :])


def acoustic_message(fields: MessageFields, measured_s: float, arrived_s: float) -> AcousticMessage:
    """The record of a 0x0A frame."""
    return AcousticMessage(measured_s, arrived_s, fields.corrected_errors, fields.payload)
