"""The board's side of one sonar UART: frames into whole pings, pings into AA55 payloads, everything else untouched."""

from __future__ import annotations

from dataclasses import dataclass, field

from bluerov_slam.protocol.esp32_messages import KoggerRawFields, MessageType, pack_kogger_raw
from bluerov_slam.protocol.kogger_bundle import Coding, compress_ping
from bluerov_slam.protocol.kogger_frame import KoggerFrameDecoder
from bluerov_slam.protocol.ping_assembly import ChartChunk, chart_chunk
from bluerov_slam.records import Channel

_T_US_BYTES = 4
_RATE_SMOOTHING = 0.2


@dataclass(slots=True)
class HeardPing:
    """Chart frames of one ping as they come in."""

    t_us: int
    version: int
    mark: bool
    chunks: list[ChartChunk] = field(default_factory=list)
    frames: list[bytes] = field(default_factory=list)

    @property
    def filled(self) -> int:
        """Where the next chunk belongs."""
        last = self.chunks[-1]
        return last.seq_offset + len(last.samples)


class SonarPort:
    """Parses one sonar's bytes the way the firmware does."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.packets = 0
        self.bytes = 0
        self.pings_dropped = 0
        self.overflow_bytes = 0
        self.raw_bytes_per_s = 0.0
        self._decoder = KoggerFrameDecoder("auto")
        self._open: HeardPing | None = None
        self._last_chunk_s = 0.0
        self._last_ping_s: float | None = None
        self._number = 0

    @property
    def frame_errors(self) -> int:
        """BB55 frames that failed their check."""
        return self._decoder.counters.checksum_errors

    @property
    def command_type(self) -> MessageType:
        """The AA55 type that carries this sonar's raw frames."""
        return MessageType.KOGGER_RAW_A if self.channel is Channel.A else MessageType.KOGGER_RAW_B

    def feed(self, data: bytes, now_s: float, t_us: int) -> tuple[list[HeardPing], list[bytes]]:
        """Take bytes; returns the pings that ended, and the frames that are no echogram."""
        self.bytes += len(data)
        ended: list[HeardPing] = []
        others: list[bytes] = []
        for frame in self._decoder.feed(data):
            self.packets += 1
            chunk = chart_chunk(frame)
            if chunk is None:
                others.append(frame.raw)
                continue
            if self._open is not None and _starts_new_ping(self._open, chunk, frame.version):
                ended.append(self._close(now_s))
            if self._open is None:
                self._open = HeardPing(t_us, frame.version, frame.mark)
            self._open.chunks.append(chunk)
            self._open.frames.append(frame.raw)
            self._last_chunk_s = now_s
        return ended, others

    def close_after_silence(self, now_s: float, silence_s: float) -> list[HeardPing]:
        """The ping that ended because its sonar has nothing more to say, if any."""
        if self._open is None or now_s - self._last_chunk_s < silence_s - 1.0e-6:
            return []
        return [self._close(now_s)]

    def compressed(self, ping: HeardPing, decimation: int, coding: Coding, limit: int) -> list[tuple[int, bytes]]:
        """The ping as KOGGER_COMPRESSED payloads."""
        self._number += 1
        payloads = compress_ping(
            self.channel,
            ping.chunks,
            ping_number=self._number & 0xFF,
            t_us=ping.t_us,
            version=ping.version,
            mark=ping.mark,
            decimation=decimation,
            coding=coding,
            payload_limit=limit,
        )
        return [(MessageType.KOGGER_COMPRESSED, payload) for payload in payloads]

    def raw(self, frames: list[bytes], t_us: int, limit: int) -> list[tuple[int, bytes]]:
        """Whole BB55 frames as KOGGER_RAW payloads, as many to a payload as fit."""
        payloads: list[tuple[int, bytes]] = []
        batch = b""
        for frame in frames:
            if batch and _T_US_BYTES + len(batch) + len(frame) > limit:
                payloads.append((self.command_type, pack_kogger_raw(KoggerRawFields(t_us, batch))))
                batch = b""
            batch += frame
        if batch:
            payloads.append((self.command_type, pack_kogger_raw(KoggerRawFields(t_us, batch))))
        return payloads

    def _close(self, now_s: float) -> HeardPing:
        ping, self._open = self._open, None
        assert ping is not None
        if self._last_ping_s is not None and now_s > self._last_ping_s:
            rate = sum(map(len, ping.frames)) / (now_s - self._last_ping_s)
            weight = _RATE_SMOOTHING if self.raw_bytes_per_s else 1.0
            self.raw_bytes_per_s += weight * (rate - self.raw_bytes_per_s)
        self._last_ping_s = now_s
        return ping


def _starts_new_ping(ping: HeardPing, chunk: ChartChunk, version: int) -> bool:
    last = ping.chunks[-1]
    changed = (chunk.resolution_mm, chunk.first_sample) != (last.resolution_mm, last.first_sample)
    return changed or chunk.seq_offset < ping.filled or version != ping.version
