"""A file that only grows, in whole blocks: a block that does not fit is taken back, never left cut."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


class AppendFile:
    """Collects writes and hands them to the kernel at `flush`, all or nothing. Has the stream methods MCAP needs."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self._parts: list[bytes] = []
        self._pending = 0
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)

    @property
    def is_deleted(self) -> bool:
        """Whether somebody deleted the file meanwhile: what is written into it vanishes with us."""
        return self._descriptor >= 0 and os.fstat(self._descriptor).st_nlink == 0

    def write(self, data: bytes) -> int:
        """Take bytes for the next flush."""
        self._parts.append(bytes(data))
        self._pending += len(data)
        return len(data)

    def tell(self) -> int:
        """Position after what was written, flushed or not."""
        return self.size + self._pending

    def flush(self) -> None:
        """Hand everything pending to the kernel. On OSError the file is back at its last whole block and it raises."""
        if not self._parts:
            return
        block = memoryview(b"".join(self._parts))
        self._parts.clear()
        self._pending = 0
        done = 0
        try:
            while done < len(block):
                done += os.write(self._descriptor, block[done:])
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self.size)
                os.lseek(self._descriptor, self.size, os.SEEK_SET)
            raise
        self.size += done

    def sync(self) -> None:
        """Have the kernel write to the disk itself, against a power cut."""
        os.fdatasync(self._descriptor)

    def close(self) -> None:
        """Release the file; what was not flushed is forgotten."""
        if self._descriptor >= 0:
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)
