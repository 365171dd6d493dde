"""One MCAP file of a dive: the raw link bytes first, the decoded records beside them.

publish_time is the host's monotonic clock, log_time the wall clock as it stood at the start of the session: one fixed
offset between the two, so that a step of the wall clock never reorders a recording. A chunk goes to the kernel at each
`flush`; a process that dies loses at most what came after the last one.
"""

from __future__ import annotations

import dataclasses
import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, IndexType, Writer

from bluerov_slam import __version__, records
from bluerov_slam.protocol.waterfall_frame import pack_ping
from bluerov_slam.sinks.append_file import AppendFile

_log = logging.getLogger(__name__)

RAW_TOPIC = "/link/raw"
RAW_DOWN_TOPIC = "/link/raw_down"
SESSION_METADATA = "bluerov_slam_session"
PING_ENCODING = "bluerov_slam_ping_v1"
ACOUSTIC_RAW_TOPIC = "/acoustics/raw"
DATAGRAM_ENCODING = "bluerov_slam_datagram_v1"

# Topic of each record type that is written as JSON. Sonar frames and acoustic records are rebuilt from the raw bytes.
JSON_TOPICS: dict[type, str] = {
    records.SensorSample: "/sensors",
    records.CtdSample: "/ctd",
    records.ImuBurst: "/imu",
    records.GpsFix: "/gps",
    records.DeviceStatus: "/device_status",
    records.CommandAck: "/command_ack",
    records.Event: "/event",
    records.VehicleAttitude: "/vehicle/attitude",
    records.VehicleServoOutput: "/vehicle/servo_output",
    records.VehicleBattery: "/vehicle/battery",
    records.VehicleMotionDelta: "/vehicle/motion_delta",
    records.VehicleDepth: "/vehicle/depth",
    records.VehicleRange: "/vehicle/range",
    records.PositionFix: "/position_fix",
    records.NavState: "/navigation",
    records.TimeDifferenceReading: "/acoustics/tdoa",
    records.AcousticMessage: "/acoustics/message",
    records.AcousticFix: "/acoustics/fix",
}
PING_TOPICS = {records.Channel.A: "/ping/a", records.Channel.B: "/ping/b"}

_JSON_OPTIONS = orjson.OPT_SERIALIZE_NUMPY
# A chunk normally closes at each flush; this only bounds memory should flushes fail to come.
_CHUNK_BYTES = 4 * 1024 * 1024


class McapLog:
    """Writes one MCAP file; every method but the constructor, `flush` and `finish` only fills memory."""

    def __init__(self, path: Path, wall_offset_ns: int, session: dict[str, str]) -> None:
        """Create `path` (it must not exist). `session` is kept as metadata. Raises OSError."""
        self.path = path
        self.not_encoded = 0
        self._wall_offset_ns = wall_offset_ns
        self._file = AppendFile(path)
        self._writer = Writer(
            self._file,  # type: ignore[arg-type]
            chunk_size=_CHUNK_BYTES,
            compression=_compression(),
            index_types=IndexType.ALL,
        )
        _keep_index_compact(self._writer)
        self._writer.start(library=f"bluerov-slam {__version__}")
        self._writer.add_metadata(SESSION_METADATA, session)
        self._channels: dict[object, int] = {}
        self._register_channels()

    @property
    def size(self) -> int:
        """Bytes handed to the kernel."""
        return self._file.size

    @property
    def is_deleted(self) -> bool:
        """Whether somebody deleted the file meanwhile."""
        return self._file.is_deleted

    def write_raw(self, data: bytes, mono_ns: int) -> None:
        """Link bytes as one read returned them."""
        self._add(self._channels[RAW_TOPIC], data, mono_ns)

    def write_raw_down(self, data: bytes, mono_ns: int) -> None:
        """A frame sent to the ESP32."""
        self._add(self._channels[RAW_DOWN_TOPIC], data, mono_ns)

    def write_datagram(self, datagram: records.AcousticBytes, mono_ns: int) -> None:
        """A datagram of an acoustic board, with its sender."""
        self._add(self._channels[ACOUSTIC_RAW_TOPIC], pack_datagram(datagram), mono_ns)

    def write_record(self, record: records.Record) -> None:
        """A decoded record; a type without a topic is passed over."""
        key = record.channel if isinstance(record, records.Ping) else type(record)
        channel = self._channels.get(key)
        if channel is None:
            return
        try:
            data = self._encode(record)
        except (TypeError, ValueError, struct.error):
            # Never at the cost of the raw bytes, from which it can be decoded again.
            self.not_encoded += 1
            if self.not_encoded == 1:
                _log.exception("a %s could not be recorded; the raw bytes are", type(record).__name__)
            return
        self._add(channel, data, to_ns(_stamp_s(record)))

    def write_message(self, topic: str, encoding: str, data: bytes, mono_ns: int) -> None:
        """A message of a topic that no dive has; the first one registers it."""
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, encoding, 0)
        self._add(self._channels[topic], data, mono_ns)

    def flush(self) -> None:
        """Close the chunk and hand it to the kernel, whole or not at all. Raises OSError."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def sync(self) -> None:
        """Have the kernel write to the disk. Raises OSError."""
        self._file.sync()

    def finish(self) -> None:
        """Write index and footer, then close. Raises OSError; the file is closed in any case."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.flush()
            self._file.sync()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close without a footer: the disk took no more."""
        self._file.close()

    def _encode(self, record: records.Record) -> bytes:
        if isinstance(record, records.Ping):
            return pack_ping(record, (to_ns(record.measured_s) + self._wall_offset_ns) * 1e-9)
        return encode_record(record)

    def _add(self, channel: int, data: bytes, mono_ns: int) -> None:
        self._writer.add_message(channel, max(0, mono_ns + self._wall_offset_ns), data, mono_ns)

    def _register_channels(self) -> None:
        for topic in (RAW_TOPIC, RAW_DOWN_TOPIC):
            self._channels[topic] = self._writer.register_channel(topic, "aa55", 0)
        self._channels[ACOUSTIC_RAW_TOPIC] = self._writer.register_channel(ACOUSTIC_RAW_TOPIC, DATAGRAM_ENCODING, 0)
        for channel, topic in PING_TOPICS.items():
            self._channels[channel] = self._writer.register_channel(topic, PING_ENCODING, 0)
        for record_type, topic in JSON_TOPICS.items():
            schema = orjson.dumps(json_schema(record_type))
            schema_id = self._writer.register_schema(f"bluerov_slam.{record_type.__name__}", "jsonschema", schema)
            self._channels[record_type] = self._writer.register_channel(topic, "json", schema_id)


def to_ns(seconds: float) -> int:
    """Seconds of the monotonic clock as the whole nanoseconds they were read as."""
    return max(0, round(seconds * 1e9))


def encode_record(record: object) -> bytes:
    """A record as JSON, its fields by their own names; None and NaN are null."""
    return orjson.dumps(record, _as_list, _JSON_OPTIONS)


def pack_datagram(datagram: records.AcousticBytes) -> bytes:
    """u8 length of the sender's name, the name, the datagram."""
    source = datagram.source.encode()[:255]
    return bytes((len(source),)) + source + datagram.data


def _as_list(value: object) -> object:
    """Arrays that are views with strides, which orjson does not take as they are, and bytes."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, bytes):
        return value.hex()
    raise TypeError(f"{type(value).__name__} has no JSON form")


def json_schema(record_type: type) -> dict[str, Any]:
    """JSON Schema of a record type, from its annotations."""
    fields = dataclasses.fields(record_type)
    return {
        "title": record_type.__name__,
        "type": "object",
        "properties": {field.name: _field_schema(str(field.type)) for field in fields},
        "required": [field.name for field in fields],
    }


def _field_schema(annotation: str) -> dict[str, Any]:
    options = [_type_name(part.strip()) for part in annotation.split("|")]
    return {"type": options[0] if len(options) == 1 else options}


class _PackedIndexes:
    """The chunk index as bytes: as objects, an hour of it costs the vehicle eight times the memory."""

    def __init__(self) -> None:
        self._packed = RecordBuilder()

    def append(self, index: ChunkIndex) -> None:
        index.write(self._packed)

    def __iter__(self) -> Iterator[_PackedIndexes]:
        yield self

    def write(self, builder: RecordBuilder) -> None:
        builder.write(self._packed.end())  # type: ignore[no-untyped-call]


def _keep_index_compact(writer: Writer) -> None:
    """The library has no public place for this; without the private one it keeps its list."""
    name = "_Writer__chunk_indices"
    if hasattr(writer, name):
        setattr(writer, name, _PackedIndexes())


def _type_name(annotation: str) -> str:
    simple = {
        "int": "integer", "bool": "boolean", "str": "string", "float": "number", "None": "null", "bytes": "string",
    }  # fmt: skip
    if annotation in simple:
        return simple[annotation]
    if annotation.startswith(("tuple[", "NDArray[")):
        return "array"
    return "string" if annotation in ("Channel", "EventLevel", "NavMode", "SensorTrust") else "integer"


def _stamp_s(record: records.Record) -> float:
    if isinstance(record, records.Event):
        return record.at_s
    stamp: float = record.arrived_s  # type: ignore[union-attr]
    return stamp


def _compression() -> CompressionType:
    """zstd where the platform has it: a dive shrinks to about a third."""
    try:
        import zstandard  # noqa: F401
    except ImportError:
        return CompressionType.NONE
    return CompressionType.ZSTD
