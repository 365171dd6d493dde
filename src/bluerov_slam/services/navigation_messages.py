"""What the extension and its navigation worker say to each other: one request, one answer, each a framed pickle.

Both ends are this package at the same version and the pipe is theirs alone, so nothing foreign is ever unpickled.
"""

from __future__ import annotations

import pickle
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from bluerov_slam.errors import BugError
from bluerov_slam.protocol.navigation_json import FixOutcome
from bluerov_slam.records import AcousticFix, AcousticMessage, Event, NavState, Record

LENGTH: Final = struct.Struct("<I")
# A frame is at most a few hundred records, 64 of them raw acoustic ones of 256 kB; more is no frame of ours.
LONGEST_FRAME_BYTES: Final = 32_000_000


@dataclass(frozen=True, slots=True)
class Setup:
    """The first message. `navigator`: "module:name" of its factory, `options`: what it is given.

    `state_file` None: nothing is kept or resumed.
    """

    navigator: str
    options: Any
    state_file: str | None
    boot_id: str | None = None


@dataclass(frozen=True, slots=True)
class Ask:
    """An action of the user for the navigator. Answered by a `Reply` of the same number."""

    number: int
    action: str
    arguments: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Work:
    """Records in order of arrival, then actions. `expire_s`: the time, where no record came for a while."""

    records: tuple[Record, ...] = ()
    asks: tuple[Ask, ...] = ()
    expire_s: float | None = None


@dataclass(frozen=True, slots=True)
class Reply:
    """What became of an action, in a sentence."""

    number: int
    ok: bool
    message: str


@dataclass(frozen=True, slots=True)
class PlacedState:
    """A state with its latitude and longitude, None while the position is unknown."""

    state: NavState
    position_deg: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Done:
    """The answer to one `Work`. `save_error`: why the last save failed; `calibrations`, `water`: as the API shows them.

    `water` is None where it is what it was before.
    """

    states: tuple[PlacedState, ...] = ()
    events: tuple[Event, ...] = ()
    fixes: tuple[FixOutcome, ...] = ()
    replies: tuple[Reply, ...] = ()
    calibrations: tuple[Mapping[str, Any], ...] = ()
    water: Mapping[str, Any] | None = None
    statistics: Mapping[str, Any] = field(default_factory=dict)
    save_error: str | None = None
    resumed: str | None = None
    acoustics: tuple[AcousticFix | AcousticMessage, ...] = ()


def pack(message: object) -> bytes:
    """One frame."""
    body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(body)) + body


def unpack(body: bytes) -> Any:
    """The message of a frame's body."""
    return pickle.loads(body)  # noqa: S301  written by our own other half


def body_length(header: bytes) -> int:
    """How many bytes follow a frame's header."""
    (length,) = LENGTH.unpack(header)
    if length > LONGEST_FRAME_BYTES:
        raise BugError(f"a frame of {length} bytes on the navigation worker's pipe")
    return int(length)


def read_message(read: Callable[[int], bytes]) -> Any:
    """The next message from a blocking stream; None at its end, also in the middle of a frame."""
    header = _read_exactly(read, LENGTH.size)
    body = _read_exactly(read, body_length(header)) if header is not None else None
    return None if body is None else unpack(body)


def _read_exactly(read: Callable[[int], bytes], count: int) -> bytes | None:
    data = b""
    while len(data) < count:
        part = read(count - len(data))
        if not part:
            return None
        data += part
    return data
