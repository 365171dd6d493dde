"""The navigator's saved state on disk: whole or not at all, written in a thread, so that no disk delays an estimate."""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import orjson

_log = logging.getLogger(__name__)

VERSION: Final = 1
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str | None:
    """Which boot of the computer this is: saved instants of the monotonic clock mean nothing in another one."""
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return None


class NavigationStateFile:
    """`save` hands over and returns; `error` is what the last write failed with, None once one succeeded."""

    def __init__(self, path: Path, boot: str | None) -> None:
        self.path = path
        self.error: str | None = None
        self._boot = boot
        self._waiting: bytes | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._write_all, name="navigation-state", daemon=True)
        self._thread.start()

    def save(self, saved: Mapping[str, Any]) -> None:
        """Write this as soon as the disk can; what still waits is replaced by it."""
        document = {"version": VERSION, "boot_id": self._boot, "navigation": saved}
        data = orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)
        with self._changed:
            self._waiting = data
            self._changed.notify()

    def close(self) -> None:
        """Write what waits and end."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(timeout=2.0)

    def _write_all(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None and not self._closed:
                    self._changed.wait()
                data, self._waiting = self._waiting, None
            if data is None:
                return
            self._write(data)

    def _write(self, data: bytes) -> None:
        fresh = self.path.with_name(f".{self.path.name}.new")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with fresh.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            fresh.replace(self.path)
        except OSError as error:
            if self.error is None:
                _log.warning("%s cannot be written: %s", self.path, error)
            self.error = error.strerror or str(error)
        else:
            self.error = None


def load_saved(path: Path, boot: str | None) -> tuple[dict[str, Any] | None, bool, str | None]:
    """What was saved, whether in this boot of the computer, and what is wrong with the file (None: nothing)."""
    try:
        document = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None, False, None
    except (OSError, ValueError) as error:
        return None, False, f"{path.name} cannot be read ({error}): starting anew"
    if not isinstance(document, dict) or document.get("version") != VERSION:
        return None, False, f"{path.name} is of another version: starting anew"
    saved = document.get("navigation")
    if not isinstance(saved, dict):
        return None, False, f"{path.name} is damaged: starting anew"
    return saved, boot is not None and document.get("boot_id") == boot, None
