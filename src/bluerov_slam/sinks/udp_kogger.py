"""Both sonars by UDP to the viewer and to KoggerApp: whole, valid BB55 frames, one ping a datagram where it fits."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import ipaddress
import logging
import os
import socket
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from bluerov_slam.protocol.checksums import kogger_mod255
from bluerov_slam.protocol.kogger_frame import KOGGER_SYNC, FrameType, KoggerId, reroute
from bluerov_slam.protocol.ping_assembly import is_safe_for_kogger_app
from bluerov_slam.protocol.ping_stamp import PingStamp, pack_ping_stamp
from bluerov_slam.records import Channel, SonarFrames

_log = logging.getLogger(__name__)

DATAGRAM_BYTES: Final = 1400
# The rest of a ping that has not come by then will not come.
FLUSH_AFTER_S: Final = 0.05
RETRY_AFTER_S: Final = 5.0
RESOLVE_TIMEOUT_S: Final = 5.0
_PASSING_ERRORS: Final = frozenset({errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOBUFS, errno.ECONNREFUSED})


@dataclass(slots=True)
class ForwardingCounters:
    """What went to one target from one sonar."""

    target: str
    channel: Channel
    frames: int = 0
    bytes: int = 0
    errors: int = 0
    last_error: str | None = None


class _Outlet:
    """One sonar's way to one target: a connected socket, so that the network's complaints come back to us."""

    def __init__(self, target: str, channel: Channel, seed_checksum: bool) -> None:
        self.counters = ForwardingCounters(target, channel)
        self.seed_checksum = seed_checksum
        self.address: str | None = None
        self.is_local = False
        self._socket: socket.socket | None = None
        self._broken_until_s = 0.0
        self._failed_s = 0.0

    def connect(self, family: int, address: tuple[object, ...]) -> None:
        """Aim at a resolved address."""
        self.close()
        self.address = str(address[0])
        self.is_local = ipaddress.ip_address(self.address).is_loopback
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect(address)
        except OSError as error:
            self.fail(error.strerror or str(error), 1)
            self.close()

    def send(self, datagram: bytes, frames: int, now_s: float) -> None:
        """Send now or never; what goes wrong is counted."""
        if self._socket is None or now_s < self._broken_until_s:
            self.counters.errors += frames
            return
        try:
            self._send_whole(datagram, frames, now_s)
        except OSError as error:
            self.fail(os.strerror(error.errno) if error.errno else str(error), frames, now_s)
            if error.errno not in _PASSING_ERRORS:
                self._broken_until_s = now_s + RETRY_AFTER_S
            return
        self.counters.frames += frames
        self.counters.bytes += len(datagram)
        if self.counters.last_error is not None and now_s - self._failed_s > RETRY_AFTER_S:
            self.counters.last_error = None

    def _send_whole(self, datagram: bytes, frames: int, now_s: float) -> None:
        assert self._socket is not None
        try:
            self._socket.send(datagram)
        except ConnectionRefusedError as error:
            # The refusal belongs to an earlier datagram, and reporting it kept this one back: the port may be open now.
            self.fail(os.strerror(error.errno or errno.ECONNREFUSED), frames, now_s)
            self._socket.send(datagram)

    def fail(self, text: str, frames: int, now_s: float = 0.0) -> None:
        """Count and keep the reason."""
        self._failed_s = now_s
        self.counters.errors += frames
        self.counters.last_error = text

    def close(self) -> None:
        """Release the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class UdpKogger:
    """Forwards SonarFrames to every target: A to `ports[A]`, B to `ports[B]`, each with its own ROUTE.

    While `stamps_wanted` says so, this computer's own target also learns when each ping was measured; `unix_s` gives
    the UTC of a monotonic instant.
    """

    def __init__(
        self,
        ports: Mapping[Channel, int],
        *,
        on_addresses: Callable[[Sequence[str]], None] = lambda _addresses: None,
        stamps_wanted: Callable[[], bool] = lambda: False,
        unix_s: Callable[[float], float] = lambda monotonic_s: monotonic_s,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.refused_chunks = 0
        self._ports = dict(ports)
        self._routes = {Channel.A: 1, Channel.B: 2}
        self._outlets: dict[Channel, list[_Outlet]] = {Channel.A: [], Channel.B: []}
        self._pending: dict[Channel, list[bytes]] = {Channel.A: [], Channel.B: []}
        self._measured_s = {Channel.A: 0.0, Channel.B: 0.0}
        self._timers: dict[Channel, asyncio.TimerHandle] = {}
        self._on_addresses = on_addresses
        self._stamps_wanted = stamps_wanted
        self._unix_s = unix_s
        self._clock = clock
        self._resolver: asyncio.Task[None] | None = None

    @property
    def addresses(self) -> tuple[str, ...]:
        """The resolved addresses that get data."""
        return tuple(outlet.address for outlet in self._outlets[Channel.A] if outlet.address is not None)

    @property
    def counters(self) -> tuple[ForwardingCounters, ...]:
        """One per target and sonar."""
        return tuple(outlet.counters for outlets in self._outlets.values() for outlet in outlets)

    def configure(
        self, targets: Sequence[str], routes: Mapping[Channel, int], seed_checksum_targets: Collection[str] = ()
    ) -> None:
        """Aim at these targets from now on; host names are looked up off the event loop, again and again if need be."""
        self._routes = dict(routes)
        self._close_outlets()
        seen = list(dict.fromkeys([*targets, *seed_checksum_targets]))
        for channel in Channel:
            self._outlets[channel] = [_Outlet(target, channel, target in seed_checksum_targets) for target in seen]
        if self._resolver is not None:
            self._resolver.cancel()
        self._resolver = asyncio.get_running_loop().create_task(self._resolve_all(), name="forwarding targets")

    def take(self, record: SonarFrames) -> None:
        """Forward one record's frames; those of an unfinished ping wait for the rest, but not for long."""
        channel = record.channel
        pending = self._pending[channel]
        size = sum(map(len, pending))
        for frame in record.frames:
            if not is_safe_for_kogger_app(frame):
                self.refused_chunks += 1
                continue
            if size and (size + len(frame) > DATAGRAM_BYTES or _begins_ping(frame)):
                self.flush(channel)
                size = 0
            if not size:
                self._measured_s[channel] = record.measured_s
            pending.append(frame)
            size += len(frame)
        if record.last_of_ping is False:
            self._flush_later(channel)
        else:
            self.flush(channel, last_of_ping=record.last_of_ping is True)

    def flush(self, channel: Channel, *, last_of_ping: bool = False) -> None:
        """Send what waits."""
        timer = self._timers.pop(channel, None)
        if timer is not None:
            timer.cancel()
        frames = self._pending[channel]
        outlets = self._outlets[channel]
        if not frames or not outlets:
            frames.clear()
            return
        route = self._routes[channel]
        routed = [reroute(frame, route) if frame.startswith(KOGGER_SYNC) else frame for frame in frames]
        datagram = b"".join(routed)
        stamp = self._stamp(channel, last_of_ping) if self._stamps_wanted() else b""
        now_s = self._clock()
        for outlet in outlets:
            if outlet.seed_checksum:
                outlet.send(_with_seed_checksum(routed), len(routed), now_s)
            else:
                outlet.send(stamp + datagram if outlet.is_local else datagram, len(routed), now_s)
        frames.clear()

    async def stop(self) -> None:
        """Send what waits and release the sockets."""
        for channel in Channel:
            self.flush(channel)
        if self._resolver is not None:
            self._resolver.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._resolver
            self._resolver = None
        self._close_outlets()

    def _stamp(self, channel: Channel, last_of_ping: bool) -> bytes:
        measured_s = self._measured_s[channel]
        return pack_ping_stamp(PingStamp(measured_s, self._unix_s(measured_s), last_of_ping), self._routes[channel])

    def _flush_later(self, channel: Channel) -> None:
        if self._pending[channel] and channel not in self._timers:
            loop = asyncio.get_running_loop()
            self._timers[channel] = loop.call_later(FLUSH_AFTER_S, self.flush, channel)

    async def _resolve_all(self) -> None:
        waiting = list(zip(self._outlets[Channel.A], self._outlets[Channel.B], strict=True))
        if not waiting:
            self._on_addresses(())
        while waiting:
            unresolved = []
            for pair in waiting:
                if not await self._resolve(pair):
                    unresolved.append(pair)  # noqa: PERF401  awaits
            self._on_addresses(self.addresses)
            waiting = unresolved
            if waiting:
                await asyncio.sleep(RETRY_AFTER_S)

    async def _resolve(self, pair: Sequence[_Outlet]) -> bool:
        loop = asyncio.get_running_loop()
        target = pair[0].counters.target
        try:
            async with asyncio.timeout(RESOLVE_TIMEOUT_S):
                found = await loop.getaddrinfo(target, 0, type=socket.SOCK_DGRAM)
        except (OSError, TimeoutError, UnicodeError) as error:
            for outlet in pair:
                outlet.fail(f"{target} has no address: {getattr(error, 'strerror', None) or 'no answer'}", 0)
            return False
        family, _, _, _, address = found[0]
        for outlet in pair:
            port = self._ports[outlet.counters.channel]
            outlet.connect(family, (address[0], port, *address[2:]))
        return True

    def _close_outlets(self) -> None:
        for outlets in self._outlets.values():
            for outlet in outlets:
                outlet.close()


def _begins_ping(frame: bytes) -> bool:
    return frame[4] == KoggerId.CHART and frame[3] & 3 == FrameType.CONTENT and frame[6:8] == b"\x00\x00"


def _with_seed_checksum(frames: Sequence[bytes]) -> bytes:
    return b"".join(frame[:-2] + kogger_mod255(frame[2:-2]) for frame in frames)
