"""Watches the space left for recordings: stop before the disk is full, go on by itself when there is space again."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from bluerov_slam.errors import RecordingError

# Recording resumes only with this much above the limit, so that it does not flap at the edge.
RESUME_MARGIN = 0.1


class DiskFullError(RecordingError):
    """Too little space is left to go on recording."""


@dataclass(frozen=True, slots=True)
class DiskState:
    """Free and total bytes of the disk that holds the recordings; None where it cannot be asked."""

    free_bytes: int | None
    total_bytes: int | None


class DiskGuard:
    """Says whether there is enough free space below `folder` to record; keeps its own hysteresis."""

    def __init__(self, folder: Path, min_free_bytes: int) -> None:
        self.folder = folder
        self.min_free_bytes = min_free_bytes
        self.state = DiskState(None, None)
        self._low = False

    def problem(self) -> str | None:
        """Measure now. None when recording may go on, otherwise what is wrong and its cure."""
        self.state = disk_state(self.folder)
        free = self.state.free_bytes
        if free is None:
            return None  # opening the file will say what is wrong with the folder
        limit = self.min_free_bytes * (1.0 + RESUME_MARGIN) if self._low else self.min_free_bytes
        self._low = free < limit
        if not self._low:
            return None
        return (
            f"disk nearly full: {free / 1e6:.0f} MB free, recording keeps {self.min_free_bytes / 1e6:.0f} MB free; "
            "delete or download old recordings, or lower recording.min_free_mb; recording resumes by itself"
        )

    def seconds_left(self, bytes_per_s: float) -> float | None:
        """How long the space above the limit lasts at this rate; None when unknown."""
        if self.state.free_bytes is None or bytes_per_s <= 0.0:
            return None
        return max(0.0, (self.state.free_bytes - self.min_free_bytes) / bytes_per_s)


def disk_state(folder: Path) -> DiskState:
    """Space of the disk that holds `folder`, or would hold it once made."""
    for candidate in (folder, *folder.parents):
        try:
            usage = shutil.disk_usage(candidate)
        except OSError:
            continue
        return DiskState(usage.free, usage.total)
    return DiskState(None, None)


def describe_os_error(error: OSError, folder: Path) -> str:
    """An OS error of the recordings folder as one sentence with its cure."""
    what = error.strerror or str(error)
    match error.errno:
        case errno.ENOSPC | errno.EDQUOT:
            cure = "delete or download old recordings; recording resumes by itself"
        case errno.EFBIG:
            cure = "a file size limit is set for this process: raise it (ulimit -f) or lower recording.max_file_mb"
        case errno.EROFS:
            cure = "the disk is mounted read-only: bind a writable folder or set recording.folder"
        case errno.EACCES | errno.EPERM:
            cure = f"user {os.geteuid()} may not write there: change its owner or set recording.folder"
        case errno.ENOTDIR | errno.EEXIST:
            cure = "something that is not a folder is in the way: remove it or set recording.folder"
        case errno.EIO:
            cure = "the disk reports errors: copy your recordings away and replace it"
        case _:
            cure = "check recording.folder; recording goes on by itself once it can be written"
    return f"cannot record into {folder}: {what}; {cure}"
