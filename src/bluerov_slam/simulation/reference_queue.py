"""What the reference board has waiting to be sent, by urgency; whole pings go when the line is too slow.

`docs/firmware-core.md` sections 2 (ping store) and 3. The native core's twin is `send_queue.cpp`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import IntEnum

from bluerov_slam.protocol.esp32_messages import (
    CommandAckFields,
    MessageType,
    encode_frame,
    pack_command_ack,
)
from bluerov_slam.records import AckResult, Channel

_FRAME_OVERHEAD = 6
_LENGTH_BYTES = 2  # a stored frame lies behind its length
_PING_STORE_BYTES = 12_288
_MAX_PINGS = 16
_PING_PERCENT = 15  # of the line's bytes per second may wait in pings


class Urgency(IntEnum):
    """Smaller goes first; pings come after all of these."""

    SENSORS = 0
    ACKS = 1
    REPORTS = 2
    SONAR_OTHER = 3


_MAX_FRAMES = {Urgency.SENSORS: 4, Urgency.ACKS: 32, Urgency.REPORTS: 32, Urgency.SONAR_OTHER: 32}
_MAX_OTHER_BYTES = 8_192


@dataclass(slots=True)
class _Ping:
    channel: Channel
    frames: deque[bytes]
    bytes: int
    """Of its frames, without their lengths."""

    @property
    def stored_bytes(self) -> int:
        return self.bytes + _LENGTH_BYTES * len(self.frames)


class SendQueue:
    """Encoded frames and pings, oldest first in each urgency."""

    def __init__(self) -> None:
        self.pings_dropped = dict.fromkeys(Channel, 0)
        self.lost_sonar_bytes = dict.fromkeys(Channel, 0)
        self._frames: tuple[deque[bytes], ...] = tuple(deque() for _ in Urgency)
        self._other_bytes = 0
        self._pings: deque[_Ping] = deque()
        self._sending: _Ping | None = None
        self._last_dropped = Channel.B

    @property
    def acks_empty(self) -> bool:
        """Whether every acknowledgement was handed over."""
        return not self._frames[Urgency.ACKS]

    def put(self, urgency: Urgency, frame_type: int, payload: bytes) -> None:
        """Queue a frame behind those of its urgency; a full queue loses its oldest."""
        frame = encode_frame(frame_type, payload)
        waiting = self._frames[urgency]
        stored = len(frame) + _LENGTH_BYTES
        if urgency is Urgency.SONAR_OTHER:
            while waiting and self._other_bytes + stored > _MAX_OTHER_BYTES:
                self._lose_oldest(urgency)
            self._other_bytes += stored
        if len(waiting) >= _MAX_FRAMES[urgency]:
            self._lose_oldest(urgency)
        waiting.append(frame)

    def acknowledge(self, acked_type: int, sequence: int, result: AckResult) -> None:
        """Queue a COMMAND_ACK."""
        payload = pack_command_ack(CommandAckFields(acked_type, sequence, result))
        self.put(Urgency.ACKS, MessageType.COMMAND_ACK, payload)

    def put_ping(self, channel: Channel, payloads: list[tuple[int, bytes]], bytes_per_s: int) -> None:
        """Queue a ping as a whole, or count it as dropped; then drop others in turn while too many bytes wait."""
        frames = deque(encode_frame(*payload) for payload in payloads)
        ping = _Ping(channel, frames, sum(map(len, frames)))
        stored = [other for other in self._pings if other.channel is channel]
        if self._sending is not None and self._sending.channel is channel:
            stored.append(self._sending)
        used = sum(other.stored_bytes for other in stored)
        if len(stored) >= _MAX_PINGS or used + ping.stored_bytes > _PING_STORE_BYTES:
            self.pings_dropped[channel] += 1
            return
        self._pings.append(ping)
        if self._sending is None:
            self._sending = self._pings.popleft()
        limit = bytes_per_s * _PING_PERCENT // 100
        while len(self._pings) > 1 and sum(waiting.bytes for waiting in self._pings) > limit:
            self._drop_one()

    def drop_sonar_data(self) -> None:
        """Lose every ping, the one being sent included, and every other sonar frame."""
        while self._frames[Urgency.SONAR_OTHER]:
            self._lose_oldest(Urgency.SONAR_OTHER)
        for ping in (*self._pings, *([self._sending] if self._sending else [])):
            self.pings_dropped[ping.channel] += 1
        self._pings.clear()
        self._sending = None

    def next_length(self, acks_only: bool) -> int:
        """Length of the frame to send next, 0 for none. `acks_only`: during a change of the line's rate."""
        for waiting in self._frames[Urgency.ACKS : Urgency.REPORTS] if acks_only else self._frames:
            if waiting:
                return len(waiting[0])
        if acks_only:
            return 0
        if self._sending is not None:
            return len(self._sending.frames[0])
        return len(self._pings[0].frames[0]) if self._pings else 0

    def take(self, acks_only: bool) -> bytes:
        """The frame whose length `next_length` gave."""
        for urgency in (Urgency.ACKS,) if acks_only else Urgency:
            if self._frames[urgency]:
                return self._pop(urgency)
        if self._sending is None:
            self._sending = self._pings.popleft()
        ping = self._sending
        frame = ping.frames.popleft()
        ping.bytes -= len(frame)
        if not ping.frames:
            self._sending = None
        return frame

    def _pop(self, urgency: Urgency) -> bytes:
        frame = self._frames[urgency].popleft()
        if urgency is Urgency.SONAR_OTHER:
            self._other_bytes -= len(frame) + _LENGTH_BYTES
        return frame

    def _lose_oldest(self, urgency: Urgency) -> None:
        frame = self._pop(urgency)
        if urgency is Urgency.SONAR_OTHER:
            channel = Channel.A if frame[2] == MessageType.KOGGER_RAW_A else Channel.B
            self.lost_sonar_bytes[channel] += len(frame) - _FRAME_OVERHEAD

    def _drop_one(self) -> None:
        wanted = Channel.A if self._last_dropped is Channel.B else Channel.B
        index = next((i for i, ping in enumerate(self._pings) if ping.channel is wanted), 0)
        channel = self._pings[index].channel
        del self._pings[index]
        self.pings_dropped[channel] += 1
        self._last_dropped = channel
