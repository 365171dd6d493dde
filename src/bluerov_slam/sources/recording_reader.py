"""Reads what a dive received back: a session folder, its exported zip, one MCAP file, or a plain capture.

That is the raw link bytes, what the vehicle's own messages said and positions from outside; everything else is decoded
afresh from the bytes.

A file that was cut short reads up to its last whole chunk; what could not be read is named in `problems`.
"""

from __future__ import annotations

import io
import re
import struct
import zipfile
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import orjson
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from bluerov_slam.errors import RecordingError
from bluerov_slam.protocol.esp32_messages import KNOWN_TYPES, Esp32FrameDecoder
from bluerov_slam.records import AcousticBytes, GpsFix, LinkBytes, NavState, PositionFix, Record, VehicleRecord
from bluerov_slam.sources.recorded_json import (
    ACOUSTIC_RAW_TOPIC,
    GPS_TOPIC,
    NAVIGATION_TOPIC,
    POSITION_FIX_TOPIC,
    VEHICLE_TOPICS,
    read_datagram,
    read_record,
)

RAW_TOPIC = "/link/raw"
SESSION_METADATA = "bluerov_slam_session"
# Metadata "wall_clock" of a log that does not say when it was made.
UNKNOWN_CLOCK = "unknown"

# A plain capture has no arrival times: its bytes are given the pace of the link, in blocks of this length.
CAPTURE_BLOCK_S = 0.01
BITS_PER_BYTE = 10
_CAPTURE_PROBE_BYTES = 1024 * 1024

_PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_PART_NAME = re.compile(r"(?:.*/)?link_\d{3,}\.mcap")


# What stands beside the link bytes; a log that was imported brings GPS fixes, too, which else are decoded anew.
_BESIDE_LINK = (*VEHICLE_TOPICS, POSITION_FIX_TOPIC, ACOUSTIC_RAW_TOPIC)

Received = LinkBytes | AcousticBytes | VehicleRecord | PositionFix | GpsFix


@dataclass(frozen=True, slots=True)
class McapMessage:
    """One message of a recording. `publish_ns` is the host's monotonic clock, `log_ns` the wall clock."""

    topic: str
    publish_ns: int
    log_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Part:
    """One file of a recording, wherever it lies."""

    name: str
    open: Callable[[], BinaryIO]
    size: int


@dataclass(slots=True)
class Recording:
    """A recording that was found to be one.

    `wall_offset_ns` is wall clock less monotonic clock, None if unknown. `imported_from` names the logs a recording was
    made from, None for one of ours; an imported one holds no link bytes.
    """

    path: Path
    parts: tuple[Part, ...]
    is_capture: bool
    wall_offset_ns: int | None = None
    decoder_settings: dict[str, Any] = field(default_factory=dict)
    session: dict[str, Any] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    imported_from: str | None = None
    simulated: bool = False
    navigation_settings: dict[str, Any] = field(default_factory=dict)

    @property
    def utc_offset_s(self) -> float | None:
        """UTC less monotonic clock: by GPS where a fix dated the dive, else by the wall clock; None if unknown."""
        if self.wall_offset_ns is None:
            return None
        return self.wall_offset_ns * 1e-9 + (self.session.get("gps_utc_offset_s") or 0.0)

    def messages(self, topics: Collection[str]) -> Iterator[McapMessage]:
        """Every message of these topics, in the order of recording."""
        for part in self.parts:
            with part.open() as stream:
                yield from _messages(stream, part, frozenset(topics), self.problems)

    def blocks(self, baud: int = 115200) -> Iterator[LinkBytes]:
        """The link as it was read, block by block. `baud` paces a plain capture."""
        return (received for received in self._received(baud, (RAW_TOPIC,)) if isinstance(received, LinkBytes))

    def received(self, baud: int = 115200) -> Iterator[Received]:
        """The blocks and, between them, the records made of the vehicle's own messages and of positions given to us."""
        imported = (GPS_TOPIC,) if self.imported_from is not None else ()
        return self._received(baud, (RAW_TOPIC, *_BESIDE_LINK, *imported))

    def navigation(self) -> Iterator[NavState]:
        """The navigator's estimates of the time of recording."""
        for message in self.messages((NAVIGATION_TOPIC,)):
            state = self._read(message)
            if isinstance(state, NavState):
                yield state

    def _received(self, baud: int, topics: Collection[str]) -> Iterator[Received]:
        if self.is_capture:
            for part in self.parts:
                with part.open() as stream:
                    yield from _capture_blocks(stream, baud)
            return
        for message in self.messages(topics):
            if message.topic == RAW_TOPIC:
                yield LinkBytes(message.data, message.publish_ns / 1e9)
            elif message.topic == ACOUSTIC_RAW_TOPIC:
                if (datagram := read_datagram(message.data, message.publish_ns / 1e9)) is not None:
                    yield datagram
            else:
                record = self._read(message)
                if isinstance(record, Received):
                    yield record

    def _read(self, message: McapMessage) -> Record | None:
        record = read_record(message.topic, message.data)
        problem = f"messages of {message.topic} do not read; they were passed over"
        if record is None and problem not in self.problems:
            self.problems.append(problem)
        return record


def open_recording(path: Path) -> Recording:
    """Find out what `path` is. Raises RecordingError naming the cure."""
    try:
        parts, session = _find_parts(path)
        recording = Recording(path, parts, is_capture=False, session=session)
        if len(parts) == 1 and not _is_mcap(parts[0]):
            _check_capture(path, parts[0])
            recording.is_capture = True
        else:
            _read_metadata(recording)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except zipfile.BadZipFile as error:
        raise RecordingError(f"{path} is a damaged zip file: download the dive again") from error
    return recording


def _find_parts(path: Path) -> tuple[tuple[Part, ...], dict[str, Any]]:
    if path.is_dir():
        files = [file for file in sorted(path.glob("link_*.mcap")) if _PART_NAME.fullmatch(file.name)]
        parts = tuple(_file_part(file) for file in files if file.stat().st_size)
        if not parts:
            raise RecordingError(f"{path} holds no recording: expected a session folder with link_000.mcap")
        return parts, _session(path / "session.json")
    if path.suffix == ".jsonl":
        raise RecordingError(f"{path} is the text log and holds no link bytes: give the session folder it lies in")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path} is empty: nothing was recorded into it")
    if zipfile.is_zipfile(path):
        return _zip_parts(path)
    return (_file_part(path),), _session(path.parent / "session.json")


def _file_part(path: Path) -> Part:
    return Part(path.name, lambda: path.open("rb"), path.stat().st_size)


def _zip_parts(path: Path) -> tuple[tuple[Part, ...], dict[str, Any]]:
    with zipfile.ZipFile(path) as archive:
        infos = sorted((i for i in archive.infolist() if _PART_NAME.fullmatch(i.filename)), key=lambda i: i.filename)
        described = [name for name in archive.namelist() if name.split("/")[-1] == "session.json"]
        session = _parse_session(archive.read(described[0])) if described else {}
    parts = tuple(
        Part(info.filename, lambda name=info.filename: _open_zipped(path, name), info.file_size)  # type: ignore[misc]
        for info in infos
        if info.file_size
    )
    if not parts:
        raise RecordingError(f"{path} holds no recording: expected the zip of a whole dive with link_000.mcap")
    return parts, session


def _open_zipped(path: Path, name: str) -> BinaryIO:
    # The member keeps its archive open, and closes it with itself.
    member: BinaryIO = zipfile.ZipFile(path).open(name)  # type: ignore[assignment]  # noqa: SIM115
    return member


def _session(path: Path) -> dict[str, Any]:
    try:
        return _parse_session(path.read_bytes())
    except OSError:
        return {}


def _parse_session(data: bytes) -> dict[str, Any]:
    try:
        content = orjson.loads(data)
    except orjson.JSONDecodeError:
        return {}
    return content if isinstance(content, dict) else {}


def _is_mcap(part: Part) -> bool:
    with part.open() as stream:
        return stream.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def _check_capture(path: Path, part: Part) -> None:
    with part.open() as stream:
        frames = Esp32FrameDecoder().feed(stream.read(_CAPTURE_PROBE_BYTES))
    # An unknown type may have any length, so that noise passes for one now and then.
    if not any(frame_type in KNOWN_TYPES for frame_type, _ in frames):
        raise RecordingError(
            f"{path} is no recording: neither MCAP nor a capture of the ESP32's serial link (no frame of it inside)"
        )


def _read_metadata(recording: Recording) -> None:
    for part in recording.parts:
        with part.open() as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                continue
            metadata = _first_metadata(stream)
        if metadata is None:
            continue
        if metadata.get("wall_clock") != UNKNOWN_CLOCK:
            recording.wall_offset_ns = int(metadata["wall_offset_ns"])
        recording.navigation_settings = orjson.loads(metadata.get("navigation_settings", "{}"))
        recording.imported_from = metadata.get("imported_from")
        recording.simulated = metadata.get("simulated") == "true"
        recording.decoder_settings = orjson.loads(metadata.get("decoder_settings", "{}"))
        return


def _first_metadata(stream: BinaryIO) -> dict[str, str] | None:
    for opcode, data in _records(stream):
        if opcode == Opcode.METADATA:
            metadata = Metadata.read(ReadDataStream(io.BytesIO(data)))
            if metadata.name == SESSION_METADATA:
                return dict(metadata.metadata)
        elif opcode != Opcode.HEADER:
            return None
    return None


def _capture_blocks(stream: BinaryIO, baud: int) -> Iterator[LinkBytes]:
    size = max(1, round(baud / BITS_PER_BYTE * CAPTURE_BLOCK_S))
    done = 0
    while data := stream.read(size):
        done += len(data)
        yield LinkBytes(data, round(done * BITS_PER_BYTE * 1_000_000_000 / baud) / 1e9)


def _messages(stream: BinaryIO, part: Part, topics: frozenset[str], problems: list[str]) -> Iterator[McapMessage]:
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        problems.append(f"{part.name} is not an MCAP file; it was passed over")
        return
    channels: dict[int, str] = {}
    read = 0
    ended = False
    for opcode, data in _records(stream):
        if opcode == Opcode.CHUNK:
            try:
                content = _chunk_content(data)
            except Exception as error:  # a decompressor's own error types, by platform
                problems.append(f"{part.name} has a damaged chunk after {read} bytes; it was passed over ({error})")
                continue
            yield from _chunk_messages(content, channels, topics)
        elif opcode == Opcode.DATA_END:
            ended = True
            break
        read += _PREFIX.size + len(data)
    if not ended:
        problems.append(f"{part.name} was cut short; it was read up to its last whole chunk ({read} bytes)")


def _records(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Top-level records up to the first that is not whole."""
    while len(prefix := stream.read(_PREFIX.size)) == _PREFIX.size:
        opcode, length = _PREFIX.unpack(prefix)
        if opcode == 0 or length > 1 << 32:
            return
        data = stream.read(length)
        if len(data) < length:
            return
        yield opcode, data


def _chunk_content(data: bytes) -> bytes:
    chunk = Chunk.read(ReadDataStream(io.BytesIO(data)))
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(length)


def _chunk_messages(content: bytes, channels: dict[int, str], topics: frozenset[str]) -> Iterator[McapMessage]:
    offset = 0
    while offset < len(content):
        opcode, length = _PREFIX.unpack_from(content, offset)
        offset += _PREFIX.size
        if opcode == Opcode.MESSAGE:
            channel_id, _, log_ns, publish_ns = _MESSAGE.unpack_from(content, offset)
            topic = channels.get(channel_id)
            if topic is not None:
                yield McapMessage(topic, publish_ns, log_ns, content[offset + _MESSAGE.size : offset + length])
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(io.BytesIO(content[offset : offset + length])))
            if channel.topic in topics:
                channels[channel.id] = channel.topic
        offset += length
