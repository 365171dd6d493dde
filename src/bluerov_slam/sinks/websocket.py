"""WebSocket fan-out: a message is encoded and framed once, and no client can delay or burden the others."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass
from socket import SO_SNDBUF, SOL_SOCKET
from typing import Final

import orjson
from aiohttp import WSCloseCode, WSMsgType, web

_log = logging.getLogger(__name__)

HEARTBEAT_S: Final = 30.0
STALL_S: Final = 30.0
CLIENT_MESSAGE_BYTES: Final = 4096
# The kernel would let a slow client fall megabytes, that is minutes, behind.
SEND_BUFFER_BYTES: Final = 128 * 1024
# Above this much unsent data a client gets its messages from the queue.
WRITE_BUFFER_BYTES: Final = 64 * 1024
QUEUE_LENGTH: Final = 100
MAX_CLIENTS: Final = 400
# How often a client that is behind is looked at; all clients behind share one look.
BACKLOG_POLL_S: Final = 0.05
_TEXT: Final = 0x81
_BINARY: Final = 0x82


@dataclass(slots=True)
class BroadcastCounters:
    """What one broadcaster did since it was made."""

    messages: int = 0
    sent: int = 0
    dropped: int = 0
    clients_total: int = 0
    clients_refused: int = 0
    clients_stalled: int = 0
    bad_messages: int = 0


@dataclass(slots=True, eq=False)
class _Client:
    """One connection: its transport, what it wants and what waits for it."""

    transport: asyncio.Transport
    topics: frozenset[str]
    waiting: deque[bytes]
    progress_s: float
    last_unsent: int = 0
    dropped: int = 0


class Broadcaster:
    """Sends each message to every client that wants its topic; see `publish_text` and `publish_binary`.

    A message goes straight to the client's transport. A client that is behind by more than `write_buffer_bytes` gets
    up to `queue_length` messages queued (the oldest is dropped and counted); one that takes nothing for `stall_s` is
    cut off. `greeting` gives the messages a new client gets at once, as (topic, text).
    """

    def __init__(
        self,
        topics: Collection[str],
        *,
        greeting: Callable[[], Iterable[tuple[str, bytes]]] = tuple,
        heartbeat_s: float = HEARTBEAT_S,
        stall_s: float = STALL_S,
        queue_length: int = QUEUE_LENGTH,
        write_buffer_bytes: int = WRITE_BUFFER_BYTES,
        max_clients: int = MAX_CLIENTS,
    ) -> None:
        self.topics = tuple(topics)
        self.greeting = greeting
        self.heartbeat_s = heartbeat_s
        self.stall_s = stall_s
        self.queue_length = queue_length
        self.write_buffer_bytes = write_buffer_bytes
        self.max_clients = max_clients
        self.counters = BroadcastCounters()
        self._clients: set[_Client] = set()
        self._by_topic: dict[str, tuple[_Client, ...]] = {}
        self._behind: set[_Client] = set()
        self._sockets: set[web.WebSocketResponse] = set()
        self._poll: asyncio.TimerHandle | None = None

    @property
    def clients(self) -> int:
        """How many are connected now."""
        return len(self._clients)

    @property
    def clients_behind(self) -> int:
        """How many of them have messages queued."""
        return len(self._behind)

    def wants(self, topic: str) -> bool:
        """True when somebody would get a message of this topic: no need to encode it otherwise."""
        return bool(self._audience(topic))

    def publish_text(self, topic: str, payload: bytes) -> None:
        """Send UTF-8 text to everyone who wants the topic."""
        self._publish(topic, _TEXT, payload)

    def publish_binary(self, topic: str, payload: bytes) -> None:
        """Send bytes to everyone who wants the topic."""
        self._publish(topic, _BINARY, payload)

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """The aiohttp handler: serve one client until it leaves."""
        if self.clients >= self.max_clients:
            self.counters.clients_refused += 1
            raise web.HTTPServiceUnavailable(text=f"{self.max_clients} clients are connected already; close some")
        # Compression is off: it doubles the CPU and our data is noise to it. Frames are written beside aiohttp's own
        # writer, which is sound because both write whole frames in one go.
        socket = web.WebSocketResponse(
            heartbeat=self.heartbeat_s, compress=False, max_msg_size=CLIENT_MESSAGE_BYTES, autoclose=True, timeout=1.0
        )
        await socket.prepare(request)
        transport = request.transport
        if transport is None:
            return socket
        transport.set_write_buffer_limits(high=self.write_buffer_bytes)
        kernel_socket = transport.get_extra_info("socket")
        if kernel_socket is not None:
            kernel_socket.setsockopt(SOL_SOCKET, SO_SNDBUF, SEND_BUFFER_BYTES)
        client = _Client(transport, frozenset(self.topics), deque(maxlen=self.queue_length), _now())
        self._admit(client, socket)
        try:
            await self._listen(socket, client)
        finally:
            self._clients.discard(client)
            self._behind.discard(client)
            self._sockets.discard(socket)
            self._by_topic.clear()
        return socket

    async def close(self) -> None:
        """Say goodbye to everyone. Clients that do not read are cut off."""
        if self._poll is not None:
            self._poll.cancel()
            self._poll = None
        for client in tuple(self._behind):
            client.transport.abort()
        closing = [socket.close(code=WSCloseCode.GOING_AWAY, message=b"shutting down") for socket in self._sockets]
        with suppress(TimeoutError):
            async with asyncio.timeout(1.0):
                await asyncio.gather(*closing, return_exceptions=True)

    def _admit(self, client: _Client, socket: web.WebSocketResponse) -> None:
        for topic, payload in self.greeting():
            if topic in client.topics:
                client.transport.write(_frame(_TEXT, payload))
        self._clients.add(client)
        self._sockets.add(socket)
        self._by_topic.clear()
        self.counters.clients_total += 1

    async def _listen(self, socket: web.WebSocketResponse, client: _Client) -> None:
        async for message in socket:
            if message.type is WSMsgType.TEXT:
                refusal = self._obey(client, message.data)
                if refusal:
                    self.counters.bad_messages += 1
                    self._send(client, _frame(_TEXT, orjson.dumps({"error": refusal})))
            elif message.type is WSMsgType.ERROR:
                self.counters.bad_messages += 1

    def _obey(self, client: _Client, text: str) -> str | None:
        """Carry out a client's message; why not, if it cannot be."""
        try:
            wish = orjson.loads(text)
        except orjson.JSONDecodeError as error:
            return f'not JSON: {error}; expected {{"subscribe": [...]}}'
        topics = wish.get("subscribe") if isinstance(wish, dict) else None
        if not isinstance(topics, list) or not all(isinstance(topic, str) for topic in topics):
            return f'expected {{"subscribe": [...]}} with any of {", ".join(self.topics)}'
        client.topics = frozenset(topics) & frozenset(self.topics)
        self._by_topic.clear()
        unknown = sorted(set(topics) - set(self.topics))
        return f"no such topic: {', '.join(unknown)}; there are {', '.join(self.topics)}" if unknown else None

    def _audience(self, topic: str) -> tuple[_Client, ...]:
        audience = self._by_topic.get(topic)
        if audience is None:
            audience = self._by_topic[topic] = tuple(client for client in self._clients if topic in client.topics)
        return audience

    def _publish(self, topic: str, opcode: int, payload: bytes) -> None:
        audience = self._audience(topic)
        if not audience:
            return
        self.counters.messages += 1
        frame = _frame(opcode, payload)
        for client in audience:
            self._send(client, frame)

    def _send(self, client: _Client, frame: bytes) -> None:
        transport = client.transport
        if transport.is_closing():
            return
        if not client.waiting and transport.get_write_buffer_size() < self.write_buffer_bytes:
            transport.write(frame)
            self.counters.sent += 1
            return
        if not client.waiting:
            self._fall_behind(client)
        if len(client.waiting) == self.queue_length:
            client.dropped += 1
            self.counters.dropped += 1
        client.waiting.append(frame)

    def _fall_behind(self, client: _Client) -> None:
        client.progress_s = _now()
        client.last_unsent = client.transport.get_write_buffer_size()
        self._behind.add(client)
        if self._poll is None:
            self._poll = asyncio.get_running_loop().call_later(BACKLOG_POLL_S, self._serve_backlog)

    def _serve_backlog(self) -> None:
        self._poll = None
        now = _now()
        for client in tuple(self._behind):
            self._catch_up(client, now)
        if self._behind:
            self._poll = asyncio.get_running_loop().call_later(BACKLOG_POLL_S, self._serve_backlog)

    def _catch_up(self, client: _Client, now: float) -> None:
        transport = client.transport
        if transport.is_closing():
            self._behind.discard(client)
            client.waiting.clear()
            return
        unsent = transport.get_write_buffer_size()
        if unsent < client.last_unsent:
            client.progress_s = now
        while client.waiting and transport.get_write_buffer_size() < self.write_buffer_bytes:
            transport.write(client.waiting.popleft())
            self.counters.sent += 1
        client.last_unsent = transport.get_write_buffer_size()
        if not client.waiting:
            self._behind.discard(client)
        elif now - client.progress_s > self.stall_s:
            self._cut_off(client)

    def _cut_off(self, client: _Client) -> None:
        self.counters.clients_stalled += 1
        client.dropped += len(client.waiting)
        self.counters.dropped += len(client.waiting)
        peer = client.transport.get_extra_info("peername")
        _log.warning("%s took nothing for %g s and was cut off (%d messages lost)", peer, self.stall_s, client.dropped)
        self._behind.discard(client)
        client.waiting.clear()
        client.transport.abort()


def _frame(opcode: int, payload: bytes) -> bytes:
    """One whole, unmasked WebSocket frame (RFC 6455 section 5.2); `opcode` includes the FIN bit."""
    length = len(payload)
    if length < 126:
        return bytes((opcode, length)) + payload
    if length < 65536:
        return bytes((opcode, 126)) + length.to_bytes(2, "big") + payload
    return bytes((opcode, 127)) + length.to_bytes(8, "big") + payload


def _now() -> float:
    return asyncio.get_running_loop().time()
