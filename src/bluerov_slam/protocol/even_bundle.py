"""The common case of KOGGER_COMPRESSED, expanded in one go: all chunks equally long, one behind the other.

`kogger_bundle.expand` is the definition; this gives the same bytes several times quicker, or None where a payload is
not of this kind. Every byte of the rebuilt frames is a copy of some byte of the payload, and both check sums are linear
in the payload's bytes: one index table and one uint8 matrix (whose product wraps modulo 256 by itself) do it all.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bluerov_slam.protocol.kogger_bundle import MAX_CHUNK_SAMPLES, MAX_DECIMATION, Coding
from bluerov_slam.protocol.kogger_frame import FrameType, KoggerId
from bluerov_slam.protocol.ping_assembly import MAX_PING_BYTES, ChartChunk
from bluerov_slam.records import Channel

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Larger payloads do not occur; tables for them would be large.
_MAX_PAYLOAD_BYTES = 600
_HEADER_BYTES = 9
_CHUNK_HEADER_BYTES = 7
_FRAME_HEADER_BYTES = 12
_FRAME_OVERHEAD_BYTES = 14
_CHANNELS = (Channel.A, Channel.B)
_CODINGS = tuple(Coding)
_FIRST_SAMPLES_AT = _HEADER_BYTES + 6
_VERSION_AND_RESERVED_BITS = 0b1001_1110
_MARK_BIT, _LAST_BIT = 1 << 5, 1 << 6


class EvenBundle(NamedTuple):
    """As `kogger_bundle.Bundle`, with the chunks joined to one that covers them all."""

    channel: Channel
    coding: Coding
    version: int
    last_of_ping: bool
    decimation: int
    ping_number: int
    t_us: int
    chunks: tuple[ChartChunk, ...]
    frames: tuple[bytes, ...]


class _Layout(NamedTuple):
    """What payloads of one shape have in common; indices and weights count from the front of `prefix` + payload."""

    fields: struct.Struct
    prefix: bytes
    weights: NDArray[np.uint8]
    sources: NDArray[np.intp]
    frames: struct.Struct
    samples: struct.Struct


def expand_even(payload: bytes) -> EvenBundle | None:
    """Expand `payload` if it is of the common kind (and valid); None leaves it to `kogger_bundle.expand`."""
    if not _FIRST_SAMPLES_AT < len(payload) <= _MAX_PAYLOAD_BYTES:
        return None
    flags = payload[1]
    layout = _layout(len(payload), payload[3], payload[_FIRST_SAMPLES_AT], payload[2], flags & _MARK_BIT)
    if layout is None or flags & _VERSION_AND_RESERVED_BITS or payload[0] > 1:
        return None
    values = layout.fields.unpack_from(payload)
    t_us, seq_offset, resolution_mm, first_sample, samples = values[:5]
    if not resolution_mm or seq_offset + payload[3] * samples >= MAX_PING_BYTES:
        return None
    for at in range(5, len(values), 4):
        if values[at : at + 4] != (seq_offset + (at >> 2) * samples, resolution_mm, first_sample, samples):
            return None
    data = layout.prefix + payload
    checks = np.frombuffer(data, np.uint8).dot(layout.weights)
    joined = np.frombuffer(data + checks.tobytes(), np.uint8).take(layout.sources).tobytes()
    return EvenBundle(
        _CHANNELS[payload[0]],
        _CODINGS[flags & 1],
        0,
        flags & _LAST_BIT != 0,
        payload[2],
        payload[4],
        t_us,
        (ChartChunk(seq_offset, resolution_mm, first_sample, b"".join(layout.samples.unpack(joined))),),
        layout.frames.unpack(joined),
    )


@lru_cache(maxsize=64)
def _layout(size: int, count: int, samples: int, decimation: int, mark: int) -> _Layout | None:
    """What follows from length, counts and MARK; None if they contradict each other."""
    if not (1 <= decimation <= MAX_DECIMATION and 1 <= samples <= MAX_CHUNK_SAMPLES and count):
        return None
    groups = -(-samples // decimation)
    stride = _CHUNK_HEADER_BYTES + groups
    if size != _HEADER_BYTES + count * stride:
        return None
    # The leading 1 carries the constant part of the sums.
    header = bytes((0xBB, 0x55, 0, FrameType.CONTENT | (0x40 if mark else 0), KoggerId.CHART, samples + 6))
    prefix = b"\x01" + header
    group_of_sample = np.arange(samples) // decimation
    # A summed byte enters the second sum once for itself and once for every summed byte behind it.
    seconds = np.arange(samples + 10, 0, -1)
    weights = np.zeros((len(prefix) + size, 2 * count), np.int64)
    sources = np.empty((count, samples + _FRAME_OVERHEAD_BYTES), np.intp)
    for index in range(count):
        start = len(prefix) + _HEADER_BYTES + index * stride
        data = start + _CHUNK_HEADER_BYTES
        first, second = weights[:, 2 * index], weights[:, 2 * index + 1]
        first[0], second[0] = sum(header[2:]), np.dot(np.frombuffer(header[2:], np.uint8), seconds[:4])
        first[start : start + 6], second[start : start + 6] = 1, seconds[4:10]
        first[data : data + groups] = np.bincount(group_of_sample)
        second[data : data + groups] = np.bincount(group_of_sample, seconds[10:])
        row = sources[index]
        row[:6] = range(1, 7)
        row[6:12] = range(start, start + 6)
        row[12:-2] = data + group_of_sample
        row[-2:] = len(prefix) + size + 2 * index, len(prefix) + size + 2 * index + 1
    return _Layout(
        struct.Struct("<5xI" + f"3HB{groups}x" * count),
        prefix,
        weights.astype(np.uint8),
        sources.ravel(),
        struct.Struct(f"{samples + _FRAME_OVERHEAD_BYTES}s" * count),
        struct.Struct(f"{_FRAME_HEADER_BYTES}x{samples}s2x" * count),
    )
