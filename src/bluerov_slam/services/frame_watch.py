"""Tells, without decoding, whether link bytes that just came can wait for the next ones.

On a busy link a process is woken for every frame, with cold caches: decoding two frames at one wake-up costs little
more than one. A chunk of an unfinished ping gains nothing by being decoded at once, so it may wait for the frame
behind it, whose header tells when that is complete; so may an IMU burst or a STATUS. What somebody watches live or
waits for, SENSORS, acknowledgements and the end of a ping, is decoded at once, together with all that waited.
"""

from __future__ import annotations

from typing import Final

from bluerov_slam.protocol.esp32_messages import MessageType

_SYNC: Final = b"\xaa\x55"
# Sync, type, length, and of a KOGGER_COMPRESSED payload the channel and the flags.
_LOOK_BYTES: Final = 7
_OVERHEAD_BYTES: Final = 6
_LAST_OF_PING: Final = 0x40
_IN_A_HURRY: Final = frozenset({MessageType.SENSORS, MessageType.COMMAND_ACK})
_UNHURRIED: Final = frozenset({MessageType.IMU_BURST, MessageType.STATUS, MessageType.GPS})
# Asked for beyond any other frame (0.7 ms at 115200 baud), so that the next header comes with it.
_NEXT_HEADER_BYTES: Final = 8
# The shortest frame that is in a hurry, SENSORS, is twice as long: until its header is there, this costs no latency.
_UNKNOWN_FRAME_BYTES: Final = 40


_WATCHED_BYTES: Final = 16
# SENSORS frames come like clockwork, each up to one frame (21 ms at 115200 baud) late: so long before the next one is
# expected nobody sleeps through the boundary of two frames.
_SENSORS_MARGIN_S: Final = 0.03
_PART_LENGTHS_KEPT: Final = 16


class FrameWatch:
    """Follows the frame under way from block to block, and learns the rhythm of the link.

    `bytes_per_s` is the speed of the line: while it is known, an unfinished ping is waited for to its end, whose length
    the pings before it have told, unless a SENSORS frame is about to come in between.
    """

    def __init__(self, bytes_per_s: float | None = None) -> None:
        self.bytes_per_s = bytes_per_s
        self._missing = 0
        self._frame_type = 0
        self._may_wait = False
        self._tail = b""  # of the block before: a header may be cut
        self._part_bytes: int | None = None
        self._end_bytes: dict[int, int] = {}
        self._sensors_s: float | None = None
        self._sensors_period_s: float | None = None

    def decoded(self, data: bytes, wanted: int, arrived_s: float) -> int:
        """After decoding up to the end of `data`, with `wanted` bytes missing: how many bytes to wait for."""
        goes_on = wanted > 0 and self._missing - len(data) == wanted
        self._missing = wanted
        self._may_wait = False
        data = self._tail + data
        self._tail = data[-_LOOK_BYTES:]
        start = _open_frame(data, wanted)
        if start is None:
            if goes_on and self._frame_type in _IN_A_HURRY:
                return max(0, wanted - _WATCHED_BYTES)
            return wanted if wanted > _OVERHEAD_BYTES else _UNKNOWN_FRAME_BYTES
        return self._under_way(data, start, wanted, arrived_s)

    def bytes_to_wait(self, data: bytes, arrived_s: float) -> int:
        """How many more bytes these undecoded ones may wait for; 0: decode them now."""
        start = self._missing
        rest = len(data) - start
        if not self._may_wait or rest < _LOOK_BYTES or not data.startswith(_SYNC, start):
            return 0
        missing = _total_bytes(data, start) - rest
        # The frame whose header has just come is now the one under way.
        return self._under_way(data, start, missing, arrived_s) if missing > 0 else 0

    def _under_way(self, data: bytes, start: int, missing: int, arrived_s: float) -> int:
        """Note the open frame that begins at `start`; bytes until it is worth waking up."""
        frame_type, total = data[start + 2], _total_bytes(data, start)
        part_bytes, self._part_bytes = self._part_bytes, None
        self._missing, self._frame_type = missing, frame_type
        self._may_wait = _may_wait(data, start)
        if frame_type == MessageType.SENSORS:
            self._note_sensors(arrived_s)
        if frame_type in _IN_A_HURRY:
            # The last bytes are watched as they come: a timer is up to a millisecond late.
            return max(0, missing - _WATCHED_BYTES)
        until_header = missing + _NEXT_HEADER_BYTES
        if frame_type != MessageType.KOGGER_COMPRESSED:
            return until_header
        if self._may_wait:
            self._part_bytes = total
            until_end = until_header + self._end_bytes.get(total, 0)
            return until_end if self._is_clear(until_end, arrived_s) else until_header
        if part_bytes is not None and (part_bytes in self._end_bytes or len(self._end_bytes) < _PART_LENGTHS_KEPT):
            self._end_bytes[part_bytes] = total
        return until_header

    def _note_sensors(self, arrived_s: float) -> None:
        if self._sensors_s is not None and arrived_s > self._sensors_s:
            self._sensors_period_s = arrived_s - self._sensors_s
        self._sensors_s = arrived_s

    def _is_clear(self, wait_bytes: int, now_s: float) -> bool:
        """Whether no SENSORS frame is due while so many bytes come."""
        if self.bytes_per_s is None or self._sensors_s is None or self._sensors_period_s is None:
            return False
        return now_s + wait_bytes / self.bytes_per_s + _SENSORS_MARGIN_S < self._sensors_s + self._sensors_period_s


def _open_frame(data: bytes, wanted: int) -> int | None:
    """Where the frame begins of which `wanted` bytes are missing; None if its header is not in `data`."""
    start = data.rfind(_SYNC) if wanted else -1
    while start >= 0:
        here = len(data) - start
        # A sync may stand inside a payload: only one whose length agrees with the decoder is the open frame's.
        if here >= _LOOK_BYTES and _total_bytes(data, start) - here == wanted:
            return start
        start = data.rfind(_SYNC, 0, start)
    return None


def _total_bytes(data: bytes, start: int) -> int:
    return _OVERHEAD_BYTES + (data[start + 3] << 8 | data[start + 4])


def _may_wait(data: bytes, start: int) -> bool:
    frame_type = data[start + 2]
    if frame_type == MessageType.KOGGER_COMPRESSED:
        return not data[start + 6] & _LAST_OF_PING
    return frame_type in _UNHURRIED
