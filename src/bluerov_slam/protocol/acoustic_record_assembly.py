"""ACOUSTIC_RECORD chunks to whole records; what never arrived is a counted hole.

A record ends with the next one, with a silence, or at once when nothing is missing and its end can be told: by a chunk
shorter than those before it, or by the length that the records before it had.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.records import AcousticRecord

if TYPE_CHECKING:
    from collections.abc import Callable

    from bluerov_slam.protocol.acoustic_messages import RecordChunk

# Chunks of one record follow each other at the link's lowest priority; at 115200 baud one may wait for a ping or two.
SILENCE_S = 1.0
_START_SAMPLES = 2048


@dataclass(frozen=True, slots=True)
class AssemblyCounters:
    """Since the assembler was made."""

    records: int = 0
    incomplete: int = 0
    missing_samples: int = 0
    chunks: int = 0
    repeated: int = 0
    late: int = 0


class RecordAssembler:
    """Takes chunks in order of arrival; holds at most one open record."""

    def __init__(self) -> None:
        self._open: _OpenRecord | None = None
        self._counters = AssemblyCounters()
        self._finished: tuple[int, int] | None = None
        self._usual_length: int | None = None
        self._last_length: int | None = None

    @property
    def counters(self) -> AssemblyCounters:
        """A snapshot of the counts."""
        return self._counters

    def feed(self, chunk: RecordChunk, map_time: Callable[[int], float], arrived_s: float) -> list[AcousticRecord]:
        """Take one chunk; returns the records that it ends. `map_time` is asked once for each record."""
        ended: list[AcousticRecord] = []
        self._add(chunks=1)
        if self._open is not None and not self._open.holds(chunk):
            ended.append(self._close())
        if self._open is None:
            if (chunk.record_id, chunk.t_us) == self._finished:
                self._add(late=1)
                # It came out too early: the length that it was known by is not the length.
                self._usual_length = self._last_length = None
                return ended
            self._open = _OpenRecord(chunk, map_time(chunk.t_us))
        if not self._open.take(chunk, arrived_s):
            self._add(repeated=1)
        elif self._open.is_complete(self._usual_length):
            ended.append(self._close())
        return ended

    def expire(self, now_s: float) -> list[AcousticRecord]:
        """The open record, once nothing more came of it for `SILENCE_S`."""
        if self._open is None or now_s - self._open.arrived_s <= SILENCE_S:
            return []
        return [self._close()]

    def finish(self) -> list[AcousticRecord]:
        """The open record: the stream has ended."""
        return [] if self._open is None else [self._close()]

    def _close(self) -> AcousticRecord:
        assert self._open is not None
        record, first, length = self._open.record(self._usual_length), self._open.first, self._open.end
        self._open = None
        self._finished = (first.record_id, first.t_us)
        if length == self._last_length:
            self._usual_length = length
        self._last_length = length
        missing = record.missing_samples
        self._add(records=1, incomplete=int(missing > 0), missing_samples=missing)
        return record

    def _add(self, **counts: int) -> None:
        old = self._counters
        self._counters = replace(old, **{name: getattr(old, name) + count for name, count in counts.items()})


class _OpenRecord:
    def __init__(self, chunk: RecordChunk, measured_s: float) -> None:
        self.first = chunk
        self.arrived_s = 0.0
        self.end = 0
        self._measured_s = measured_s
        self._samples = np.zeros((_START_SAMPLES, chunk.samples.shape[1]), np.int16)
        self._there = np.zeros(_START_SAMPLES, bool)
        self._largest = 0
        self._last = (0, 0)

    def holds(self, chunk: RecordChunk) -> bool:
        """Whether the chunk is of this record: everything that all chunks of a record repeat is the same."""
        return _identity(chunk) == _identity(self.first)

    def take(self, chunk: RecordChunk, arrived_s: float) -> bool:
        """Keep the chunk; False if all its samples are there already."""
        count = len(chunk.samples)
        start, end = chunk.first_sample, chunk.first_sample + count
        self.arrived_s = max(self.arrived_s, arrived_s)
        while end > len(self._there):
            self._samples = np.concatenate((self._samples, np.zeros_like(self._samples)))
            self._there = np.concatenate((self._there, np.zeros_like(self._there)))
        if self._there[start:end].all():
            return False
        self._samples[start:end] = chunk.samples
        self._there[start:end] = True
        self._largest = max(self._largest, count)
        self.end = max(self.end, end)
        self._last = max(self._last, (start, count))
        return True

    def is_complete(self, usual_length: int | None) -> bool:
        """Nothing is missing up to an end that can be told."""
        return (self.end == usual_length or self._ends_in_a_short_chunk()) and bool(self._there[: self.end].all())

    def record(self, usual_length: int | None) -> AcousticRecord:
        """All of it; a tail that the usual length says is missing counts as a hole."""
        length = self.end if usual_length is None or self._ends_in_a_short_chunk() else max(self.end, usual_length)
        samples = np.zeros((self._samples.shape[1], length), np.int16)
        samples[:, : self.end] = self._samples[: self.end].T
        samples.flags.writeable = False
        there = np.zeros(length, bool)
        there[: self.end] = self._there[: self.end]
        edges = np.flatnonzero(np.diff(np.concatenate(([True], there, [True])).astype(np.int8)))
        holes = tuple((int(start), int(end)) for start, end in edges.reshape(-1, 2))
        return AcousticRecord(
            measured_s=self._measured_s,
            arrived_s=self.arrived_s,
            record_id=self.first.record_id,
            sample_rate_hz=float(self.first.sample_rate_hz),
            samples=samples,
            bits=self.first.bits,
            trigger_index=self.first.trigger_index,
            missing_samples=sum(end - start for start, end in holes),
            holes=holes,
        )

    def _ends_in_a_short_chunk(self) -> bool:
        start, count = self._last
        return start > 0 and count < self._largest and start + count == self.end


def _identity(chunk: RecordChunk) -> tuple[int, ...]:
    receivers = chunk.samples.shape[1]
    return (chunk.record_id, chunk.t_us, chunk.sample_rate_hz, receivers, chunk.bits, chunk.trigger_index)
