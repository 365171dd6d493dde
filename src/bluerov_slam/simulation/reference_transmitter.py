"""The reference board's end of the line: what may go now, and the change of its rate on trial.

`docs/firmware-core.md` section 3. All arithmetic is exact: `_free` is when the last byte handed over will be out, in
units of one microsecond divided by the baud rate.
"""

from __future__ import annotations

from bluerov_slam.protocol.esp32_messages import MessageType
from bluerov_slam.protocol.kogger_bundle import PAYLOAD_LIMIT_115200, PAYLOAD_LIMIT_921600
from bluerov_slam.simulation.board import ROM_BAUD, Output, Sink
from bluerov_slam.simulation.board_readers.readings import NEVER_US
from bluerov_slam.simulation.reference_queue import SendQueue

_BITS_US = 10_000_000  # ten bit times of one byte, in units of 1 us / baud
_WINDOW_SLOW_BYTES, _WINDOW_FAST_BYTES = 230, 552
_TRIAL_US = 5_000_000
_SONAR_TYPES = (MessageType.KOGGER_RAW_A, MessageType.KOGGER_RAW_B, MessageType.KOGGER_COMPRESSED)


class Transmitter:
    """Hands frames of a queue over to the line as long as the line has room."""

    def __init__(self, queue: SendQueue, baud: int) -> None:
        self.baud = baud
        self.bytes_sent = 0
        self.other_bytes_sent = 0
        """Of frames that carry no sonar data."""
        self._queue = queue
        self._free = 0
        self._pending_baud = 0
        self._trial_ends_us = NEVER_US
        self._baud_before = baud

    @property
    def bytes_per_s(self) -> int:
        """What the line carries when it never rests."""
        return self.baud // 10

    @property
    def payload_limit(self) -> int:
        """Largest payload of sonar data at the present rate."""
        return PAYLOAD_LIMIT_115200 if self.baud <= ROM_BAUD else PAYLOAD_LIMIT_921600

    def change_baud(self, baud: int) -> None:
        """Change the rate as soon as the acknowledgements are out; the present rate cancels what still waits."""
        self._pending_baud = baud if baud != self.baud else 0

    def heard_host(self) -> None:
        """An intact frame came down: the rate on trial is good."""
        self._trial_ends_us = NEVER_US

    def tick(self, now_us: int, outputs: list[Output]) -> None:
        """Hand over what may go at this instant."""
        if now_us >= self._trial_ends_us:
            self._trial_ends_us = NEVER_US
            self._set_baud(self._baud_before, now_us, outputs)
        if self._pending_baud and self._queue.acks_empty and self._backlog(now_us) == 0:
            self._baud_before = self.baud
            self._set_baud(self._pending_baud, now_us, outputs)
            self._pending_baud = 0
            self._trial_ends_us = now_us + _TRIAL_US
        while length := self._queue.next_length(self._pending_baud != 0):
            backlog = self._backlog(now_us)
            if backlog and backlog + length > self._window:
                break
            frame = self._queue.take(self._pending_baud != 0)
            self._free = max(self._free, now_us * self.baud) + length * _BITS_US
            self.bytes_sent += length
            if frame[2] not in _SONAR_TYPES:
                self.other_bytes_sent += length
            outputs.append(Output(Sink.LINK, now_us, frame))

    def next_us(self) -> int:
        """When there is something to do next, unless something new comes."""
        length = self._queue.next_length(self._pending_baud != 0)
        if length:
            room = max(0, self._window - length)
            ready_us = -(-(self._free - room * _BITS_US) // self.baud)
        elif self._pending_baud:
            ready_us = -(-self._free // self.baud)
        else:
            ready_us = NEVER_US
        return min(ready_us, self._trial_ends_us)

    @property
    def _window(self) -> int:
        return _WINDOW_SLOW_BYTES if self.baud <= ROM_BAUD else _WINDOW_FAST_BYTES

    def _backlog(self, now_us: int) -> int:
        """Bytes handed over that are not out yet."""
        return max(0, -(-(self._free - now_us * self.baud) // _BITS_US))

    def _set_baud(self, baud: int, now_us: int, outputs: list[Output]) -> None:
        if baud < self.baud:
            self._queue.drop_sonar_data()  # packed for the fast line, its frames would hold SENSORS up
        self.baud = baud
        self._free = now_us * baud
        outputs.append(Output(Sink.LINK_BAUD, now_us, baud.to_bytes(4, "little")))
