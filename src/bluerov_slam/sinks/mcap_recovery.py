"""Gives an MCAP file that was cut short (a kill, a power cut, a full disk) its index and footer back.

Nothing whole is lost: every complete chunk stays where it is, a chunk cut in half cannot be decoded by anything and
gives way to the footer. A longer tail that does not read is kept beside the file as `<name>.cut`.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

from bluerov_slam.errors import RecordingError

_PREFIX = struct.Struct("<BQ")
_FOOTER_BYTES = _PREFIX.size + 20
# A tail longer than one cut chunk of a few seconds is kept for inspection instead of being written over.
_KEPT_TAIL_BYTES = 256 * 1024


@dataclass(slots=True)
class McapContent:
    """What a scan found: counters, and everything the summary section needs."""

    whole_bytes: int = len(MCAP0_MAGIC)
    complete: bool = False
    start_ns: int | None = None
    end_ns: int | None = None
    messages_by_topic: dict[str, int] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata_indexes: list[MetadataIndex] = field(default_factory=list)
    last_chunk: Chunk | None = None


def is_complete(path: Path) -> bool:
    """True when the file ends with a footer. Raises OSError."""
    with path.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        if size < 2 * len(MCAP0_MAGIC) + _FOOTER_BYTES:
            return False
        stream.seek(size - len(MCAP0_MAGIC) - _FOOTER_BYTES)
        end = stream.read()
    return end[0] == Opcode.FOOTER and end.endswith(MCAP0_MAGIC)


def scan_mcap(path: Path) -> McapContent:
    """Walk a file from the start to its last whole record.

    Raises RecordingError when it is no MCAP file at all, OSError when it cannot be read.
    """
    content = McapContent()
    with path.open("rb") as stream:
        if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise RecordingError(f"{path} is not an MCAP file")
        for opcode, offset, data in _whole_records(stream, path.stat().st_size):
            if opcode == Opcode.DATA_END:
                content.complete = is_complete(path)
                break
            if not _take(content, opcode, offset, data):
                break
            content.whole_bytes = offset + _PREFIX.size + len(data)
    content.messages_by_topic = {
        content.channels[channel].topic: count
        for channel, count in sorted(content.counts.items())
        if channel in content.channels
    }
    return content


def recover_mcap(path: Path) -> McapContent:
    """Rebuild index and footer of a cut file in place; a complete file is only scanned.

    Raises RecordingError when it is no MCAP file, OSError when it cannot be read or written.
    """
    content = scan_mcap(path)
    if content.complete:
        return content
    with path.open("r+b") as stream:
        _keep_tail(stream, path, content.whole_bytes)
        stream.truncate(content.whole_bytes)
        stream.seek(content.whole_bytes)
        stream.write(_last_message_indexes(content))
        stream.write(_summary(content, stream.tell()))
        stream.flush()
        os.fsync(stream.fileno())
    content.complete = True
    return content


def _whole_records(stream: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
    offset = stream.tell()
    while True:
        prefix = stream.read(_PREFIX.size)
        if len(prefix) < _PREFIX.size:
            return
        opcode, length = _PREFIX.unpack(prefix)
        if opcode == 0 or offset + _PREFIX.size + length > size:
            return
        yield opcode, offset, stream.read(length)
        offset += _PREFIX.size + length


def _take(content: McapContent, opcode: int, offset: int, data: bytes) -> bool:
    """Note one top-level record; False when it does not read and the file is to be cut before it."""
    stream = ReadDataStream(BytesIO(data))
    try:
        if opcode == Opcode.CHUNK:
            return _take_chunk(content, Chunk.read(stream), offset, _PREFIX.size + len(data))
        if opcode == Opcode.MESSAGE_INDEX:
            _take_message_index(content, MessageIndex.read(stream), offset, _PREFIX.size + len(data))
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            content.metadata[metadata.name] = metadata.metadata
            index = MetadataIndex(offset=offset, length=_PREFIX.size + len(data), name=metadata.name)
            content.metadata_indexes.append(index)
    except (McapError, struct.error, ValueError):
        return False
    return True


def _take_chunk(content: McapContent, chunk: Chunk, offset: int, length: int) -> bool:
    try:
        records = breakup_chunk(chunk, validate_crc=True)
    except Exception:  # a decompressor's own error types, by platform
        return False
    for record in records:
        if isinstance(record, Schema):
            content.schemas[record.id] = record
        elif isinstance(record, Channel):
            content.channels[record.id] = record
        elif isinstance(record, Message):
            content.counts[record.channel_id] = content.counts.get(record.channel_id, 0) + 1
    start, end = chunk.message_start_time, chunk.message_end_time
    content.start_ns = start if content.start_ns is None else min(start, content.start_ns)
    content.end_ns = end if content.end_ns is None else max(end, content.end_ns)
    content.chunks.append(
        ChunkIndex(
            message_start_time=start,
            message_end_time=end,
            chunk_start_offset=offset,
            chunk_length=length,
            message_index_offsets={},
            message_index_length=0,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
    )
    content.last_chunk = chunk
    return True


def _take_message_index(content: McapContent, index: MessageIndex, offset: int, length: int) -> None:
    chunk = content.chunks[-1]
    chunk.message_index_offsets[index.channel_id] = offset
    chunk.message_index_length += length


def _last_message_indexes(content: McapContent) -> bytes:
    """The message indexes of the last chunk that the cut took away: without them no reader seeks into it."""
    if content.last_chunk is None:
        return b""
    index = content.chunks[-1]
    builder = RecordBuilder()
    for message_index in _message_indexes(content.last_chunk):
        if message_index.channel_id not in index.message_index_offsets:
            index.message_index_offsets[message_index.channel_id] = content.whole_bytes + builder.count
            message_index.write(builder)
    added = _bytes(builder)
    index.message_index_length += len(added)
    return added


def _message_indexes(chunk: Chunk) -> list[MessageIndex]:
    indexes: dict[int, MessageIndex] = {}
    offset = 0
    for record in breakup_chunk(chunk):
        builder = RecordBuilder()
        record.write(builder)
        if isinstance(record, Message):
            index = indexes.setdefault(record.channel_id, MessageIndex(channel_id=record.channel_id, records=[]))
            index.records.append((record.log_time, offset))
        offset += builder.count
    return list(indexes.values())


def _summary(content: McapContent, start: int) -> bytes:
    """Everything from DataEnd to the closing magic, for a data section that ends at `start`."""
    builder = RecordBuilder()
    DataEnd(data_section_crc=0).write(builder)
    summary_start = start + builder.count
    summary = RecordBuilder()
    offsets = []
    groups = (
        (Opcode.SCHEMA, list(content.schemas.values())),
        (Opcode.CHANNEL, list(content.channels.values())),
        (Opcode.STATISTICS, [_statistics(content)]),
        (Opcode.CHUNK_INDEX, content.chunks),
        (Opcode.METADATA_INDEX, content.metadata_indexes),
    )
    for opcode, records in groups:
        group_start = summary.count
        for record in records:
            record.write(summary)
        offsets.append(SummaryOffset(opcode, summary_start + group_start, summary.count - group_start))
    offset_start = summary_start + summary.count
    for offset in offsets:
        if offset.group_length:
            offset.write(summary)
    summary_bytes = _bytes(summary)
    crc = zlib.crc32(summary_bytes)
    crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offset_start), crc)
    data_end = _bytes(builder)
    footer = RecordBuilder()
    Footer(summary_start=summary_start, summary_offset_start=offset_start, summary_crc=crc).write(footer)
    return data_end + summary_bytes + _bytes(footer) + MCAP0_MAGIC


def _bytes(builder: RecordBuilder) -> bytes:
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _statistics(content: McapContent) -> Statistics:
    return Statistics(
        attachment_count=0,
        channel_count=len(content.channels),
        channel_message_counts=dict(content.counts),
        chunk_count=len(content.chunks),
        message_count=sum(content.counts.values()),
        metadata_count=len(content.metadata_indexes),
        message_start_time=content.start_ns or 0,
        message_end_time=content.end_ns or 0,
        schema_count=len(content.schemas),
    )


def _keep_tail(stream: BinaryIO, path: Path, start: int) -> None:
    stream.seek(start)
    tail = stream.read(_KEPT_TAIL_BYTES + 1)
    if len(tail) <= _KEPT_TAIL_BYTES:
        return
    with path.with_name(path.name + ".cut").open("wb") as kept:
        while tail:
            kept.write(tail)
            tail = stream.read(1024 * 1024)
