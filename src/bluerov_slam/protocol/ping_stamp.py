"""A BB55 frame of our own, from the extension to the viewer beside it: when the frames behind it were measured.

Kogger charts carry no time, and UDP arrival smears on a busy computer. The stamp goes before the sonar's frames of a
datagram, to this computer's viewer only and only while it is connected; KoggerApp would ignore the unknown ID.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bluerov_slam.protocol.kogger_frame import FrameType, build_frame

if TYPE_CHECKING:
    from bluerov_slam.protocol.kogger_frame import KoggerFrame

# Free in the vendor's list of IDs.
PING_STAMP_ID: Final = 0xF0
_STAMP: Final = struct.Struct("<Bdd")
_LAST_OF_PING: Final = 1


@dataclass(frozen=True, slots=True)
class PingStamp:
    """`measured_s` on the host's monotonic clock (a replay: the recorded one), `unix_s` the same instant in UTC."""

    measured_s: float
    unix_s: float
    last_of_ping: bool


def pack_ping_stamp(stamp: PingStamp, route: int) -> bytes:
    """The stamp as a BB55 content frame."""
    payload = _STAMP.pack(_LAST_OF_PING * stamp.last_of_ping, stamp.measured_s, stamp.unix_s)
    return build_frame(PING_STAMP_ID, payload, route=route)


def unpack_ping_stamp(frame: KoggerFrame) -> PingStamp | None:
    """The stamp in a frame; None for every other frame."""
    if frame.frame_id != PING_STAMP_ID or frame.frame_type != FrameType.CONTENT or len(frame.payload) != _STAMP.size:
        return None
    flags, measured_s, unix_s = _STAMP.unpack(frame.payload)
    return PingStamp(measured_s, unix_s, bool(flags & _LAST_OF_PING))
