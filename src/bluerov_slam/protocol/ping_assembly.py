"""Chart chunks of one sonar to whole pings.

A chunk says where its samples belong in the ping (`seq_offset`), not which ping it belongs to. A ping ends when the
offset goes back, when resolution or first sample change, when the pause is longer than half a period, when the known
sample count is reached, when the firmware says so, or when nothing more comes. What never arrived is zero and listed.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median_low
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.protocol.kogger_frame import KOGGER_SYNC, FrameType, KoggerFrame, KoggerId
from bluerov_slam.records import Channel, Ping

MAX_PING_BYTES = 20_000
"""KoggerApp's fill buffer; a chunk that would reach its end is refused."""

_CHART_HEADER = struct.Struct("<3H")
_CHART_SETUP = struct.Struct("<3H")
_MAX_ROUTES = 8
# A ping that stays open longer has lost its end. A host that hiccups reads the rest of a ping late, not never.
_HOST_PAUSE_S = 0.5
_TIMEOUT_PERIODS = 1.5
_DEFAULT_TIMEOUT_S = 1.0
_MAX_TIMEOUT_S = 2.0
_PERIODS_KEPT = 9
_PERIODS_TO_TRUST = 3
_SHORT_PINGS_TO_DISBELIEVE = 5
_MOST_MISSED = 64  # of the 256 ping numbers: a larger step means that the counter was reset


class ChartChunk(NamedTuple):
    """One chart frame's content. For version 1 the bytes alternate between two sub-channels and offsets count bytes."""

    seq_offset: int
    resolution_mm: int
    first_sample: int
    samples: bytes


def chart_chunk(frame: KoggerFrame) -> ChartChunk | None:
    """The chunk in a chart frame of version 0 or 1; None for any other frame and without samples or resolution."""
    if frame.frame_id != KoggerId.CHART or frame.frame_type != FrameType.CONTENT or frame.response:
        return None
    payload = frame.payload
    if frame.version > 1 or len(payload) <= _CHART_HEADER.size:
        return None
    seq_offset, resolution_mm, first_sample = _CHART_HEADER.unpack_from(payload)
    return ChartChunk(seq_offset, resolution_mm, first_sample, payload[6:]) if resolution_mm else None


def is_safe_for_kogger_app(frame: bytes) -> bool:
    """False for a chart frame (whole, BB55) that makes KoggerApp write outside its fill buffer, and so crash."""
    if frame[0] != KOGGER_SYNC[0] or frame[4] != KoggerId.CHART or frame[3] & 3 != FrameType.CONTENT:
        return True
    version = frame[3] >> 3 & 7
    if version > 1:  # raw data, which KoggerApp keeps elsewhere
        return True
    samples = frame[5] - _CHART_HEADER.size
    return samples >= 0 and frame[6] + (frame[7] << 8) + samples < MAX_PING_BYTES


@dataclass(slots=True)
class AssemblyCounters:
    """What a `PingAssembler` has seen since it was made. Pings of a dual-channel sonar count once."""

    chunks: int = 0
    pings: int = 0
    incomplete: int = 0
    gap_samples: int = 0
    oversize_chunks: int = 0
    duplicates: int = 0
    unsupported: int = 0
    split_by_pause: int = 0
    flushed: int = 0
    pings_missed: int = 0
    """By the firmware's ping number; pings it dropped or that were lost whole."""
    expected_disproved: int = 0


class PendingPing(NamedTuple):
    """A ping still being filled; sizes and gaps in bytes of the stream."""

    route: int
    version: int
    resolution_mm: int
    first_sample: int
    filled: int
    gaps: tuple[tuple[int, int], ...]


@dataclass(slots=True)
class _Fill:
    """State of one device address. `filled` 0 means no ping is open."""

    route: int
    buffer: bytearray = field(default_factory=lambda: bytearray(MAX_PING_BYTES))
    filled: int = 0
    version: int = 0
    resolution_mm: int = 0
    first_sample: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    decimation: int = 1
    started_s: float = 0.0
    last_measured_s: float = 0.0
    last_arrived_s: float = 0.0
    last_chunk: ChartChunk | None = None
    last_ping_number: int | None = None
    clean_start_s: float | None = None
    intervals_s: deque[float] = field(default_factory=lambda: deque(maxlen=_PERIODS_KEPT))
    period_s: float | None = None
    ended_by_count_at: int = 0

    def begin(self, chunk: ChartChunk, version: int, decimation: int, measured_s: float) -> None:
        self.version = version
        self.resolution_mm = chunk.resolution_mm
        self.first_sample = chunk.first_sample
        self.decimation = decimation
        self.gaps = []
        self.ended_by_count_at = 0
        self.started_s = measured_s
        self._learn_period(chunk.seq_offset == 0, measured_s)

    def continues(self, chunk: ChartChunk, version: int) -> bool:
        return (
            chunk.resolution_mm == self.resolution_mm
            and chunk.first_sample == self.first_sample
            and version == self.version
        )

    def store(self, chunk: ChartChunk, end: int) -> None:
        seq_offset = chunk.seq_offset
        if seq_offset > self.filled:
            self.add_gap(seq_offset)
        self.buffer[seq_offset:end] = chunk.samples
        self.filled = end

    def add_gap(self, end: int) -> None:
        self.gaps.append((self.filled, end))
        self.buffer[self.filled : end] = bytes(end - self.filled)
        self.filled = end

    def timed_out(self, now_s: float) -> bool:
        return self.last_chunk is not None and now_s - self.last_arrived_s > self.timeout_s()

    def paused(self, measured_s: float) -> bool:
        """More time has passed since the last chunk than belongs inside one ping."""
        return (
            self.period_s is not None
            and self.last_chunk is not None
            and measured_s - self.last_measured_s > self.period_s / 2
        )

    def timeout_s(self) -> float:
        if self.period_s is None:
            return _DEFAULT_TIMEOUT_S
        return min(_MAX_TIMEOUT_S, _HOST_PAUSE_S + _TIMEOUT_PERIODS * self.period_s)

    def _learn_period(self, starts_at_zero: bool, measured_s: float) -> None:
        if not starts_at_zero:
            self.clean_start_s = None
            return
        if self.clean_start_s is not None and measured_s > self.clean_start_s:
            self.intervals_s.append(measured_s - self.clean_start_s)
            if len(self.intervals_s) >= _PERIODS_TO_TRUST:
                self.period_s = median_low(self.intervals_s)
        self.clean_start_s = measured_s


class PingAssembler:
    """Feeds on chart frames of one sonar channel, in order; addresses (ROUTE) are kept apart.

    `expected_samples` is the count per sub-channel if known; a CHART_SETUP answer in the stream sets it too. Whether
    and when `flush` is called changes when a ping comes out, never which pings come out.
    """

    def __init__(self, channel: Channel, expected_samples: int | None = None) -> None:
        self.channel = channel
        self.counters = AssemblyCounters()
        self.expected_samples = expected_samples
        self._fills: dict[int, _Fill] = {}
        self._number = 0
        self._short_pings = 0
        self._short_filled = 0

    def feed(
        self,
        frame: KoggerFrame,
        measured_s: float,
        arrived_s: float,
        *,
        decimation: int = 1,
        last_of_ping: bool = False,
    ) -> list[Ping]:
        """Take any frame of the sonar; return the pings it completes."""
        if frame.frame_type != FrameType.CONTENT or frame.response:
            return []
        if frame.frame_id != KoggerId.CHART:
            self._learn_expected(frame)
            return []
        chunk = chart_chunk(frame)
        if chunk is None:
            self.counters.unsupported += 1
            return []
        return self.feed_chunks(
            (chunk,),
            measured_s,
            arrived_s,
            route=frame.route,
            version=frame.version,
            decimation=decimation,
            last_of_ping=last_of_ping,
        )

    def feed_chunks(
        self,
        chunks: Sequence[ChartChunk],
        measured_s: float,
        arrived_s: float,
        *,
        route: int = 0,
        version: int = 0,
        decimation: int = 1,
        ping_number: int | None = None,
        last_of_ping: bool = False,
    ) -> list[Ping]:
        """Take chunks that arrived together, such as those of one KOGGER_COMPRESSED payload."""
        pings: list[Ping] = []
        if not chunks:
            return pings
        fill = self._fills.get(route) or self._open_route(route, pings)
        self._end_by_number_or_pause(fill, chunks, measured_s, arrived_s, ping_number, pings)
        for chunk in chunks:
            self._place(fill, chunk, version, decimation, measured_s, arrived_s, pings)
        if fill.filled:
            self._end_early(fill, last_of_ping, pings)
        return pings

    def flush(self, now_s: float) -> list[Ping]:
        """Emit pings to which nothing came for 0.5 s and one and a half periods (1 s while the period is unknown)."""
        pings: list[Ping] = []
        for fill in self._fills.values():
            if fill.filled and fill.timed_out(now_s):
                self.counters.flushed += 1
                self._emit(fill, pings)
        return pings

    def finish(self) -> list[Ping]:
        """Emit whatever is open: the stream has ended."""
        pings: list[Ping] = []
        for fill in self._fills.values():
            if fill.filled:
                self._emit(fill, pings)
        return pings

    @property
    def pending(self) -> tuple[PendingPing, ...]:
        """The pings still open, one per address at most."""
        return tuple(
            PendingPing(f.route, f.version, f.resolution_mm, f.first_sample, f.filled, tuple(f.gaps))
            for f in self._fills.values()
            if f.filled
        )

    def _open_route(self, route: int, pings: list[Ping]) -> _Fill:
        if len(self._fills) >= _MAX_ROUTES:
            oldest = min(self._fills.values(), key=lambda fill: fill.last_arrived_s)
            if oldest.filled:
                self._emit(oldest, pings)
            del self._fills[oldest.route]
        fill = self._fills[route] = _Fill(route)
        return fill

    def _end_by_number_or_pause(
        self,
        fill: _Fill,
        chunks: Sequence[ChartChunk],
        measured_s: float,
        arrived_s: float,
        ping_number: int | None,
        pings: list[Ping],
    ) -> None:
        is_new = False
        if fill.timed_out(arrived_s):
            is_new = True
            self.counters.flushed += fill.filled > 0
        elif ping_number is None or fill.last_ping_number is None:
            is_new = fill.paused(measured_s)
            # Offset 0 ends the ping by itself; only where it is missing did the pause decide.
            self.counters.split_by_pause += is_new and fill.filled > 0 and chunks[0].seq_offset != 0
        if ping_number is not None and fill.last_ping_number is not None and ping_number != fill.last_ping_number:
            is_new = True
            missed = (ping_number - fill.last_ping_number - 1) & 0xFF
            self.counters.pings_missed += missed if missed <= _MOST_MISSED else 0
        fill.last_ping_number = ping_number
        if is_new:
            fill.last_chunk = None
            if fill.filled:
                self._emit(fill, pings)

    def _place(
        self,
        fill: _Fill,
        chunk: ChartChunk,
        version: int,
        decimation: int,
        measured_s: float,
        arrived_s: float,
        pings: list[Ping],
    ) -> None:
        seq_offset = chunk.seq_offset
        end = seq_offset + len(chunk.samples)
        if end >= MAX_PING_BYTES:
            self.counters.oversize_chunks += 1
            return
        if seq_offset and chunk == fill.last_chunk:
            self.counters.duplicates += 1
            return
        self.counters.chunks += 1
        if fill.filled:
            if not fill.continues(chunk, version):
                self._emit(fill, pings, pad_tail=False)
            elif seq_offset < fill.filled:
                self._emit(fill, pings)
        if not fill.filled:
            if seq_offset and seq_offset == fill.ended_by_count_at and fill.continues(chunk, version):
                self._disbelieve_expected()
            fill.begin(chunk, version, decimation, measured_s)
        fill.store(chunk, end)
        fill.last_chunk = chunk
        fill.last_measured_s = measured_s
        fill.last_arrived_s = arrived_s

    def _end_early(self, fill: _Fill, last_of_ping: bool, pings: list[Ping]) -> None:
        expected = self._expected_bytes(fill.version)
        if last_of_ping:
            fill.ended_by_count_at = 0
            self._emit(fill, pings)
        elif fill.filled == expected:
            fill.ended_by_count_at = fill.filled
            self._emit(fill, pings)
        elif expected and fill.filled > expected:
            self._disbelieve_expected()

    def _expected_bytes(self, version: int) -> int:
        """Bytes of a whole ping, 0 while unknown."""
        return (self.expected_samples or 0) * (2 if version == 1 else 1)

    def _learn_expected(self, frame: KoggerFrame) -> None:
        if frame.frame_id == KoggerId.CHART_SETUP and len(frame.payload) == _CHART_SETUP.size:
            count = _CHART_SETUP.unpack(frame.payload)[0]
            self.expected_samples = count or None
            self._short_pings = 0

    def _disbelieve_expected(self) -> None:
        """The sonar's settings were changed behind our back: the count is unknown until it is read again."""
        self.expected_samples = None
        self._short_pings = 0
        self.counters.expected_disproved += 1

    def _pad_tail(self, fill: _Fill) -> None:
        expected = self._expected_bytes(fill.version)
        if not fill.filled < expected < MAX_PING_BYTES:
            self._short_pings = 0
            return
        self._short_pings = self._short_pings + 1 if fill.filled == self._short_filled else 1
        self._short_filled = fill.filled
        if self._short_pings >= _SHORT_PINGS_TO_DISBELIEVE:
            self._disbelieve_expected()
        else:
            fill.add_gap(expected)

    def _emit(self, fill: _Fill, pings: list[Ping], *, pad_tail: bool = True) -> None:
        if pad_tail and self.expected_samples:
            self._pad_tail(fill)
        samples = np.frombuffer(bytes(memoryview(fill.buffer)[: fill.filled]), np.uint8)
        fill.filled = 0
        if fill.version == 1 and samples.size < 2:
            self.counters.unsupported += 1  # half a sample pair is no ping
            return
        self._number += 1
        self.counters.pings += 1
        if fill.gaps:
            self.counters.incomplete += 1
            self.counters.gap_samples += sum(end - start for start, end in fill.gaps)
        if fill.version == 0:
            pings.append(self._ping(fill, 0, samples, tuple(fill.gaps)))
            return
        # Byte 2i is sample i of sub-channel 0, byte 2i+1 of sub-channel 1.
        count = len(samples) // 2
        for sub_channel in (0, 1):
            own = np.ascontiguousarray(samples[sub_channel : 2 * count : 2])
            own.flags.writeable = False
            halved = [((a + 1 - sub_channel) // 2, (b + 1 - sub_channel) // 2) for a, b in fill.gaps]
            pings.append(self._ping(fill, sub_channel, own, tuple([(a, b) for a, b in halved if a < b])))

    def _ping(
        self, fill: _Fill, sub_channel: int, samples: NDArray[np.uint8], gaps: tuple[tuple[int, int], ...]
    ) -> Ping:
        return Ping(
            channel=self.channel,
            sub_channel=sub_channel,
            route=fill.route,
            number=self._number,
            measured_s=fill.started_s,
            arrived_s=fill.last_arrived_s,
            resolution_m=fill.resolution_mm / 1000,
            first_sample=fill.first_sample,
            samples=samples,
            gaps=gaps,
            decimation=fill.decimation,
        )
