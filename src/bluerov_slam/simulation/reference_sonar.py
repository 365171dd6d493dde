"""The reference board's side of one sonar's UART: frames out of bytes, pings out of frames.

`docs/firmware-core.md` section 2.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from bluerov_slam.protocol.checksums import kogger_mod255, kogger_mod256
from bluerov_slam.protocol.esp32_messages import KoggerRawFields, MessageType, pack_kogger_raw
from bluerov_slam.protocol.framing import FrameFormat, FrameScanner
from bluerov_slam.protocol.kogger_frame import FRAMES_TO_LEARN, KOGGER_SYNC, FrameType, KoggerId
from bluerov_slam.protocol.ping_assembly import MAX_PING_BYTES, ChartChunk
from bluerov_slam.records import Channel
from bluerov_slam.simulation.board import SONAR_BAUD
from bluerov_slam.simulation.board_readers.readings import NEVER_US

PING_SILENCE_US = 8_000
_HEADER_BYTES, _OVERHEAD_BYTES = 6, 8
_CHART_HEADER_BYTES = 6
_MAX_PING_RAW_BYTES, _MAX_PING_FRAMES = 8_192, 80
_T_US_BYTES = 4
_U32 = 0xFFFFFFFF


class KoggerFramer:
    """BB55 frames out of a sonar's bytes, each with the number of bytes that came behind its first one."""

    def __init__(self) -> None:
        self._scanner = FrameScanner(FrameFormat((KOGGER_SYNC,), _HEADER_BYTES, 4, self._total_bytes, self._intact))
        self._mod255 = False
        self._streak = 0
        self._candidate_behind = 0
        self._behind: list[int] = []

    @property
    def checksum_errors(self) -> int:
        """Candidates whose checks failed."""
        return self._scanner.counters.checksum_errors

    def feed(self, data: bytes) -> list[tuple[bytes, int]]:
        """Take the next bytes; the whole, intact frames they completed."""
        self._behind.clear()
        frames = self._scanner.feed(data)
        return list(zip(frames, self._behind, strict=True))

    def _total_bytes(self, buffer: bytes, start: int) -> int:
        self._candidate_behind = len(buffer) - start - 1
        return _OVERHEAD_BYTES + buffer[start + 5]

    def _intact(self, frame: bytes) -> bool:
        body, check = frame[2:-2], frame[-2:]
        used, other = (kogger_mod255, kogger_mod256) if self._mod255 else (kogger_mod256, kogger_mod255)
        if used(body) == check:
            self._streak = 0
            self._behind.append(self._candidate_behind)
            return True
        if other(body) == check:
            self._streak += 1
            if self._streak >= FRAMES_TO_LEARN:
                self._mod255 = not self._mod255
                self._streak = 0
        return False


@dataclass(slots=True)
class HeardPing:
    """Chart frames of one ping as they came in. `time_us`: when its first byte came."""

    time_us: int
    version: int
    mark: bool
    chunks: list[ChartChunk] = field(default_factory=list)
    frames: list[bytes] = field(default_factory=list)
    size: int = 0

    def ends_before(self, chunk: ChartChunk, version: int) -> bool:
        """Whether this chunk belongs to another ping."""
        last = self.chunks[-1]
        changed = (chunk.resolution_mm, chunk.first_sample) != (last.resolution_mm, last.first_sample)
        return changed or version != self.version or chunk.seq_offset < last.seq_offset + len(last.samples)

    def has_room(self, frame: bytes) -> bool:
        """Whether the ping may grow by this frame."""
        return len(self.frames) < _MAX_PING_FRAMES and self.size + len(frame) <= _MAX_PING_RAW_BYTES

    def add(self, chunk: ChartChunk, frame: bytes) -> None:
        """Take the next chunk."""
        self.chunks.append(chunk)
        self.frames.append(frame)
        self.size += len(frame)


class SonarPort:
    """One sonar's bytes as the board sees them."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.packets = 0
        self.bytes = 0
        self.rate_bytes_per_s: int | None = None
        """Of its pings; None until two have ended."""
        self._framer = KoggerFramer()
        self._open: HeardPing | None = None
        self._last_chunk_us = 0
        self._last_end_us: int | None = None

    @property
    def raw_type(self) -> MessageType:
        """The type that carries this sonar's frames untouched."""
        return MessageType.KOGGER_RAW_A if self.channel is Channel.A else MessageType.KOGGER_RAW_B

    @property
    def frame_errors(self) -> int:
        """BB55 candidates that failed their checks."""
        return self._framer.checksum_errors

    @property
    def silence_us(self) -> int:
        """When the open ping ends for want of chunks."""
        return self._last_chunk_us + PING_SILENCE_US if self._open else NEVER_US

    def feed(self, data: bytes, now_us: int) -> tuple[list[HeardPing], list[tuple[bytes, int]]]:
        """Take a batch; the pings that ended, and the other frames with the times of their first bytes."""
        self.bytes += len(data)
        ended: list[HeardPing] = []
        others: list[tuple[bytes, int]] = []
        for frame, behind in self._framer.feed(data):
            self.packets += 1
            time_us = max(0, now_us - behind * 10_000_000 // SONAR_BAUD)
            if not _is_chart(frame):
                others.append((frame, time_us))
            elif (chunk := _chunk(frame)) is not None:
                self._take(chunk, frame, time_us, now_us, ended)
        return ended, others

    def end_ping(self, now_us: int) -> HeardPing:
        """The open ping is over; there must be one."""
        ping, self._open = self._open, None
        assert ping is not None
        if self._last_end_us is not None and now_us > self._last_end_us:
            rate = ping.size * 1_000_000 // (now_us - self._last_end_us)
            if self.rate_bytes_per_s is None:
                self.rate_bytes_per_s = rate
            else:
                change = rate - self.rate_bytes_per_s
                self.rate_bytes_per_s += change // 5 if change >= 0 else -(-change // 5)
        self._last_end_us = now_us
        return ping

    def raw_payloads(self, frames: list[tuple[bytes, int]], limit: int) -> list[tuple[int, bytes]]:
        """Whole frames, as many to a payload as fit, each payload with the time of its first frame."""
        payloads: list[tuple[int, bytes]] = []
        batch, batch_us = b"", 0
        for frame, time_us in frames:
            if batch and _T_US_BYTES + len(batch) + len(frame) > limit:
                payloads.append((self.raw_type, pack_kogger_raw(KoggerRawFields(batch_us & _U32, batch))))
                batch = b""
            if not batch:
                batch_us = time_us
            batch += frame
        if batch:
            payloads.append((self.raw_type, pack_kogger_raw(KoggerRawFields(batch_us & _U32, batch))))
        return payloads

    def _take(self, chunk: ChartChunk, frame: bytes, time_us: int, now_us: int, ended: list[HeardPing]) -> None:
        version = _version(frame)
        if self._open is not None and (self._open.ends_before(chunk, version) or not self._open.has_room(frame)):
            ended.append(self.end_ping(now_us))
        if self._open is None:
            self._open = HeardPing(time_us, version, bool(frame[3] & 0x40))
        self._open.add(chunk, frame)
        self._last_chunk_us = now_us


def _version(frame: bytes) -> int:
    return frame[3] >> 3 & 7


def _is_chart(frame: bytes) -> bool:
    content = frame[3] & 0x83 == FrameType.CONTENT  # RESPONSE not set
    return content and frame[4] == KoggerId.CHART and _version(frame) <= 1


def _chunk(frame: bytes) -> ChartChunk | None:
    """What a chart frame says; None when it breaks a rule."""
    payload = frame[6:-2]
    if len(payload) <= _CHART_HEADER_BYTES:
        return None
    seq_offset, resolution_mm, first_sample = (int.from_bytes(payload[at : at + 2], "little") for at in (0, 2, 4))
    samples = payload[_CHART_HEADER_BYTES:]
    if not resolution_mm or seq_offset + len(samples) >= MAX_PING_BYTES:
        return None
    return ChartChunk(seq_offset, resolution_mm, first_sample, samples)
