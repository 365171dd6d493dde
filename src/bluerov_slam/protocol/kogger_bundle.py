"""KOGGER_COMPRESSED (AA55 type 0x04): several decimated chart chunks of one ping in one payload, and back.

    u8 channel | u8 flags | u8 decimation | u8 chunk count | u8 ping number | u32 t_us of the ping's first byte
    flags: bits 0-1 coding (0 mean, 1 peak, 2 coded), 2-4 chart version (0 or 1), 5 MARK seen, 6 last of this ping
    chunk: u16 seqOffset | u16 sampleResol | u16 absOffset | u8 samples before decimation | decimated bytes

Offsets and counts are those of the chart frame before decimation, so that KoggerApp and the viewer need not know: every
decimated sample is held over the samples it stands for. Version 1 charts alternate between two sub-channels; each is
decimated by itself and the results alternate again.

Coded payloads have the same sizes, but their chunks' bytes, joined, are one code of all their samples
(`kogger_coded`), which brings each sample back by itself.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.protocol import kogger_coded
from bluerov_slam.protocol.checksums import kogger_mod256_rows
from bluerov_slam.protocol.kogger_frame import KOGGER_SYNC, FrameType, KoggerId
from bluerov_slam.protocol.ping_assembly import MAX_PING_BYTES, ChartChunk
from bluerov_slam.records import Channel

PAYLOAD_LIMIT_115200 = 224
PAYLOAD_LIMIT_921600 = 512
MAX_DECIMATION = 8
MAX_CHUNK_SAMPLES = 249
"""LENGTH 255 less the six header bytes of a chart."""

_HEADER = struct.Struct("<5BI")
_CHUNK = struct.Struct("<3HB")
_CHART_FRAME = struct.Struct("<4B3H")  # behind the sync
_CHANNELS = (Channel.A, Channel.B)
_MARK_BIT = 1 << 5
_LAST_BIT = 1 << 6
_RESERVED_BIT = 1 << 7


_PAIRS_FROM_DECIMATION = 6
"""From here on there are too few bits for every sample: pairs of them are coded."""


class Coding(IntEnum):
    """How samples became bytes: one for each decimation group, or a code of the same size."""

    MEAN = 0
    PEAK = 1
    CODED = 2


@dataclass(frozen=True, slots=True)
class Bundle:
    """One expanded payload: chunks at the original sample count, and the same as BB55 chart frames (route 0)."""

    channel: Channel
    coding: Coding
    version: int
    mark: bool
    last_of_ping: bool
    decimation: int
    ping_number: int
    t_us: int
    chunks: tuple[ChartChunk, ...]
    frames: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class UnknownLayout:
    """A payload whose arithmetic does not add up: another firmware's layout, to be counted and named."""

    reason: str


def expand(payload: bytes) -> Bundle | UnknownLayout:
    """Undo the compression as far as it goes. Never raises for any bytes."""
    if len(payload) < _HEADER.size:
        return UnknownLayout(f"{len(payload)} bytes, expected at least {_HEADER.size}")
    channel, flags, decimation, count, ping_number, t_us = _HEADER.unpack_from(payload)
    version, coding = flags >> 2 & 7, flags & 3
    if channel > 1 or coding > Coding.CODED or version > 1 or flags & _RESERVED_BIT:
        return UnknownLayout(f"channel {channel}, flags 0x{flags:02x}")
    if not 1 <= decimation <= MAX_DECIMATION or not count:
        return UnknownLayout(f"decimation {decimation}, {count} chunks")
    parsed = _parse_chunks(payload, count, decimation, version)
    if isinstance(parsed, UnknownLayout):
        return parsed
    samples = _rebuilt(payload, parsed, decimation, Coding(coding), version)
    if samples is None:
        return UnknownLayout(f"the code of {count} chunks does not add up")
    mark = bool(flags & _MARK_BIT)
    frames = _chart_frames(parsed, samples, version, mark)
    return Bundle(
        _CHANNELS[channel],
        Coding(coding),
        version,
        mark,
        bool(flags & _LAST_BIT),
        decimation,
        ping_number,
        t_us,
        tuple([ChartChunk(c[0], c[1], c[2], frame[12:-2]) for c, frame in zip(parsed, frames, strict=True)]),
        frames,
    )


_ParsedChunk = tuple[
    int, int, int, int, int, int
]  # seq offset, resolution, first sample, samples, data start, data end


def _parse_chunks(payload: bytes, count: int, decimation: int, version: int) -> list[_ParsedChunk] | UnknownLayout:
    """Where each chunk lies; they must fill the payload exactly and follow each other inside one ping."""
    parsed: list[_ParsedChunk] = []
    end = _HEADER.size
    filled = 0
    resolution_mm = first_sample = -1
    for index in range(count):
        start = end + _CHUNK.size
        if start > len(payload):
            return UnknownLayout(f"chunk {index} of {count} begins behind the end")
        seq_offset, own_resolution_mm, own_first_sample, samples = _CHUNK.unpack_from(payload, end)
        if index == 0:
            resolution_mm, first_sample = own_resolution_mm, own_first_sample
        elif own_resolution_mm != resolution_mm or own_first_sample != first_sample or seq_offset < filled:
            return UnknownLayout(f"chunk {index} belongs to another ping than chunk 0")
        filled = seq_offset + samples
        if not 1 <= samples <= MAX_CHUNK_SAMPLES or not resolution_mm or filled >= MAX_PING_BYTES:
            return UnknownLayout(f"chunk {index}: offset {seq_offset}, {samples} samples of {resolution_mm} mm")
        end = start + _decimated_size(samples, decimation, version)
        parsed.append((seq_offset, resolution_mm, first_sample, samples, start, end))
    if end != len(payload):
        return UnknownLayout(f"{len(payload)} bytes, the chunks make {end}")
    return parsed


def _rebuilt(
    payload: bytes, parsed: list[_ParsedChunk], decimation: int, coding: Coding, version: int
) -> list[NDArray[np.uint8]] | None:
    """The samples of each chunk, as many as the sonar sent; None if they are coded and the code is none."""
    if coding is Coding.CODED:
        code = b"".join([payload[start:end] for *_, start, end in parsed])
        if _is_coded(coding, decimation, len(code)):
            return _decoded(code, [chunk[3] for chunk in parsed], _coded_group(decimation), version)
    data = np.frombuffer(payload, np.uint8)
    return [hold(data[start:end], samples, decimation, version) for *_, samples, start, end in parsed]


def _is_coded(coding: Coding, decimation: int, size: int) -> bool:
    """Whether chunks that hold `size` bytes together hold a code; if not, coded ones hold means."""
    return coding is Coding.CODED and decimation > 1 and size >= kogger_coded.MIN_CODE_BYTES


def _coded_group(decimation: int) -> int:
    return 2 if decimation >= _PAIRS_FROM_DECIMATION else 1


def _code(parts: list[bytes], size: int, group: int, version: int) -> bytes:
    """The samples of all chunks in `size` bytes: one sub-channel behind the other."""
    values = [decimate(part, group, Coding.MEAN, version) for part in parts]
    channels = 1 if version == 0 else 2
    ordered = [value[channel::channels] for channel in range(channels) for value in values]
    return kogger_coded.encode(b"".join(ordered), size)


def _decoded(code: bytes, sizes: list[int], group: int, version: int) -> list[NDArray[np.uint8]] | None:
    """Undo `_code` for chunks of these sample counts."""
    counts = sizes if group == 1 else [_decimated_size(samples, group, version) for samples in sizes]
    values = kogger_coded.decode(code, sum(counts))
    if values is None:
        return None
    if version == 1:
        values = _in_turn(values, counts)
    parts = [values[start:end] for start, end in pairwise(accumulate(counts, initial=0))]
    if group == 1:
        return parts
    return [hold(part, samples, group, version) for part, samples in zip(parts, sizes, strict=True)]


def _in_turn(values: NDArray[np.uint8], counts: list[int]) -> NDArray[np.uint8]:
    """Chunks of two sub-channels each, out of first the one of all chunks and then the other."""
    merged = np.empty_like(values)
    starts = list(accumulate(counts, initial=0))
    at = 0
    for sub_channel in (0, 1):
        for start, end in pairwise(starts):
            own = merged[start + sub_channel : end : 2]
            own[:] = values[at : at + own.size]
            at += own.size
    return merged


def _chart_frames(
    parsed: list[_ParsedChunk], samples: list[NDArray[np.uint8]], version: int, mark: bool
) -> tuple[bytes, ...]:
    """BB55 chart frames of the rebuilt samples, the checksums of all of them in one go."""
    mode = FrameType.CONTENT | version << 3 | mark << 6
    width = _CHART_FRAME.size + max([chunk[3] for chunk in parsed])
    # Rows end together, because a byte's weight in the second sum is its distance from the end; zeros weigh nothing.
    backing = bytearray(len(parsed) * width)
    rows = np.frombuffer(backing, np.uint8).reshape(len(parsed), width)
    spans = []
    for index, (seq_offset, resolution_mm, first_sample, count, _, _) in enumerate(parsed):
        row_end = (index + 1) * width
        head = row_end - count - _CHART_FRAME.size
        _CHART_FRAME.pack_into(
            backing, head, 0, mode, KoggerId.CHART, count + 6, seq_offset, resolution_mm, first_sample
        )
        rows[index, width - count :] = samples[index]
        spans.append((head, row_end))
    checks = kogger_mod256_rows(rows).tobytes()
    return tuple(
        [
            KOGGER_SYNC + backing[head:row_end] + checks[2 * index : 2 * index + 2]
            for index, (head, row_end) in enumerate(spans)
        ]
    )


def hold(decimated: NDArray[np.uint8], samples: int, decimation: int, version: int = 0) -> NDArray[np.uint8]:
    """`samples` bytes, each decimated one repeated over those it stands for."""
    if version == 0:
        repeated: NDArray[np.uint8] = decimated.repeat(decimation)
        return repeated[:samples]
    held = np.empty(samples, np.uint8)
    for sub_channel in (0, 1):
        own = held[sub_channel::2]
        own[:] = decimated[sub_channel::2].repeat(decimation)[: own.size]
    return held


def decimate(samples: bytes, decimation: int, coding: Coding = Coding.MEAN, version: int = 0) -> bytes:
    """One byte for every `decimation` samples; the last group may be shorter. Means round half up."""
    values = np.frombuffer(samples, np.uint8)
    if version == 0:
        return _decimate_one(values, decimation, coding).tobytes()
    first, second = (_decimate_one(values[sub_channel::2], decimation, coding) for sub_channel in (0, 1))
    merged = np.empty(first.size + second.size, np.uint8)
    merged[0::2], merged[1::2] = first, second
    return merged.tobytes()


def _decimate_one(values: NDArray[np.uint8], decimation: int, coding: Coding) -> NDArray[np.uint8]:
    if values.size == 0:
        return values
    starts = np.arange(0, values.size, decimation)
    if coding is Coding.PEAK:
        peaks: NDArray[np.uint8] = np.maximum.reduceat(values, starts)
        return peaks
    sizes = np.minimum(decimation, values.size - starts)
    sums = np.add.reduceat(values, starts, dtype=np.int64)
    means: NDArray[np.uint8] = ((2 * sums + sizes) // (2 * sizes)).astype(np.uint8)
    return means


def _decimated_size(samples: int, decimation: int, version: int) -> int:
    if version == 0:
        return -(-samples // decimation)
    first = (samples + 1) // 2
    return -(-first // decimation) - (-(samples - first) // decimation)


class BundlePacker:
    """Chart chunks of one sonar channel to 0x04 payloads, as the firmware does it: one chunk at a time.

    A payload goes out when the next chunk does not fit, and when the ping ends. Chunks larger than a payload are cut
    at a group boundary; chunks that reach `MAX_PING_BYTES`, on which KoggerApp crashes, are left out.
    """

    def __init__(
        self,
        channel: Channel,
        *,
        decimation: int = 4,
        coding: Coding = Coding.MEAN,
        payload_limit: int = PAYLOAD_LIMIT_115200,
    ) -> None:
        self.channel = channel
        self.decimation = decimation
        self.coding = coding
        self.payload_limit = payload_limit
        self._ping: tuple[int, int, int, bool] | None = None
        self._chunks: list[ChartChunk] = []
        self._size = _HEADER.size

    def begin(self, ping_number: int, t_us: int, *, version: int = 0, mark: bool = False) -> None:
        """Start a ping; the one before must have been ended. Number and time wrap as their fields do."""
        self._ping = (ping_number & 0xFF, t_us & 0xFFFFFFFF, version, mark)
        self._chunks = []
        self._size = _HEADER.size

    def add(self, chunk: ChartChunk) -> list[bytes]:
        """Take the next chunk of the ping; return the payloads that are now full."""
        payloads: list[bytes] = []
        if chunk.seq_offset + len(chunk.samples) >= MAX_PING_BYTES:
            return payloads
        for piece in self._pieces(chunk):
            size = _CHUNK.size + _decimated_size(len(piece.samples), self.decimation, self._version)
            if self._chunks and self._size + size > self.payload_limit:
                payloads.append(self._payload(last=False))
            self._chunks.append(piece)
            self._size += size
        return payloads

    def end(self) -> list[bytes]:
        """The ping is over: the payload that carries its last chunks, flagged as last."""
        return [self._payload(last=True)] if self._chunks else []

    def _pieces(self, chunk: ChartChunk) -> Iterable[ChartChunk]:
        version = self._version
        group = self.decimation * (2 if version == 1 else 1)
        room = (self.payload_limit - _HEADER.size - _CHUNK.size) * self.decimation // group * group
        most = min(room, MAX_CHUNK_SAMPLES // group * group)
        size = len(chunk.samples)
        if size <= MAX_CHUNK_SAMPLES and _decimated_size(size, self.decimation, version) * self.decimation <= room:
            most = size
        for start in range(0, size, most):
            yield chunk._replace(seq_offset=chunk.seq_offset + start, samples=chunk.samples[start : start + most])

    @property
    def _version(self) -> int:
        return self._ping[2] if self._ping else 0

    def _payload(self, *, last: bool) -> bytes:
        ping_number, t_us, version, mark = self._ping or (0, 0, 0, False)
        flags = self.coding | version << 2 | mark * _MARK_BIT | last * _LAST_BIT
        payload = _HEADER.pack(self.channel.index, flags, self.decimation, len(self._chunks), ping_number, t_us)
        for chunk, data in zip(self._chunks, self._data(version), strict=True):
            payload += _CHUNK.pack(*chunk[:3], len(chunk.samples)) + data
        self._chunks = []
        self._size = _HEADER.size
        return payload

    def _data(self, version: int) -> list[bytes]:
        """What each chunk of the payload holds."""
        parts = [chunk.samples for chunk in self._chunks]
        size = self._size - _HEADER.size - len(parts) * _CHUNK.size
        if not _is_coded(self.coding, self.decimation, size):
            return [decimate(part, self.decimation, self.coding, version) for part in parts]
        code = _code(parts, size, _coded_group(self.decimation), version)
        sizes = (_decimated_size(len(part), self.decimation, version) for part in parts)
        return [code[start:end] for start, end in pairwise(accumulate(sizes, initial=0))]


def compress_ping(
    channel: Channel,
    chunks: Iterable[ChartChunk],
    *,
    ping_number: int,
    t_us: int,
    version: int = 0,
    mark: bool = False,
    decimation: int = 4,
    coding: Coding = Coding.MEAN,
    payload_limit: int = PAYLOAD_LIMIT_115200,
) -> list[bytes]:
    """The 0x04 payloads of one whole ping, the last one flagged."""
    packer = BundlePacker(channel, decimation=decimation, coding=coding, payload_limit=payload_limit)
    packer.begin(ping_number, t_us, version=version, mark=mark)
    payloads = [payload for chunk in chunks for payload in packer.add(chunk)]
    return payloads + packer.end()
