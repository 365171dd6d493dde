"""One sonar at the viewer: datagrams of the extension to pings, everybody else's to the KoggerApp gateway."""

from __future__ import annotations

import ipaddress
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from bluerov_slam.protocol.kogger import ChecksumChoice, FrameType, KoggerFrame, KoggerFrameDecoder, KoggerId
from bluerov_slam.protocol.ping_assembly import PingAssembler
from bluerov_slam.protocol.ping_stamp import PingStamp, unpack_ping_stamp
from bluerov_slam.records import Channel, Ping
from bluerov_slam.services.kogger_gateway import KoggerGateway
from bluerov_slam.services.sonar_session import ALIVE_S, SonarSession
from bluerov_slam.sources.udp import Address

PINGS_TO_LEARN = 3
RATE_WINDOW_S = 5.0
_MODE_OFFSET = 3
_TYPE_BITS = 3


@dataclass(slots=True)
class ChannelCounters:
    """What came from the extension for this sonar since start."""

    packets: int = 0
    bytes_received: int = 0
    frames: int = 0
    pings: int = 0


class SampleCount:
    """Teaches the assembler how many samples a whole ping has, so that it is shown as soon as it is complete.

    The sonar's own answer (CHART_SETUP) is used by the assembler itself. Where none comes, as with old firmware, a few
    whole pings alike teach the count. Such a guess is dropped at the first ping that disagrees: a shorter one is shown
    short, not padded; a longer one, of which the beginning has been shown, is shown again whole.
    """

    def __init__(self, assembler: PingAssembler) -> None:
        self._assembler = assembler
        self._guess: int | None = None
        self._last_size = 0
        self._alike = 0
        self._shortened = -1
        self._previous: dict[int, Ping] = {}

    def check(self, ping: Ping) -> Ping:
        """The ping as it should be shown."""
        ping = self._rejoin(ping)
        guessed = self._guess == ping.samples.size or self._shortened == ping.number
        if guessed and _is_tail_missing(ping):
            self._unlearn()
            self._shortened = ping.number  # a second sub-channel has the same number
            end = ping.gaps[-1][0]
            ping = replace(ping, samples=ping.samples[:end], gaps=ping.gaps[:-1])
        elif self._assembler.expected_samples is None:
            self._learn(ping)
        self._previous[ping.sub_channel] = ping
        return ping

    def _rejoin(self, ping: Ping) -> Ping:
        """A ping that lacks exactly what the one before it was: they are one, ended too early by a wrong count."""
        previous = self._previous.get(ping.sub_channel)
        if (
            previous is None
            or not ping.gaps
            or ping.gaps[0] != (0, previous.samples.size)
            or (previous.resolution_m, previous.first_sample) != (ping.resolution_m, ping.first_sample)
        ):
            return ping
        samples = np.concatenate((previous.samples, ping.samples[previous.samples.size :]))
        return replace(ping, measured_s=previous.measured_s, samples=samples, gaps=(*previous.gaps, *ping.gaps[1:]))

    def _learn(self, ping: Ping) -> None:
        self._guess = None
        if ping.gaps or ping.sub_channel:
            return
        self._alike = self._alike + 1 if ping.samples.size == self._last_size else 1
        self._last_size = ping.samples.size
        if self._alike >= PINGS_TO_LEARN:
            self._guess = self._assembler.expected_samples = ping.samples.size

    def _unlearn(self) -> None:
        self._assembler.expected_samples = self._guess = None
        self._alike = 0


class ViewerChannel:
    """Everything that happens at one of the two UDP ports.

    `on_ping` gets each ping as soon as it is complete, with its UTC. Frames behind a stamp of the extension were
    measured when it says; frames without one count from their arrival.
    """

    def __init__(
        self,
        channel: Channel,
        session: SonarSession,
        gateway: KoggerGateway,
        on_ping: Callable[[Ping, float], None],
        now_s: Callable[[], float] = time.monotonic,
        unix_s: Callable[[], float] = time.time,
        checksum: ChecksumChoice = "auto",
        expected_samples: int | None = None,
    ) -> None:
        self.channel = channel
        self.session = session
        self.gateway = gateway
        self.counters = ChannelCounters()
        self.on_restart: Callable[[], None] = lambda: None
        self._on_ping = on_ping
        self._now_s = now_s
        self._unix_s = unix_s
        self._unix_offset_s = unix_s() - now_s()
        self._decoder = KoggerFrameDecoder(checksum)
        self._assembler = PingAssembler(channel, expected_samples)
        self._sample_count = SampleCount(self._assembler)
        self._ping_times_s: deque[float] = deque(maxlen=256)
        self._last_ping: Ping | None = None

    def take_datagram(self, data: bytes, address: Address) -> None:
        """Sonar data from this computer's extension, or a poll or command from whoever."""
        if len(data) > _MODE_OFFSET and data[_MODE_OFFSET] & _TYPE_BITS == FrameType.CONTENT and _is_here(address[0]):
            self._take_data(data)
        else:
            self.gateway.take(data, address)

    def take_answer(self, frame: KoggerFrame) -> None:
        """A frame of the sonar that came over the viewer link; it may tell the sample count."""
        self.session.take(frame)
        if frame.frame_id != KoggerId.CHART_SETUP:
            return
        if frame.response:
            # Just set: the next pings have a size that is not read back yet.
            self._assembler.expected_samples = None
        else:
            self._assembler.feed(frame, self._now_s(), self._now_s())

    def flush(self) -> None:
        """Show the ping that nothing more is added to."""
        self._show(self._assembler.flush(self._now_s()))

    def status(self) -> dict[str, Any]:
        """Counters and state for the page."""
        now_s = self._now_s()
        decoder, assembly, ping = self._decoder.counters, self._assembler.counters, self._last_ping
        return {
            "packets": self.counters.packets,
            "bytes": self.counters.bytes_received,
            "bb55": self.counters.frames,
            "pings": self.counters.pings,
            "pings_per_s": round(self._pings_per_s(now_s), 1),
            "age_s": round(now_s - self._ping_times_s[-1], 2) if self._ping_times_s else None,
            "alive": self.session.alive,
            "incomplete": assembly.incomplete,
            "gap_samples": assembly.gap_samples,
            "duplicates": assembly.duplicates,
            "oversize_chunks": assembly.oversize_chunks,
            "unsupported": assembly.unsupported,
            "checksum_errors": decoder.checksum_errors,
            "bytes_skipped": decoder.bytes_skipped,
            "checksum_in_use": self._decoder.checksum_in_use,
            "expected_samples": self._assembler.expected_samples,
            "samples": ping.samples.size if ping else None,
            "resolution_mm": round(ping.resolution_m * 1000) if ping else None,
            "sonar_restarts": self.session.restarts,
        }

    def _pings_per_s(self, now_s: float) -> float:
        recent = [at_s for at_s in self._ping_times_s if now_s - at_s <= RATE_WINDOW_S]
        if len(recent) < 2 or now_s - recent[-1] > ALIVE_S:
            return 0.0
        return (len(recent) - 1) / max(recent[-1] - recent[0], 1e-3)

    def _take_data(self, data: bytes) -> None:
        now_s = self._now_s()
        self.counters.packets += 1
        self.counters.bytes_received += len(data)
        stamp, frames = _split_stamp(self._decoder.feed(data))
        self.counters.frames += len(frames)
        measured_s = stamp.measured_s if stamp else now_s
        self._unix_offset_s = (stamp.unix_s if stamp else self._unix_s()) - measured_s
        for index, frame in enumerate(frames, 1):
            if frame.frame_type == FrameType.CONTENT:
                self._note_mark(frame)
                ends_ping = stamp is not None and stamp.last_of_ping and index == len(frames)
                self._show(self._assembler.feed(frame, measured_s, now_s, last_of_ping=ends_ping))
        self.gateway.share(frames)

    def _note_mark(self, frame: KoggerFrame) -> None:
        """Only charts tell: answers overtake them on the way, so that both together look like a restart."""
        if frame.frame_id == KoggerId.CHART and self.session.heard(frame.mark):
            self.on_restart()

    def _show(self, pings: list[Ping]) -> None:
        for ping in pings:
            self._last_ping = ping = self._sample_count.check(ping)
            self.counters.pings += ping.sub_channel == 0
            self._ping_times_s.append(self._now_s())
            self._on_ping(ping, ping.measured_s + self._unix_offset_s)


def _split_stamp(frames: list[KoggerFrame]) -> tuple[PingStamp | None, list[KoggerFrame]]:
    stamp = unpack_ping_stamp(frames[0]) if frames else None
    return stamp, frames[1:] if stamp else frames


def _is_tail_missing(ping: Ping) -> bool:
    return bool(ping.gaps) and ping.gaps[-1][1] == ping.samples.size


@lru_cache(maxsize=64)
def _is_here(host: str) -> bool:
    """The extension shares this computer; sonar data from elsewhere would paint a foreign picture.

    An address is ours if we can bind to it. The kernel itself drops what comes from outside with such a source.
    """
    if ipaddress.ip_address(host).is_loopback:
        return True
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True
