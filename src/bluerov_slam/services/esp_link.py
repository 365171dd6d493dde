"""The link to the ESP32: bytes up become records on the hub, commands go down and are acknowledged."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, Protocol

from bluerov_slam.pipeline.health import LinkFacts, PortState
from bluerov_slam.pipeline.link_counters import LinkDecoderCounters
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import (
    ConfigKey,
    MessageType,
    encode_config,
    encode_kogger_command,
    encode_time_sync,
)
from bluerov_slam.protocol.kogger import CommandDecision, KoggerFrameDecoder, classify_command
from bluerov_slam.records import (
    AckResult,
    Channel,
    CommandAck,
    DeviceStatus,
    LinkBytes,
    LinkBytesSent,
    Record,
)
from bluerov_slam.services.channel_swap import other, swapped, swapped_counters
from bluerov_slam.services.frame_watch import FrameWatch
from bluerov_slam.services.hub import Hub

_log = logging.getLogger(__name__)

ACK_TIMEOUT_S: Final = 0.5
TIME_SYNC_PERIOD_S: Final = 10.0
# Firmware that does not answer so many is too old to know TIME_SYNC; it gets none until it restarts or reconnects.
TIME_SYNC_TRIES: Final = 3
# Blocks that may wait to be decoded together; a ping with an IMU burst before it is three.
HELD_BLOCKS: Final = 4
SLOW_BAUD: Final = 115_200

OnData = Callable[[bytes, float], int]


class LinkSource(Protocol):
    """A serial port or a replay (docs/interfaces.md section 1)."""

    @property
    def kind(self) -> str: ...
    def now_s(self) -> float: ...
    def start(self, on_data: OnData, on_change: Callable[[], None]) -> None: ...
    async def stop(self) -> None: ...
    def send(self, frame: bytes, /) -> bool: ...
    def facts(self) -> LinkFacts: ...


class CommandOutcome(StrEnum):
    """What became of a frame sent down."""

    OK = "ok"
    BUSY = "busy"
    REJECTED = "rejected"
    UNKNOWN = "unknown"
    BAD_CHECKSUM = "bad_checksum"
    TIMEOUT = "timeout"
    NO_LINK = "no_link"


_OUTCOMES: Final = {
    AckResult.OK: CommandOutcome.OK,
    AckResult.BAD_INNER_CHECKSUM: CommandOutcome.BAD_CHECKSUM,
    AckResult.UNKNOWN: CommandOutcome.UNKNOWN,
    AckResult.REJECTED: CommandOutcome.REJECTED,
    AckResult.BUSY: CommandOutcome.BUSY,
}
_EXPLANATIONS: Final = {
    CommandOutcome.OK: "done",
    CommandOutcome.BUSY: "another command is under way; try again in a moment",
    CommandOutcome.REJECTED: "the ESP32 refused it",
    CommandOutcome.UNKNOWN: "the ESP32's firmware does not know this command; flash the newest firmware",
    CommandOutcome.BAD_CHECKSUM: "the ESP32 received it damaged; try again",
    CommandOutcome.TIMEOUT: "the ESP32 did not acknowledge within 0.5 s; old firmware takes no commands",
    CommandOutcome.NO_LINK: "there is no link to the ESP32; the Link chip says what is missing",
}


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Outcome and a sentence for the user."""

    outcome: CommandOutcome
    message: str


class EspLink:
    """Joins a source, the decoder and the hub. `swap` exchanges the sonars in both directions."""

    def __init__(
        self,
        source: LinkSource,
        decoder: LinkDecoder,
        hub: Hub,
        *,
        swap: bool = False,
        ack_timeout_s: float = ACK_TIMEOUT_S,
    ) -> None:
        self.source = source
        self.swap = swap
        self._decoder = decoder
        self._hub = hub
        self._ack_timeout_s = ack_timeout_s
        self._sequence = itertools.cycle(range(256))
        self._waiting: dict[tuple[int, int], asyncio.Future[AckResult]] = {}
        self._under_way: set[int] = set()
        self._on_change: Callable[[], None] = lambda: None
        self._connected = False
        self._sync_tries = 0
        self._sync_sent_us = 0
        self._sync_due_s = 0.0
        # Blocks of a replay are decoded as they come: nobody is woken for them.
        self._holds = source.kind == "serial"
        self._watch = FrameWatch()
        self._held: list[tuple[bytes, float]] = []
        hub.subscribe(self._on_ack, CommandAck, name="command acknowledgements")
        hub.subscribe(self._on_status, DeviceStatus, name="time synchronisation")

    @property
    def counters(self) -> LinkDecoderCounters:
        """The decoder's counts, the sonars as they are shown."""
        counters = self._decoder.counters
        return replace(counters, sonars=swapped_counters(counters.sonars)) if self.swap else counters

    @property
    def decoder(self) -> LinkDecoder:
        """For clock and activity facts."""
        return self._decoder

    def alive(self, channel: Channel) -> bool:
        """Whether a sonar's packet counter advanced within the last 2 s."""
        return self._decoder.activity.alive(other(channel) if self.swap else channel)

    def start(self, on_change: Callable[[], None]) -> None:
        """Begin; `on_change` is called when the source's state changes."""
        self._on_change = on_change
        self.source.start(self._on_data, self._on_source_change)

    async def stop(self) -> None:
        """End the source and give every waiting command up."""
        await self.source.stop()
        for waiting in self._waiting.values():
            waiting.cancel()
        self._decode_held()
        self._publish_all(self._decoder.finish())

    def tick(self, now_s: float) -> None:
        """Once a second: pings that are overdue, and a TIME_SYNC when one is due."""
        self._publish_all(self._decoder.flush(now_s))
        if self._connected and now_s >= self._sync_due_s and self._sync_tries < TIME_SYNC_TRIES:
            self._sync_due_s = now_s + TIME_SYNC_PERIOD_S
            self._sync_tries += 1
            self._sync_sent_us = int(self.source.now_s() * 1e6)
            self._send(encode_time_sync(next(self._sequence), self._sync_sent_us))

    async def command(self, channel: Channel, frame: bytes) -> CommandResult:
        """Send one BB55 frame to a sonar and wait for the ESP32's word on it; one at a time for each sonar."""
        parsed = KoggerFrameDecoder("mod256").feed(frame)
        if len(parsed) != 1 or parsed[0].raw != frame:
            return CommandResult(CommandOutcome.BAD_CHECKSUM, "this is not one whole Kogger frame")
        rule = classify_command(parsed[0])
        if rule.decision is CommandDecision.REFUSE:
            return CommandResult(CommandOutcome.REJECTED, rule.reason)
        wired = other(channel) if self.swap else channel
        message = MessageType.KOGGER_COMMAND_A if wired is Channel.A else MessageType.KOGGER_COMMAND_B
        return await self._ask(message, lambda sequence: encode_kogger_command(wired, sequence, frame))

    async def configure(self, values: Mapping[ConfigKey, int]) -> CommandResult:
        """Set rates or decimation of the ESP32."""
        return await self._ask(MessageType.CONFIG, lambda sequence: encode_config(sequence, values))

    async def _ask(self, message: MessageType, encode: Callable[[int], bytes]) -> CommandResult:
        if message in self._under_way:
            return _result(CommandOutcome.BUSY)
        sequence = next(self._sequence)
        key = (int(message), sequence)
        answer: asyncio.Future[AckResult] = asyncio.get_running_loop().create_future()
        self._waiting[key] = answer
        self._under_way.add(message)
        try:
            if not self._send(encode(sequence)):
                return _result(CommandOutcome.NO_LINK)
            # What came counts, also when this process was held up and finds answer and deadline in the same moment.
            await asyncio.wait((answer,), timeout=self._ack_timeout_s)
            return _result(_OUTCOMES[answer.result()] if answer.done() else CommandOutcome.TIMEOUT)
        finally:
            self._under_way.discard(message)
            self._waiting.pop(key, None)

    def _send(self, frame: bytes) -> bool:
        if not self.source.send(frame):
            return False
        self._hub.publish(LinkBytesSent(frame, self.source.now_s()))
        return True

    def _on_data(self, data: bytes, arrived_s: float) -> int:
        """Bytes of one read; none when the source paused for more and nothing came."""
        if data and self._holds and len(self._held) < HELD_BLOCKS:
            wait = self._watch.bytes_to_wait(data, arrived_s)
            if wait:
                self._held.append((data, arrived_s))
                return wait
        self._decode_held()
        return self._decode(data, arrived_s) if data else 0

    def _decode_held(self) -> None:
        held, self._held = self._held, []
        for data, arrived_s in held:
            self._decode(data, arrived_s)

    def _decode(self, data: bytes, arrived_s: float) -> int:
        self._hub.publish(LinkBytes(data, arrived_s))
        self._publish_all(self._decoder.feed(data, arrived_s))
        wanted = self._decoder.bytes_wanted
        return self._watch.decoded(data, wanted, arrived_s) if self._holds else wanted

    def _publish_all(self, records: list[Record]) -> None:
        publish = self._hub.publish
        if self.swap:
            for record in records:
                publish(swapped(record))
        else:
            for record in records:
                publish(record)

    def _on_source_change(self) -> None:
        facts = self.source.facts()
        connected = facts.state is PortState.CONNECTED
        # On a fast line a frame takes no time worth sleeping through.
        self._watch.bytes_per_s = SLOW_BAUD / 10 if facts.baud <= SLOW_BAUD else None
        if connected and not self._connected:
            self._sync_tries, self._sync_due_s = 0, 0.0
        elif not connected:
            self._decode_held()  # nothing comes that it could wait for
        self._connected = connected
        self._on_change()

    def _on_ack(self, ack: CommandAck) -> None:
        waiting = self._waiting.get((ack.acked_type, ack.sequence))
        if waiting is not None and not waiting.done():
            waiting.set_result(ack.result)

    def _on_status(self, status: DeviceStatus) -> None:
        # Firmware that sends STATUS knows TIME_SYNC; the tries count only what it leaves unanswered.
        if status.echoed_host_us == self._sync_sent_us or self._sync_tries >= TIME_SYNC_TRIES:
            self._sync_tries = 0


def _result(outcome: CommandOutcome) -> CommandResult:
    return CommandResult(outcome, _EXPLANATIONS[outcome])
