"""Notes and contacts that a user keeps with a dive: what they may hold."""

from __future__ import annotations

import math
import re
from typing import Any

from bluerov_slam.errors import RecordingError

MAX_TEXT = 4000
MAX_ANNOTATIONS = 10_000
KINDS = ("note", "contact")

_ID = re.compile(r"[A-Za-z0-9_-]{1,40}")
_TEXTS = ("text", "name", "note")
_NUMBERS = {
    "time_unix_s": (0.0, 1e11),
    "range_m": (-1e4, 1e4),  # port is negative on some pages
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    "ping_number": (0.0, float(2**32 - 1)),
}


def checked_annotation(given: dict[str, Any]) -> dict[str, Any]:
    """`given` without anything unexpected in it. Raises RecordingError naming the key."""
    checked: dict[str, Any] = {}
    if "id" in given:
        checked["id"] = _checked_id(given["id"])
    for key, value in given.items():
        if key == "id":
            continue
        checked[key] = None if value is None else _checked_value(key, value)
    return checked


def checked_text(key: str, value: object) -> str:
    """A text of reasonable length. Raises RecordingError."""
    if not isinstance(value, str):
        raise RecordingError(f"{key}: expected a text, got {type(value).__name__}")
    if len(value) > MAX_TEXT:
        raise RecordingError(f"{key}: {len(value)} characters, at most {MAX_TEXT}")
    return value


def _checked_id(value: object) -> str:
    if not isinstance(value, str) or not _ID.fullmatch(value):
        raise RecordingError("id: expected up to 40 letters, digits, - or _")
    return value


def _checked_value(key: str, value: object) -> object:
    if key in _TEXTS:
        return checked_text(key, value)
    if key in _NUMBERS:
        return _checked_number(key, value)
    if key == "kind":
        if value not in KINDS:
            raise RecordingError(f"kind: {value!r}, expected one of {', '.join(KINDS)}")
        return value
    if key == "channel":
        if value not in ("A", "B"):
            raise RecordingError(f"channel: {value!r}, expected A or B")
        return value
    known = ", ".join(["kind", "channel", *_TEXTS, *_NUMBERS])
    raise RecordingError(f"unknown key {key!r} in an annotation; known: {known}")


def _checked_number(key: str, value: object) -> float | int:
    lowest, highest = _NUMBERS[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RecordingError(f"{key}: expected a number, got {value!r}")
    if not lowest <= value <= highest:
        raise RecordingError(f"{key}: {value}, expected {lowest:g}..{highest:g}")
    return int(value) if key == "ping_number" else value
