"""Frames out of a byte stream: sync search, length, check and resynchronisation, for AA55 and BB55 alike.

After a candidate that fails, the search resumes one byte behind its sync, so that a valid frame is lost only inside a
span that itself passes every check. The result does not depend on how the stream is cut into blocks. At most one
incomplete frame is held between calls.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bluerov_slam.records import LinkCounters

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class FrameFormat:
    """How frames of one protocol look.

    `total_bytes(buffer, start)` reads the length of the whole frame, checks included, from the header at `start`
    (at least `header_bytes` are there) or returns None if no such header exists. It may not return less than
    `header_bytes`. `is_intact(frame)` is asked once for each complete candidate. Several syncs must be equally long.
    """

    syncs: tuple[bytes, ...]
    header_bytes: int
    type_offset: int
    total_bytes: Callable[[bytes, int], int | None]
    is_intact: Callable[[bytes], bool]


class FrameScanner:
    """Cuts one stream into frames of one `FrameFormat` and counts what it saw."""

    def __init__(self, frame_format: FrameFormat) -> None:
        self._format = frame_format
        self._find = _sync_finder(frame_format.syncs)
        self._pending = bytearray()
        self._pending_needs = 0
        self._skipping = False
        self._bytes_received = 0
        self._frames_by_type: dict[int, int] = {}
        self._checksum_errors = 0
        self._length_errors = 0
        self._bytes_skipped = 0
        self._resyncs = 0

    @property
    def bytes_wanted(self) -> int:
        """Bytes still missing of the frame (or header) being received; 0 when none is open."""
        return self._pending_needs - len(self._pending) if self._pending else 0

    @property
    def counters(self) -> LinkCounters:
        """A snapshot of the counts since this scanner was made."""
        return LinkCounters(
            bytes_received=self._bytes_received,
            frames_ok=sum(self._frames_by_type.values()),
            frames_by_type=dict(self._frames_by_type),
            checksum_errors=self._checksum_errors,
            length_errors=self._length_errors,
            bytes_skipped=self._bytes_skipped,
            resyncs=self._resyncs,
        )

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes of the stream; returns the whole, intact frames they completed, in order."""
        self._bytes_received += len(data)
        if self._pending:
            self._pending += data
            if len(self._pending) < self._pending_needs and self._may_begin_a_frame():
                return []
            data = bytes(self._pending)
            self._pending.clear()
        return self._scan(data)

    def flush(self) -> list[bytes]:
        """Give up the incomplete frame (the stream ended); returns frames found inside it."""
        frames: list[bytes] = []
        while self._pending:
            rest = bytes(self._pending)
            self._pending.clear()
            self._skip(1)
            frames += self._scan(rest[1:])
        return frames

    def _scan(self, data: bytes) -> list[bytes]:
        frames: list[bytes] = []
        header_bytes, total_bytes = self._format.header_bytes, self._format.total_bytes
        is_intact, type_offset = self._format.is_intact, self._format.type_offset
        size = len(data)
        position = 0
        while position < size:
            start = self._find(data, position)
            if start > position:
                self._skip(start - position)
            if start + header_bytes > size:
                self._hold(data, start, header_bytes)
                break
            total = total_bytes(data, start)
            if total is None:
                self._length_errors += 1
            elif start + total > size:
                self._hold(data, start, total)
                break
            else:
                frame = data[start : start + total]
                if is_intact(frame):
                    self._count(frame[type_offset])
                    frames.append(frame)
                    position = start + total
                    continue
                self._checksum_errors += 1
            self._skip(1)
            position = start + 1
        return frames

    def _may_begin_a_frame(self) -> bool:
        """Half a sync may have been held; its other half decides at once, not when a header's worth has come."""
        sync_bytes = len(self._format.syncs[0])
        return len(self._pending) < sync_bytes or self._pending[:sync_bytes] in self._format.syncs

    def _hold(self, data: bytes, start: int, needs: int) -> None:
        self._pending += memoryview(data)[start:]
        self._pending_needs = needs

    def _skip(self, count: int) -> None:
        self._bytes_skipped += count
        self._skipping = True

    def _count(self, frame_type: int) -> None:
        self._frames_by_type[frame_type] = self._frames_by_type.get(frame_type, 0) + 1
        if self._skipping:
            self._skipping = False
            self._resyncs += 1


def _sync_finder(syncs: tuple[bytes, ...]) -> Callable[[bytes, int], int]:
    """A function that finds the next sync, or the place where the data ends in the beginning of one, or the end."""
    length = len(syncs[0])
    beginnings = {sync[:count] for sync in syncs for count in range(1, length)}

    def end_of_search(data: bytes, position: int) -> int:
        for count in range(min(length - 1, len(data) - position), 0, -1):
            if data[-count:] in beginnings:
                return len(data) - count
        return len(data)

    if len(syncs) == 1:
        only = syncs[0]

        def find_one(data: bytes, position: int) -> int:
            start = data.find(only, position)
            return start if start >= 0 else end_of_search(data, position)

        return find_one

    search = re.compile(b"|".join(re.escape(sync) for sync in syncs)).search

    def find_any(data: bytes, position: int) -> int:
        match = search(data, position)
        return match.start() if match else end_of_search(data, position)

    return find_any
