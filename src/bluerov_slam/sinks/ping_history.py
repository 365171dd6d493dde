"""Every packed ping of the dive in a bounded ring file, for scroll-back. It survives nothing: a restart is a new file.

The file is a ring of fixed blocks, each holding whole records of both sonars in order of arrival. Only a few numbers
per block stay in memory. The file is read and written with pread/pwrite, never mapped: mapped pages would count
against the memory limit of the services.
"""

from __future__ import annotations

import errno
import logging
import os
import struct
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.records import Channel

logger = logging.getLogger(__name__)

BLOCK_BYTES = 64 * 1024
# Full blocks waiting for the disk: 2 MB, about a minute of both sonars at full load.
UNWRITTEN_BLOCKS = 32
# The recordings matter more than scroll-back: growth stops while at least this much of the disk is left.
KEEP_FREE_BYTES = 256 * 1024 * 1024
MAXIMUM_ANSWER_BYTES = 4 * 1024 * 1024
_RECORD = struct.Struct("<IBI")  # bytes of the packed ping, channel index, ping number
_NONE = -1


@dataclass(slots=True)
class _Block:
    """Records being collected or waiting for the disk."""

    data: bytearray = field(default_factory=bytearray)
    first: list[int] = field(default_factory=lambda: [_NONE, _NONE])
    last: list[int] = field(default_factory=lambda: [_NONE, _NONE])

    def add(self, channel_index: int, number: int, packed: bytes) -> None:
        self.data += _RECORD.pack(len(packed), channel_index, number)
        self.data += packed
        if self.first[channel_index] == _NONE:
            self.first[channel_index] = number
        self.last[channel_index] = number


class PingHistory:
    """Append from the event loop (never waits for the disk), write and read from worker threads."""

    def __init__(
        self,
        folder: Path,
        capacity_bytes: int,
        keep_free_bytes: int = KEEP_FREE_BYTES,
        free_bytes: Callable[[int], int] | None = None,
    ) -> None:
        self.message: str | None = None
        self.blocks_dropped = 0
        self.pings_refused = 0
        self._lock = threading.Lock()
        # Held while the descriptor is used, so that closing it cannot hand its number to another file meanwhile.
        self._file_lock = threading.RLock()
        self._keep_free_bytes = keep_free_bytes
        self._free_bytes = free_bytes or _free_bytes
        self._capacity = max(1, capacity_bytes // BLOCK_BYTES)
        self._open = _Block()
        self._unwritten: deque[_Block] = deque()
        # One row per block of the file: first and last number of A, of B; -1 = none. `_used` rows are valid.
        self._index = np.full((self._capacity, 4), _NONE, dtype=np.int64)
        self._generation = np.zeros(self._capacity, dtype=np.int64)
        self._used = 0
        self._next = 0
        self._file = self._create(folder)

    def append(self, channel: Channel, number: int, packed: bytes) -> bool:
        """Keep one ping; True when a block became full and `write_pending` should be run in a worker."""
        size = _RECORD.size + len(packed)
        if size > BLOCK_BYTES:
            self.pings_refused += 1
            return False
        with self._lock:
            full = len(self._open.data) + size > BLOCK_BYTES
            if full:
                self._unwritten.append(self._open)
                self._open = _Block()
                if len(self._unwritten) > UNWRITTEN_BLOCKS:
                    self._unwritten.popleft()
                    self.blocks_dropped += 1
            self._open.add(channel.index, number, packed)
            return full and self._file is not None

    def write_pending(self) -> None:
        """Write the full blocks to the file. For one worker thread at a time."""
        while True:
            with self._lock:
                if not self._unwritten:
                    return
                block = self._unwritten[0]
            with self._file_lock:
                if self._file is None or not self._write(self._file, block):
                    return
            with self._lock:
                if self._unwritten and self._unwritten[0] is block:
                    self._unwritten.popleft()

    def read(
        self, channel: Channel, *, before: int | None = None, after: int | None = None, limit: int = 200
    ) -> list[bytes]:
        """Packed pings of a channel, oldest first: the last ones below `before`, or the first ones above `after`."""
        forward = after is not None and before is None
        lowest = 0 if after is None else after + 1
        highest = np.iinfo(np.int64).max if before is None else before - 1
        found: list[list[bytes]] = []
        count = size = 0
        for block in self._candidates(channel.index, lowest, int(highest), forward):
            data = block() if callable(block) else block
            pings = [p for n, p in _records(data, channel.index) if lowest <= n <= highest]
            wanted = max(0, limit - count)
            pings = pings[:wanted] if forward else pings[max(0, len(pings) - wanted) :]
            found.append(pings)
            count += len(pings)
            size += sum(map(len, pings))
            if count >= limit or size > MAXIMUM_ANSWER_BYTES:
                break
        if not forward:
            found.reverse()
        return [ping for pings in found for ping in pings]

    def span(self, channel: Channel) -> tuple[int, int] | None:
        """First and last ping number kept of a channel."""
        with self._lock:
            firsts, lasts = self._columns(channel.index)
            held = lasts != _NONE
            numbers = [*firsts[held][:1].tolist(), *lasts[held][-1:].tolist()]
            for block in (*self._unwritten, self._open):
                if block.last[channel.index] != _NONE:
                    numbers += [block.first[channel.index], block.last[channel.index]]
        return (numbers[0], numbers[-1]) if numbers else None

    def close(self) -> None:
        """Give the file back to the disk."""
        with self._file_lock:
            if self._file is not None:
                os.close(self._file)
                self._file = None

    def _create(self, folder: Path) -> int | None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor, name = tempfile.mkstemp(prefix="pings_", suffix=".ring", dir=folder)
            # Unlinked at once: even SIGKILL leaves nothing behind.
            os.unlink(name)
        except OSError as error:
            self._say(f"no scroll-back beyond the last minute: cannot create a file in {folder} ({error.strerror})")
            return None
        return descriptor

    def _write(self, file: int, block: _Block) -> bool:
        with self._lock:
            growing = self._used < self._capacity
        if growing and self._used and self._free_bytes(file) < self._keep_free_bytes:
            self._shrink("the disk is nearly full")
        with self._lock:
            slot = self._next
            self._index[slot] = _NONE
            self._generation[slot] += 1
        try:
            os.pwrite(file, block.data.ljust(BLOCK_BYTES, b"\0"), slot * BLOCK_BYTES)
        except OSError as error:
            return self._write_failed(error)
        with self._lock:
            self._index[slot] = (block.first[0], block.last[0], block.first[1], block.last[1])
            self._used = max(self._used, slot + 1)
            self._next = (slot + 1) % self._capacity
        return True

    def _write_failed(self, error: OSError) -> bool:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG) and 0 < self._used < self._capacity:
            self._shrink("the disk is full")
            return True  # the block is given up; the next one overwrites the oldest
        self._say(f"scroll-back stopped: writing its file failed ({error.strerror}); live pings go on")
        self.blocks_dropped += 1
        self.close()
        with self._lock:
            self._used = 0
        return False

    def _shrink(self, reason: str) -> None:
        with self._lock:
            self._capacity = self._used
            self._next = 0
        kept_mb = self._capacity * BLOCK_BYTES / 1e6
        self._say(f"{reason}: scroll-back is limited to the last {kept_mb:.0f} MB; free disk space to lengthen it")

    def _say(self, message: str) -> None:
        self.message = message
        logger.warning("ping history: %s", message)

    def _columns(self, channel_index: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and last numbers of the file's blocks, oldest block first. Call with the lock held."""
        order = self._order()
        return self._index[order, 2 * channel_index], self._index[order, 2 * channel_index + 1]

    def _order(self) -> NDArray[np.int64]:
        oldest = self._next if self._used == self._capacity else 0
        return (oldest + np.arange(self._used)) % max(1, self._used)

    def _candidates(
        self, channel_index: int, lowest: int, highest: int, forward: bool
    ) -> list[Callable[[], bytes] | bytes]:
        """Blocks that may hold wanted numbers, in reading order; those of the file are read only when asked for."""
        with self._lock:
            firsts, lasts = self._columns(channel_index)
            wanted = (lasts != _NONE) & (firsts <= highest) & (lasts >= lowest)
            slots = self._order()[wanted]
            generations = self._generation[slots]
            recent = [
                bytes(block.data)
                for block in (*self._unwritten, self._open)
                if block.last[channel_index] != _NONE
                and block.first[channel_index] <= highest
                and block.last[channel_index] >= lowest
            ]
        blocks: list[Callable[[], bytes] | bytes] = [
            self._reader(int(slot), int(generation)) for slot, generation in zip(slots, generations, strict=True)
        ]
        blocks += recent
        return blocks if forward else blocks[::-1]

    def _reader(self, slot: int, generation: int) -> Callable[[], bytes]:
        def read() -> bytes:
            with self._file_lock:
                if self._file is None:
                    return b""
                data = os.pread(self._file, BLOCK_BYTES, slot * BLOCK_BYTES)
            with self._lock:
                overwritten = self._generation[slot] != generation
            return b"" if overwritten else data

        return read


def _records(data: bytes | bytearray, channel_index: int) -> list[tuple[int, bytes]]:
    """(number, packed ping) of one channel from a block, in order; zero length ends it."""
    pings = []
    position = 0
    while position + _RECORD.size <= len(data):
        size, channel, number = _RECORD.unpack_from(data, position)
        if size == 0:
            break
        position += _RECORD.size
        if channel == channel_index:
            pings.append((number, bytes(data[position : position + size])))
        position += size
    return pings


def _free_bytes(descriptor: int) -> int:
    status = os.fstatvfs(descriptor)
    return status.f_bavail * status.f_frsize
