"""One sonar of the link: its raw or compressed frames in, forwardable BB55 frames and whole pings out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.pipeline.link_counters import SonarCounters
from bluerov_slam.protocol.kogger_bundle import Coding
from bluerov_slam.protocol.kogger_frame import KoggerFrameDecoder
from bluerov_slam.protocol.ping_assembly import PingAssembler
from bluerov_slam.records import Ping, SonarFrames

if TYPE_CHECKING:
    from bluerov_slam.protocol.even_bundle import EvenBundle
    from bluerov_slam.protocol.kogger_bundle import Bundle
    from bluerov_slam.protocol.kogger_frame import ChecksumChoice
    from bluerov_slam.records import Channel, Record

_CODING_NAMES = {Coding.MEAN: "mean", Coding.PEAK: "peak", Coding.CODED: "coded"}


class SonarChannel:
    """State of one sonar: its checksum, its open ping, its counts."""

    def __init__(self, channel: Channel, checksum: ChecksumChoice, expected_samples: int | None) -> None:
        self.channel = channel
        self._decoder = KoggerFrameDecoder(checksum)
        self._assembler = PingAssembler(channel, expected_samples)
        self._bytes = 0
        self._bundled_frames = 0
        self._coding: str | None = None
        self._last_ping: Ping | None = None

    @property
    def counters(self) -> SonarCounters:
        """A snapshot of the counts."""
        frames, assembly, ping = self._decoder.counters, self._assembler.counters, self._last_ping
        return SonarCounters(
            bytes=self._bytes,
            frames=frames.frames_ok + self._bundled_frames,
            checksum_errors=frames.checksum_errors,
            pings=assembly.pings,
            pings_incomplete=assembly.incomplete,
            pings_missed=assembly.pings_missed,
            gap_samples=assembly.gap_samples,
            chunks_rejected=assembly.oversize_chunks + assembly.unsupported,
            samples=None if ping is None else len(ping.samples),
            first_sample=None if ping is None else ping.first_sample,
            resolution_m=None if ping is None else ping.resolution_m,
            coding=self._coding,
            checksum_in_use=self._decoder.checksum_in_use,
            last_ping_arrived_s=None if ping is None else ping.arrived_s,
        )

    def feed_raw(self, data: bytes, measured_s: float, arrived_s: float, records: list[Record]) -> None:
        """Bytes of the sonar as it sent them; appends what they complete."""
        self._bytes += len(data)
        self._coding = "raw"
        frames = self._decoder.feed(data)
        if not frames:
            return
        forwardable = tuple([frame.to_bytes() for frame in frames])
        records.append(SonarFrames(self.channel, measured_s, arrived_s, forwardable, None))
        for frame in frames:
            self._keep(self._assembler.feed(frame, measured_s, arrived_s), records)

    def feed_bundle(
        self,
        bundle: Bundle | EvenBundle,
        payload_bytes: int,
        measured_s: float,
        arrived_s: float,
        records: list[Record],
    ) -> None:
        """One expanded KOGGER_COMPRESSED payload; appends its frames and what it completes."""
        self._bytes += payload_bytes
        self._bundled_frames += len(bundle.frames)
        self._coding = _CODING_NAMES[bundle.coding]
        records.append(SonarFrames(self.channel, measured_s, arrived_s, bundle.frames, bundle.last_of_ping))
        pings = self._assembler.feed_chunks(
            bundle.chunks,
            measured_s,
            arrived_s,
            version=bundle.version,
            decimation=bundle.decimation,
            ping_number=bundle.ping_number,
            last_of_ping=bundle.last_of_ping,
        )
        self._keep(pings, records)

    def expire(self, now_s: float, records: list[Record]) -> None:
        """Append the pings whose end is overdue."""
        self._keep(self._assembler.flush(now_s), records)

    def finish(self, records: list[Record]) -> None:
        """Append the open ping: the stream has ended."""
        self._keep(self._assembler.finish(), records)

    def _keep(self, pings: list[Ping], records: list[Record]) -> None:
        if pings:
            self._last_ping = pings[-1]
            records += pings
