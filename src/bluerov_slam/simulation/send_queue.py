"""What the board still has to send: SENSORS before acknowledgements before reports before sonar data."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import IntEnum

from bluerov_slam.protocol.esp32_messages import (
    CommandAckFields,
    MessageType,
    encode_frame,
    pack_command_ack,
)
from bluerov_slam.records import AckResult, Channel

_MAX_WAITING = 32


class Priority(IntEnum):
    """Smaller goes first; whole pings come after all of these."""

    SENSORS = 0
    ACKS = 1
    REPORTS = 2
    SONAR_RAW = 3


class SendQueue:
    """Waiting frames by urgency, and waiting pings; a link too slow loses whole pings, each sonar in its turn."""

    def __init__(self, ping_limit_bytes: float) -> None:
        self.pings_dropped = dict.fromkeys(Channel, 0)
        self._frames: dict[Priority, deque[bytes]] = {priority: deque() for priority in Priority}
        self._pings: deque[tuple[Channel, deque[bytes]]] = deque()
        self._current: deque[bytes] = deque()
        self._ping_limit_bytes = ping_limit_bytes
        self._last_dropped = Channel.B
        self._after_acks: list[Callable[[], None]] = []

    def __bool__(self) -> bool:
        return bool(self._current or self._pings or any(self._frames.values()))

    def clear(self) -> None:
        """Forget everything that waits (the board restarts)."""
        for waiting in self._frames.values():
            waiting.clear()
        self._pings.clear()
        self._current.clear()
        self._after_acks.clear()

    def set_ping_limit(self, ping_limit_bytes: float) -> None:
        """How many bytes of pings may wait."""
        self._ping_limit_bytes = ping_limit_bytes

    def put(self, priority: Priority, frame_type: int, payload: bytes) -> int:
        """Queue a frame; returns how many bytes of an older one had to go."""
        waiting = self._frames[priority]
        lost = len(waiting.popleft()) if len(waiting) >= _MAX_WAITING else 0
        waiting.append(encode_frame(frame_type, payload))
        return lost

    def acknowledge(self, acked_type: int, sequence: int, result: AckResult) -> None:
        """Queue a COMMAND_ACK."""
        self.put(
            Priority.ACKS, MessageType.COMMAND_ACK, pack_command_ack(CommandAckFields(acked_type, sequence, result))
        )

    def after_acks(self, action: Callable[[], None]) -> None:
        """Do this as soon as the acknowledgements that wait now have gone out."""
        self._after_acks.append(action)

    def put_ping(self, channel: Channel, frames: list[tuple[int, bytes]]) -> None:
        """Queue a whole ping; drops whole ones, alternating channels, while too many bytes wait."""
        self._pings.append((channel, deque(encode_frame(*frame) for frame in frames)))
        while len(self._pings) > 1 and self._waiting_bytes() > self._ping_limit_bytes:
            self._drop_one()

    def pop(self) -> bytes:
        """The next frame to send; there must be one."""
        for priority in Priority:
            if self._frames[priority]:
                frame = self._frames[priority].popleft()
                return frame
            if priority is Priority.ACKS:
                self._run_after_acks()
        if not self._current:
            self._current = self._pings.popleft()[1]
        return self._current.popleft()

    def _run_after_acks(self) -> None:
        actions, self._after_acks = self._after_acks, []
        for action in actions:
            action()

    def _waiting_bytes(self) -> int:
        return sum(len(frame) for _, frames in self._pings for frame in frames)

    def _drop_one(self) -> None:
        wanted = Channel.A if self._last_dropped is Channel.B else Channel.B
        index = next((i for i, (channel, _) in enumerate(self._pings) if channel is wanted), 0)
        channel = self._pings[index][0]
        del self._pings[index]
        self.pings_dropped[channel] += 1
        self._last_dropped = channel
