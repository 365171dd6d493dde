"""Reads an autopilot's telemetry log (.tlog): MAVLink frames as they were, each with its time.

A .tlog is a plain sequence of u64 big-endian microseconds (unix) and one MAVLink 1 or 2 frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from bluerov_slam.errors import RecordingError

_STAMP_BYTES = 8
_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
_MAVLINK_1_OVERHEAD, _MAVLINK_2_OVERHEAD, _SIGNATURE_BYTES = 8, 12, 13
_SIGNED = 0x01
# A stamp outside these years is damage.
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000


@dataclass(frozen=True, slots=True)
class LoggedFrame:
    """One MAVLink frame of the log."""

    time_unix_s: float
    data: bytes


def read_vehicle_log(path: Path, on_skipped: Callable[[int], None] = lambda _count: None) -> list[LoggedFrame]:
    """Every frame of the log, in order; `on_skipped` hears of damaged bytes. Raises RecordingError without a frame."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}; give the path of a .tlog file") from error
    frames = list(parse_vehicle_log(content))
    if not frames:
        raise RecordingError(f"{path}: holds no MAVLink frame; give a .tlog as QGroundControl or MAVProxy writes it")
    on_skipped(len(content) - sum(_STAMP_BYTES + len(frame.data) for frame in frames))
    return frames


def parse_vehicle_log(content: bytes) -> Iterator[LoggedFrame]:
    """Frames of a log's bytes; damaged spans are stepped over byte by byte."""
    at = 0
    while at + _STAMP_BYTES < len(content):
        time_us = int.from_bytes(content[at : at + _STAMP_BYTES], "big")
        size = _frame_size(content, at + _STAMP_BYTES)
        end = at + _STAMP_BYTES + size
        if not size or end > len(content) or not _EARLIEST_US <= time_us <= _LATEST_US:
            at += 1
            continue
        yield LoggedFrame(time_us / 1.0e6, content[at + _STAMP_BYTES : end])
        at = end


def _frame_size(content: bytes, at: int) -> int:
    """Bytes of the frame that starts here, 0 if none does."""
    if content[at] == _MAVLINK_1 and at + 1 < len(content):
        return content[at + 1] + _MAVLINK_1_OVERHEAD
    if content[at] == _MAVLINK_2 and at + 2 < len(content):
        signature = _SIGNATURE_BYTES if content[at + 2] & _SIGNED else 0
        return content[at + 1] + _MAVLINK_2_OVERHEAD + signature
    return 0
