"""session.json: what a dive is called and what is known about its clock. Written whole and atomically."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import orjson

FILE_NAME = "session.json"
FORMAT_VERSION = 1

# The recorder's thread and the web page's worker change different keys of the same file.
_write_lock = threading.Lock()


def new_session(name: str, started_unix_s: float, started_mono_s: float) -> dict[str, Any]:
    """The content of a session that starts now; unknown is None."""
    return {
        "version": FORMAT_VERSION,
        "name": name,
        "title": "",
        "notes": "",
        "annotations": [],
        "closed": False,
        "started_unix_s": started_unix_s,
        "started_mono_s": started_mono_s,
        "duration_s": None,
        "pings_a": None,
        "pings_b": None,
        "wall_clock_trusted": None,
        "gps_utc_offset_s": None,
        "wall_steps": [],
    }


def read_session(folder: Path) -> dict[str, Any]:
    """What session.json of this session folder says; an absent or broken file reads as empty."""
    try:
        content = orjson.loads((folder / FILE_NAME).read_bytes())
    except (OSError, orjson.JSONDecodeError):
        return {}
    return content if isinstance(content, dict) else {}


def change_session(folder: Path, change: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Read, let `change` edit, write back; never half a file. Raises OSError."""
    with _write_lock:
        content = read_session(folder)
        if not content:
            _set_aside(folder / FILE_NAME)
        change(content)
        _replace(folder / FILE_NAME, orjson.dumps(content, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE))
        return content


def _set_aside(path: Path) -> None:
    """A file that does not read may still hold a user's words: it is kept beside the new one."""
    if path.exists():
        path.replace(path.with_name(path.name + ".damaged"))


def _replace(path: Path, data: bytes) -> None:
    temporary = path.with_name(path.name + ".new")
    try:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
