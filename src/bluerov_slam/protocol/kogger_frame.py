"""BB55 ("KP1") and CC55 ("KP2") frames of the Kogger sonars: bytes in, frames out, and back.

    BB 55 | route | mode | id | length | payload | check1 check2            payload 0..255
    CC 55 | u16 total | u8 n | options (n-1) | flags | u16 id-version | payload | check1 check2

MODE: bits 0-1 type, 3-5 version, 6 MARK, 7 RESPONSE. The checks are two 8-bit wrapping sums over everything behind
the sync. Some senders use the textbook Fletcher-16 (modulo 255) instead; the sonars and KoggerApp reject it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from bluerov_slam.protocol.checksums import kogger_mod255, kogger_mod256
from bluerov_slam.protocol.framing import FrameFormat, FrameScanner
from bluerov_slam.records import LinkCounters

KOGGER_SYNC = b"\xbb\x55"
KOGGER_V2_SYNC = b"\xcc\x55"
MAX_PAYLOAD_BYTES = 255
MAX_FRAME_BYTES = MAX_PAYLOAD_BYTES + 8
MAX_V2_FRAME_BYTES = 384
"""KoggerApp's own limit; its recorder and bridge may use more, side-scans none of it."""

FRAMES_TO_LEARN = 10
"""So many frames in a row with the other checksum make `auto` switch."""

ChecksumChoice = Literal["auto", "mod256", "mod255"]
Checksum = Literal["mod256", "mod255"]

_V1_HEADER_BYTES = 6
_V1_OVERHEAD_BYTES = 8
_V2_HEADER_BYTES = 5
_V2_OVERHEAD_BYTES = 10  # sync, total, n, flags, id-version, checks
_V2_PROXY_OVERHEAD_BYTES = 7
_MAX_PROXY_DEPTH = 3
_OPTION_PROXY = 1 << 0
_OPTION_ADDRESS = 1 << 1


class FrameType(IntEnum):
    """MODE bits 0-1."""

    RESERVED = 0
    CONTENT = 1
    SETTING = 2
    GETTING = 3


class KoggerId(IntEnum):
    """The IDs this package names; a frame may carry any other."""

    TIMESTAMP = 0x01
    DISTANCE = 0x02
    CHART = 0x03
    ATTITUDE = 0x04
    TEMPERATURE = 0x05
    DATASET = 0x10
    DISTANCE_SETUP = 0x11
    CHART_SETUP = 0x12
    DSP = 0x13
    TRANSCEIVER = 0x14
    SOUND_SPEED = 0x15
    UART = 0x18
    VERSION = 0x20
    MARK = 0x21
    FLASH = 0x23
    BOOT = 0x24
    UPDATE = 0x25
    NAVIGATION = 0x64


@dataclass(frozen=True, slots=True)
class KoggerFrame:
    """One checked frame. `raw` is what came in, sync and checks included (empty for a frame that was never sent)."""

    route: int
    frame_type: int
    version: int
    mark: bool
    response: bool
    frame_id: int
    payload: bytes
    is_v2: bool = False
    raw: bytes = b""

    @property
    def check(self) -> bytes:
        """The two check bytes as received; what a result frame quotes."""
        return self.raw[-2:]

    def to_bytes(self, route: int | None = None) -> bytes:
        """The frame with mod-256 checks, always; `route` replaces the address. Unchanged frames come back as received.

        A CC55 frame becomes BB55 where its payload fits, else a CC55 frame with only the address option.
        """
        route = self.route if route is None else route
        if self.raw and not self.is_v2 and kogger_mod256(self.raw[2:-2]) == self.raw[-2:]:
            return reroute(self.raw, route)
        fits = len(self.payload) <= MAX_PAYLOAD_BYTES and self.frame_id <= 0xFF
        build = build_frame if fits else build_v2_frame
        return build(
            self.frame_id,
            self.payload,
            frame_type=self.frame_type,
            version=self.version,
            route=route,
            mark=self.mark,
            response=self.response,
        )


def build_frame(
    frame_id: int,
    payload: bytes = b"",
    *,
    frame_type: int = FrameType.CONTENT,
    version: int = 0,
    route: int = 0,
    mark: bool = False,
    response: bool = False,
) -> bytes:
    """One BB55 frame with mod-256 checks. Payload at most 255 bytes."""
    mode = frame_type | version << 3 | mark << 6 | response << 7
    body = bytes((route, mode, frame_id, len(payload))) + payload
    return KOGGER_SYNC + body + kogger_mod256(body)


def build_v2_frame(
    frame_id: int,
    payload: bytes = b"",
    *,
    frame_type: int = FrameType.CONTENT,
    version: int = 0,
    route: int = 0,
    mark: bool = False,
    response: bool = False,
) -> bytes:
    """One CC55 frame with the address option (`route`, then 0)."""
    options = _OPTION_ADDRESS.to_bytes(2, "little") + bytes((route, 0))
    total = _V2_OVERHEAD_BYTES + len(options) + len(payload)
    flags = frame_type | response << 2 | mark << 3
    id_version = (frame_id << 3 | version).to_bytes(2, "little")
    body = total.to_bytes(2, "little") + bytes((1 + len(options),)) + options + bytes((flags,)) + id_version + payload
    return KOGGER_V2_SYNC + body + kogger_mod256(body)


def reroute(frame: bytes, route: int) -> bytes:
    """A valid mod-256 BB55 frame with another ROUTE; the checks are adjusted, not summed anew."""
    change = route - frame[2]
    if change == 0:
        return frame
    # ROUTE is the first summed byte, so it enters the second sum once per summed byte: 4 header bytes + payload.
    check1 = (frame[-2] + change) & 0xFF
    check2 = (frame[-1] + change * (len(frame) - 4)) & 0xFF
    return b"\xbb\x55%c%b%c%c" % (route, frame[3:-2], check1, check2)


_CHECKS: dict[Checksum, Callable[[bytes], bytes]] = {"mod256": kogger_mod256, "mod255": kogger_mod255}
_OTHER: dict[Checksum, Checksum] = {"mod256": "mod255", "mod255": "mod256"}


class KoggerFrameDecoder:
    """Bytes of one stream, cut anywhere, to frames. After a false start the search resumes one byte further on.

    `checksum` "auto" starts strict (mod 256) and changes to the other sum after `FRAMES_TO_LEARN` frames in a row that
    fail the one in use and pass the other, with no good frame between. `checksum_switches` counts such changes,
    `other_checksum_frames` the frames refused though the other sum would have passed them. `bb55_only` passes over
    CC55 frames like noise, as the firmware does.
    """

    def __init__(self, checksum: ChecksumChoice = "auto", *, bb55_only: bool = False) -> None:
        self.checksum_in_use: Checksum = "mod255" if checksum == "mod255" else "mod256"
        self.checksum_switches = 0
        self.other_checksum_frames = 0
        self._learns = checksum == "auto"
        self._streak = 0
        self._scanner = FrameScanner(
            FrameFormat(
                syncs=(KOGGER_SYNC,) if bb55_only else (KOGGER_SYNC, KOGGER_V2_SYNC),
                header_bytes=_V1_HEADER_BYTES,
                type_offset=4,
                total_bytes=_frame_size,
                is_intact=self._is_intact,
            )
        )

    @property
    def counters(self) -> LinkCounters:
        """A snapshot. `frames_by_type` counts BB55 frames by ID (and CC55 frames by the length of their options)."""
        return self._scanner.counters

    @property
    def bytes_wanted(self) -> int:
        """Bytes still missing of the frame being received; 0 when none has begun."""
        return self._scanner.bytes_wanted

    def feed(self, data: bytes) -> list[KoggerFrame]:
        """The frames completed by these bytes, in order."""
        return self._parse(self._scanner.feed(data))

    def flush(self) -> list[KoggerFrame]:
        """The stream has ended: give up the frame being received, return those inside it."""
        return self._parse(self._scanner.flush())

    def _parse(self, intact: list[bytes]) -> list[KoggerFrame]:
        frames: list[KoggerFrame] = []
        for raw in intact:
            if raw[0] == KOGGER_SYNC[0]:
                frames.append(_parse_v1(raw))
            else:
                frames += _parse_v2(raw, self.checksum_in_use)
        return frames

    def _is_intact(self, raw: bytes) -> bool:
        body, check = raw[2:-2], raw[-2:]
        if _CHECKS[self.checksum_in_use](body) == check:
            self._streak = 0
            return True
        other = _OTHER[self.checksum_in_use]
        if _CHECKS[other](body) == check:
            self.other_checksum_frames += 1
            self._streak += 1
            if self._learns and self._streak >= FRAMES_TO_LEARN:
                self.checksum_in_use = other
                self.checksum_switches += 1
                self._streak = 0
        return False


def _frame_size(buffer: bytes, start: int) -> int | None:
    """Whole size of the frame whose header begins here, None if there is no such frame."""
    if buffer[start] == KOGGER_SYNC[0]:
        return _V1_OVERHEAD_BYTES + buffer[start + 5]
    total = buffer[start + 2] | buffer[start + 3] << 8
    option_bytes = buffer[start + 4] - 1
    if option_bytes < 0 or total > MAX_V2_FRAME_BYTES or total < _V2_PROXY_OVERHEAD_BYTES + option_bytes:
        return None
    return total


def _parse_v1(raw: bytes) -> KoggerFrame:
    mode = raw[3]
    return KoggerFrame(
        raw[2], mode & 3, mode >> 3 & 7, bool(mode & 0x40), bool(mode & 0x80), raw[4], raw[6:-2], False, raw
    )


def _parse_v2(raw: bytes, checksum: Checksum, depth: int = 0) -> list[KoggerFrame]:
    """The frame itself, or those inside it where it is a proxy; nothing if it is too short to say what it is."""
    content_start = _V2_HEADER_BYTES + raw[4] - 1
    options = raw[_V2_HEADER_BYTES:content_start]
    fields = int.from_bytes(options[:2], "little") if len(options) >= 2 else 0
    content = raw[content_start:-2]
    if fields & _OPTION_PROXY:
        return _parse_nested(content, checksum, depth + 1) if depth < _MAX_PROXY_DEPTH else []
    if len(content) < 3:
        return []
    flags, id_version = content[0], content[1] | content[2] << 8
    return [
        KoggerFrame(
            route=_v2_route(options, fields),
            frame_type=flags & 3,
            version=id_version & 7,
            mark=bool(flags & 8),
            response=bool(flags & 4),
            frame_id=id_version >> 3,
            payload=content[3:],
            is_v2=True,
            raw=raw,
        )
    ]


def _parse_nested(content: bytes, checksum: Checksum, depth: int) -> list[KoggerFrame]:
    """Frames inside a proxy frame: whole ones only, what is cut off ends with the proxy frame."""

    def is_intact(raw: bytes) -> bool:
        return _CHECKS[checksum](raw[2:-2]) == raw[-2:]

    scanner = FrameScanner(FrameFormat((KOGGER_SYNC, KOGGER_V2_SYNC), _V1_HEADER_BYTES, 4, _frame_size, is_intact))
    frames: list[KoggerFrame] = []
    for raw in scanner.feed(content) + scanner.flush():
        frames += [_parse_v1(raw)] if raw[0] == KOGGER_SYNC[0] else _parse_v2(raw, checksum, depth)
    return frames


def _v2_route(options: bytes, fields: int) -> int:
    """The first byte of the address option (where KoggerApp looks for the device's address), 0 without one."""
    return options[2] if fields & _OPTION_ADDRESS and len(options) >= 4 else 0
