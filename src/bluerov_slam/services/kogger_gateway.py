"""KoggerApp at the viewer's UDP ports: its polls answered, its commands guarded, the data sent to who is not fed yet.

One gateway per sonar. KoggerApp polls for ever and without asking whether anyone listens; the sonar must not notice.
Nothing from the network reaches a sonar except whole valid frames that only read, or, behind a switch, set.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from bluerov_slam.errors import CommandError
from bluerov_slam.protocol.kogger import (
    CommandDecision,
    FrameType,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    ResultCode,
    build_frame,
    classify_udp_command,
    parse_setting,
)
from bluerov_slam.protocol.kogger_commands import CONFIRM_KEY
from bluerov_slam.records import Channel
from bluerov_slam.services.sonar_session import STREAMED_IDS, SonarSession
from bluerov_slam.sources.udp import Address

logger = logging.getLogger(__name__)

PEER_SILENCE_S = 60.0
MAXIMUM_PEERS = 4
MAXIMUM_DATA_DATAGRAM_BYTES = 1400
# KoggerApp's busiest phase is 50 frames a second per link; its own restarts overlap.
PEER_FRAMES_PER_S = 100.0
PEER_BURST_FRAMES = 200.0
LIMITED_HOSTS = 64
# Where the extension sends what the viewer gets; another program there cannot have that copy.
VIEWER_ADDRESS = "127.0.0.1"
# The address 0 is "whoever you are": answered once in a while, as the address we give the sonar.
BROADCAST_ROUTE = 0
BROADCAST_ANSWER_INTERVAL_S = 1.0
# While it refreshes, an answer this old is still the truth unless the sonar restarted.
FRESH_S = 30.0
SETTING_IDS = frozenset(range(KoggerId.DATASET, KoggerId.SOUND_SPEED + 1))
SETTINGS_UNDER_WAY = 4


@dataclass(slots=True)
class GatewayCounters:
    """What came from the network to this port, and what became of it."""

    datagrams: int = 0
    frames: int = 0
    answered: int = 0
    asked_sonar: int = 0
    settings_relayed: int = 0
    settings_refused: int = 0
    refused: int = 0
    content_refused: int = 0
    bad_datagrams: int = 0
    rate_limited: int = 0
    wrong_route: int = 0
    not_private: int = 0
    peers_refused: int = 0
    data_datagrams: int = 0


@dataclass(slots=True)
class _Peer:
    """A program that polls this port."""

    address: Address
    last_poll_s: float
    marked: bool = False
    answered_s: dict[tuple[int, int], float] = field(default_factory=dict)


class HostLimits:
    """A token bucket per host, for a bounded number of hosts; the longest idle one is forgotten first."""

    def __init__(self, rate_per_s: float = PEER_FRAMES_PER_S, burst: float = PEER_BURST_FRAMES) -> None:
        self._rate_per_s = rate_per_s
        self._burst = burst
        self._buckets: dict[str, tuple[float, float]] = {}

    def __len__(self) -> int:
        return len(self._buckets)

    def allows(self, host: str, now_s: float) -> bool:
        """Take one token of this host's; False when it has none left."""
        tokens, at_s = self._buckets.pop(host, (self._burst, now_s))
        tokens = min(self._burst, tokens + (now_s - at_s) * self._rate_per_s)
        allowed = tokens >= 1.0
        self._buckets[host] = (tokens - allowed, now_s)
        if len(self._buckets) > LIMITED_HOSTS:
            del self._buckets[next(iter(self._buckets))]
        return allowed


class KoggerGateway:
    """Polls and commands in, answers and data out, for one sonar and one UDP port."""

    def __init__(
        self,
        channel: Channel,
        session: SonarSession,
        send: Callable[[bytes, Address], None],
        now_s: Callable[[], float] = time.monotonic,
        route: int | None = None,
    ) -> None:
        self.channel = channel
        self.route = channel.index + 1 if route is None else route
        self.settings_allowed = False
        self.fed: frozenset[str] = frozenset()
        self.on_setting: Callable[[int], None] = lambda frame_id: None
        self.counters = GatewayCounters()
        self._session = session
        self._send = send
        self._now_s = now_s
        self._limits = HostLimits()
        self._peers: dict[Address, _Peer] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._refused_ids: set[int] = set()

    def take(self, data: bytes, address: Address) -> None:
        """A datagram that did not come from the extension."""
        self.counters.datagrams += 1
        now_s = self._now_s()
        if not self._limits.allows(address[0], now_s):
            self.counters.rate_limited += 1
            return
        if not _is_private(address[0]):
            self.counters.not_private += 1
            return
        frames = KoggerFrameDecoder("mod256").feed(data)
        if not frames or sum(len(frame.raw) for frame in frames) != len(data):
            self.counters.bad_datagrams += 1
            return
        for frame in frames:
            self._take_frame(frame, address, now_s)

    def share(self, frames: Sequence[KoggerFrame]) -> None:
        """Send the sonar's frames to the peers that the extension does not feed."""
        # Results answer what the viewer sent down; a peer gets the result of its own command from here, readdressed.
        frames = [frame for frame in frames if not frame.response]
        if not self._peers or not frames:
            return
        now_s = self._now_s()
        self._forget_silent(now_s)
        for peer in self._peers.values():
            if self._is_fed(peer.address):
                continue
            for datagram in _datagrams(frames, self.route, peer.marked):
                self._send(datagram, peer.address)
                self.counters.data_datagrams += 1

    def peers(self) -> list[dict[str, object]]:
        """Who polls, for the status page."""
        now_s = self._now_s()
        self._forget_silent(now_s)
        return [
            {
                "address": f"{peer.address[0]}:{peer.address[1]}",
                "channel": self.channel.value,
                "age_s": round(now_s - peer.last_poll_s, 1),
                "fed_by": "extension" if self._is_fed(peer.address) else "viewer",
            }
            for peer in self._peers.values()
        ]

    async def close(self) -> None:
        """End the settings under way."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _take_frame(self, frame: KoggerFrame, address: Address, now_s: float) -> None:
        self.counters.frames += 1
        if frame.frame_type not in (FrameType.SETTING, FrameType.GETTING) or frame.is_v2:
            # Data comes from the extension only: anything else would paint a foreign picture.
            self.counters.content_refused += 1
            return
        if frame.route not in (BROADCAST_ROUTE, self.route):
            self.counters.wrong_route += 1
            return
        peer = self._peer(address, now_s)
        if peer is None:
            self.counters.peers_refused += 1
            return
        rule = classify_udp_command(frame, settings_allowed=self.settings_allowed)
        if rule.decision is not CommandDecision.ALLOW:
            self._refuse(frame, peer, rule.reason)
        elif frame.frame_type == FrameType.GETTING:
            self._getting(frame, peer, now_s)
        elif frame.frame_id == KoggerId.MARK:
            self._mark(frame, peer)
        else:
            self._relay_setting(frame, peer)

    def _peer(self, address: Address, now_s: float) -> _Peer | None:
        peer = self._peers.get(address)
        if peer is not None:
            peer.last_poll_s = now_s
            return peer
        self._forget_silent(now_s)
        if len(self._peers) >= MAXIMUM_PEERS:
            # KoggerApp reopened with another local port: its old one gives way. Strangers never push anyone out.
            own = [known for known in self._peers.values() if known.address[0] == address[0]]
            if not own:
                return None
            del self._peers[min(own, key=lambda known: known.last_poll_s).address]
        peer = self._peers[address] = _Peer(address, now_s)
        logger.info("sonar %s: %s:%d began to poll", self.channel, *address)
        return peer

    def _forget_silent(self, now_s: float) -> None:
        for address in [a for a, peer in self._peers.items() if now_s - peer.last_poll_s > PEER_SILENCE_S]:
            del self._peers[address]
            logger.info("sonar %s: %s:%d no longer polls", self.channel, *address)

    def _is_fed(self, address: Address) -> bool:
        """The extension already sends to this peer. At the viewer's own address its copy ends at the viewer."""
        return address[0] in self.fed and address[0] != VIEWER_ADDRESS

    def _getting(self, frame: KoggerFrame, peer: _Peer, now_s: float) -> None:
        if frame.frame_id == KoggerId.MARK:
            self._answer(frame, peer, bytes((self._session.marked is not False,)))
            return
        answers = self._session.answers(frame.frame_id, frame.version) if self._session.alive else []
        fresh = bool(answers) and all(now_s - answer.at_s <= FRESH_S for answer in answers)
        if not fresh or frame.frame_id in STREAMED_IDS:
            # The sonar's answer reaches every peer with its data, as whatever the sonar sends does.
            self._session.ask_soon(frame.frame_id, frame.version, frame.payload)
            self.counters.asked_sonar += 1
        if frame.route == BROADCAST_ROUTE and not self._may_answer_broadcast(frame, peer, now_s):
            return
        slot = frame.payload[0] if frame.frame_id == KoggerId.DATASET and frame.payload else 0
        for answer in answers:
            if slot in (0, answer.frame.payload[:1][0] if answer.frame.payload else 0):
                self._answer(frame, peer, answer.frame.payload)

    def _may_answer_broadcast(self, frame: KoggerFrame, peer: _Peer, now_s: float) -> bool:
        key = (frame.frame_id, frame.version)
        if now_s - peer.answered_s.get(key, -BROADCAST_ANSWER_INTERVAL_S) < BROADCAST_ANSWER_INTERVAL_S:
            return False
        if len(peer.answered_s) > LIMITED_HOSTS:
            peer.answered_s.clear()
        peer.answered_s[key] = now_s
        return True

    def _mark(self, frame: KoggerFrame, peer: _Peer) -> None:
        """MARK is ours to answer: the viewer itself marks the sonar, and asks again for everything when it restarts."""
        if frame.payload != CONFIRM_KEY:
            self._result(frame, peer, ResultCode.KEY)
            return
        if not self._session.alive:
            return
        peer.marked = True
        self._result(frame, peer, ResultCode.OK)

    def _relay_setting(self, frame: KoggerFrame, peer: _Peer) -> None:
        if len(self._tasks) >= SETTINGS_UNDER_WAY:
            self._refuse(frame, peer, "too many settings at once")
            return
        try:
            setting = parse_setting(frame)
            if setting is None:
                raise CommandError("not a setting this sonar has")
            setting.check()
        except CommandError as error:
            self._refuse(frame, peer, str(error), ResultCode.PAYLOAD)
            return
        task = asyncio.create_task(self._relay(frame, peer), name=f"kogger-app-setting-{self.channel}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _relay(self, frame: KoggerFrame, peer: _Peer) -> None:
        self.counters.settings_relayed += 1
        logger.info("sonar %s: KoggerApp at %s changes setting %#04x", self.channel, peer.address[0], frame.frame_id)
        try:
            code = await self._session.set(frame.to_bytes(route=0))
        except CommandError as error:
            logger.warning("sonar %s: setting from KoggerApp failed: %s", self.channel, error)
            code = ResultCode.RUNTIME
        self._session.forget(frame.frame_id)
        if code is not None:
            # The result quotes the checks of the command, and those changed with the route.
            self._result(frame, peer, code)
        self.on_setting(frame.frame_id)

    def _refuse(self, frame: KoggerFrame, peer: _Peer, reason: str, code: ResultCode = ResultCode.RUNTIME) -> None:
        if frame.frame_id in SETTING_IDS:
            self.counters.settings_refused += 1
        else:
            self.counters.refused += 1
        if frame.frame_id not in self._refused_ids:
            self._refused_ids.add(frame.frame_id)
            logger.warning(
                "sonar %s: command %#04x from %s refused: %s", self.channel, frame.frame_id, peer.address[0], reason
            )
        self._result(frame, peer, code)

    def _answer(self, frame: KoggerFrame, peer: _Peer, payload: bytes) -> None:
        self.counters.answered += 1
        self._send(
            build_frame(frame.frame_id, payload, version=frame.version, route=self.route, mark=True), peer.address
        )

    def _result(self, frame: KoggerFrame, peer: _Peer, code: int) -> None:
        if not frame.response:
            return
        self.counters.answered += 1
        # Results are matched with the address they were sent to; only content may answer a broadcast.
        answer = build_frame(
            frame.frame_id,
            bytes((code,)) + frame.check,
            version=frame.version,
            route=frame.route,
            mark=True,
            response=True,
        )
        self._send(answer, peer.address)


def _datagrams(frames: Iterable[KoggerFrame], route: int, marked: bool) -> list[bytes]:
    """Whole frames with the sonar's public address, packed together as far as they fit."""
    datagrams: list[bytes] = []
    current = b""
    for frame in frames:
        raw = _public(frame, route, marked)
        if current and len(current) + len(raw) > MAXIMUM_DATA_DATAGRAM_BYTES:
            datagrams.append(current)
            current = b""
        current += raw
    return [*datagrams, current] if current else datagrams


def _public(frame: KoggerFrame, route: int, marked: bool) -> bytes:
    """With the MARK bit for a peer whose MARK we acknowledged; otherwise it would reset its device all the time."""
    if frame.mark or not marked:
        return frame.to_bytes(route)
    return build_frame(
        frame.frame_id,
        frame.payload,
        frame_type=frame.frame_type,
        version=frame.version,
        route=route,
        mark=True,
        response=frame.response,
    )


def _is_private(host: str) -> bool:
    """On this computer or a local network: a forged poll cannot aim the sonar's data at the internet."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    return address.is_private or address.is_link_local or address.is_loopback
