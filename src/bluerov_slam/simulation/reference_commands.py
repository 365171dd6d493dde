"""What the reference board does with bytes from the host: `docs/firmware-core.md` section 4."""

from __future__ import annotations

from typing import Protocol

from bluerov_slam.protocol.checksums import kogger_mod256
from bluerov_slam.protocol.esp32_messages import (
    Esp32FrameDecoder,
    MessageType,
    config_allowed,
    unpack_config,
    unpack_kogger_command,
    unpack_time_sync,
)
from bluerov_slam.protocol.kogger_frame import KOGGER_SYNC, FrameType, KoggerId
from bluerov_slam.records import AckResult, Channel

_ANSWER_PATIENCE_US = 300_000
_MAX_COMMANDS_PENDING = 8
_BB55_OVERHEAD = 8
_DOWNWARD = (
    MessageType.KOGGER_COMMAND_A,
    MessageType.KOGGER_COMMAND_B,
    MessageType.CONFIG,
    MessageType.TIME_SYNC,
)


class Commanded(Protocol):
    """What commands act on."""

    def acknowledge(self, acked_type: int, sequence: int, result: AckResult) -> None:
        """Queue a COMMAND_ACK."""

    def write_sonar(self, channel: Channel, frame: bytes) -> None:
        """Write a command to a sonar."""

    def configure(self, values: tuple[tuple[int, int], ...]) -> None:
        """Obey the pairs of a CONFIG, all of them allowed."""

    def send_status(self, echoed_host_us: int, echo_device_us: int) -> None:
        """Queue a STATUS now."""

    def heard_host(self) -> None:
        """An intact, known frame came down."""


class HostCommands:
    """Decodes, judges and passes on; counts what is bad."""

    def __init__(self) -> None:
        self.bad = 0
        self._decoder = Esp32FrameDecoder()
        self._pending_us: dict[Channel, list[int]] = {channel: [] for channel in Channel}

    def feed(self, data: bytes, now_us: int, board: Commanded) -> None:
        """Take a batch of the host's bytes."""
        before = self._decoder.counters
        for frame_type, payload in self._decoder.feed(data):
            if frame_type in _DOWNWARD:
                board.heard_host()
            self._obey(frame_type, payload, now_us, board)
        after = self._decoder.counters
        failed = after.checksum_errors + after.length_errors - before.checksum_errors - before.length_errors
        self.bad += failed or int(after.bytes_skipped > before.bytes_skipped)

    def answered(self, channel: Channel) -> None:
        """The sonar said something other than charts: no command waits any more."""
        self._pending_us[channel].clear()

    def _obey(self, frame_type: int, payload: bytes, now_us: int, board: Commanded) -> None:
        if frame_type in (MessageType.KOGGER_COMMAND_A, MessageType.KOGGER_COMMAND_B):
            self._relay(frame_type, payload, now_us, board)
        elif frame_type == MessageType.CONFIG:
            self._configure(payload, board)
        elif frame_type == MessageType.TIME_SYNC:
            sync = unpack_time_sync(payload)
            assert sync is not None
            board.send_status(sync.host_us, now_us)
        else:
            self.bad += 1
            if frame_type > MessageType.TIME_SYNC:
                board.acknowledge(frame_type, payload[0] if payload else 0, AckResult.UNKNOWN)

    def _relay(self, frame_type: int, payload: bytes, now_us: int, board: Commanded) -> None:
        command = unpack_kogger_command(frame_type, payload)
        assert command is not None
        result = self._judge(command.channel, command.frame, now_us)
        board.acknowledge(frame_type, command.sequence, result)
        if result is AckResult.OK:
            self._pending_us[command.channel].append(now_us)
            board.write_sonar(command.channel, command.frame)
        else:
            self.bad += 1

    def _judge(self, channel: Channel, frame: bytes, now_us: int) -> AckResult:
        if (
            frame[:2] != KOGGER_SYNC
            or len(frame) != _BB55_OVERHEAD + frame[5]
            or kogger_mod256(frame[2:-2]) != frame[-2:]
        ):
            return AckResult.BAD_INNER_CHECKSUM
        if frame[4] == KoggerId.UART and frame[3] & 3 == FrameType.SETTING:
            return AckResult.REJECTED  # another baud rate would cut the board off from its sonar
        waiting = [sent_us for sent_us in self._pending_us[channel] if now_us - sent_us < _ANSWER_PATIENCE_US]
        self._pending_us[channel] = waiting
        return AckResult.BUSY if len(waiting) >= _MAX_COMMANDS_PENDING else AckResult.OK

    def _configure(self, payload: bytes, board: Commanded) -> None:
        config = unpack_config(payload)
        assert config is not None
        if all(config_allowed(key, value) for key, value in config.pairs):
            board.acknowledge(MessageType.CONFIG, config.sequence, AckResult.OK)
            board.configure(config.pairs)
        else:
            self.bad += 1
            board.acknowledge(MessageType.CONFIG, config.sequence, AckResult.REJECTED)
