"""The acoustic board's frames to records: from the serial link, or by UDP from boards of their own."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from bluerov_slam.clock import DeviceClock
from bluerov_slam.protocol.acoustic_messages import (
    acoustic_message,
    time_difference_reading,
    unpack_message,
    unpack_record_chunk,
    unpack_tdoa,
)
from bluerov_slam.protocol.acoustic_record_assembly import AssemblyCounters, RecordAssembler
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType

if TYPE_CHECKING:
    from collections.abc import Callable

    from bluerov_slam.records import Record

# One array is fitted; a second board may be on trial. More senders than this are somebody's mistake.
MOST_SOURCES: Final = 4
# A source that was silent for so long makes room for another one.
FORGOTTEN_AFTER_S: Final = 30.0


class AcousticFrames:
    """One sender's acoustic frames, on its clock."""

    def __init__(self, clock: DeviceClock) -> None:
        self._clock = clock
        self._assembler = RecordAssembler()
        self.handlers: dict[int, Callable[[bytes, float, list[Record]], bool]] = {
            MessageType.ACOUSTIC_TDOA.value: self._on_time_differences,
            MessageType.ACOUSTIC_RECORD.value: self._on_record,
            MessageType.ACOUSTIC_MESSAGE.value: self._on_message,
        }

    @property
    def counters(self) -> AssemblyCounters:
        """Of the records that were put together."""
        return self._assembler.counters

    def expire(self, now_s: float, records: list[Record]) -> None:
        """A record whose end is overdue."""
        records += self._assembler.expire(now_s)

    def finish(self, records: list[Record]) -> None:
        """The stream has ended."""
        records += self._assembler.finish()

    # Each handler returns False when the frame's content does not add up.

    def _on_time_differences(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_tdoa(payload)
        if fields is None:
            return False
        records.append(time_difference_reading(fields, self._clock.map_us32(fields.t_us, arrived_s), arrived_s))
        return True

    def _on_record(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        chunk = unpack_record_chunk(payload)
        if chunk is None:
            return False
        kind = MessageType.ACOUSTIC_RECORD
        records += self._assembler.feed(chunk, lambda t_us: self._clock.map_late_us32(kind, t_us, arrived_s), arrived_s)
        return True

    def _on_message(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_message(payload)
        if fields is None:
            return False
        measured_s = self._clock.map_late_us32(MessageType.ACOUSTIC_MESSAGE, fields.t_us, arrived_s)
        records.append(acoustic_message(fields, measured_s, arrived_s))
        return True


@dataclass(slots=True)
class AcousticInputCounters:
    """Since the input was made. `refused`: frames of other types, which have no business on this port, by type."""

    frames: Counter[int] = field(default_factory=Counter)
    refused: Counter[int] = field(default_factory=Counter)
    malformed: Counter[int] = field(default_factory=Counter)
    checksum_errors: int = 0
    crowded_out: int = 0


class AcousticInput:
    """Datagrams of acoustic boards to records, every sender with a clock of its own.

    The same (data, source, arrived_s) always give the same records. Only the three acoustic types pass: nothing that
    comes by UDP can pose as the vehicle's sensors.
    """

    def __init__(self) -> None:
        self.counters = AcousticInputCounters()
        self._sources: dict[str, _Source] = {}

    @property
    def sources(self) -> tuple[str, ...]:
        """Who has been heard and is not forgotten."""
        return tuple(self._sources)

    def records_counters(self) -> AssemblyCounters:
        """Of all senders that are not forgotten."""
        each = [source.frames.counters for source in self._sources.values()]
        names = AssemblyCounters.__dataclass_fields__
        return AssemblyCounters(**{name: sum(getattr(counters, name) for counters in each) for name in names})

    def feed(self, data: bytes, name: str, arrived_s: float) -> list[Record]:
        """Take one datagram; returns the records that it completes."""
        records = self.flush(arrived_s)
        source = self._source(name, arrived_s, records)
        if source is None:
            self.counters.crowded_out += 1
            return records
        errors = source.decoder.counters.checksum_errors
        # A frame never reaches into the next datagram: what is cut off there is given up at once.
        found = source.decoder.feed(data) + source.decoder.flush()
        self.counters.checksum_errors += source.decoder.counters.checksum_errors - errors
        for frame_type, payload in found:
            handler = source.frames.handlers.get(frame_type)
            if handler is None:
                self.counters.refused[frame_type] += 1
                continue
            self.counters.frames[frame_type] += 1
            if not handler(payload, arrived_s, records):
                self.counters.malformed[frame_type] += 1
        return records

    def flush(self, now_s: float) -> list[Record]:
        """Records whose end is overdue at `now_s`."""
        records: list[Record] = []
        for source in self._sources.values():
            source.frames.expire(now_s, records)
        return records

    def finish(self) -> list[Record]:
        """Nothing more will come."""
        records: list[Record] = []
        for source in self._sources.values():
            source.frames.finish(records)
        return records

    def _source(self, name: str, arrived_s: float, records: list[Record]) -> _Source | None:
        source = self._sources.get(name)
        if source is None:
            if len(self._sources) >= MOST_SOURCES and not self._forget_one(arrived_s, records):
                return None
            source = self._sources[name] = _Source()
        source.heard_s = arrived_s
        return source

    def _forget_one(self, now_s: float, records: list[Record]) -> bool:
        name = min(self._sources, key=lambda name: self._sources[name].heard_s)
        if now_s - self._sources[name].heard_s < FORGOTTEN_AFTER_S:
            return False
        self._sources.pop(name).frames.finish(records)
        return True


class _Source:
    def __init__(self) -> None:
        self.decoder = Esp32FrameDecoder()
        self.frames = AcousticFrames(DeviceClock())
        self.heard_s = 0.0
