"""The viewer's end of the loopback link to the extension: commands down; sonar answers, vehicle and recording up."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiohttp
import orjson

from bluerov_slam.errors import CommandError
from bluerov_slam.records import Channel

logger = logging.getLogger(__name__)

LINK_PATH = "/internal/viewer-link"
TOKEN_FILE = "viewer-link.token"  # noqa: S105  the name of the file, not a token
BACKOFF_FIRST_S = 0.25
BACKOFF_LAST_S = 4.0
# The extension gives the ESP32 its own time to acknowledge and answers "timeout" itself; this is the net below it.
ANSWER_TIMEOUT_S = 2.0
HEARTBEAT_S = 10.0
MAXIMUM_MESSAGE_BYTES = 1024 * 1024


@dataclass(frozen=True, slots=True)
class CommandResult:
    """What became of one frame on its way to the sonar; `ok` means the ESP32 acknowledged it."""

    result: str
    message: str = ""


@dataclass(frozen=True, slots=True)
class AnnotationResult:
    """Answer of the extension to an annotation request."""

    ok: bool
    annotations: list[dict[str, Any]]
    message: str = ""


@dataclass(slots=True)
class LinkListener:
    """Who wants to hear what the extension says. All run on the event loop and must not wait."""

    on_sonar_frame: Callable[[Channel, bytes], None] = lambda channel, frame: None
    on_message: Callable[[str, dict[str, Any]], None] = lambda kind, message: None
    on_up: Callable[[], None] = lambda: None
    on_down: Callable[[], None] = lambda: None


class ViewerLinkClient:
    """Keeps the link up, with a token read afresh at each attempt because the extension makes a new one at start."""

    def __init__(self, url: str, token_file: Path, sleep: Callable[[float], Awaitable[None]] = asyncio.sleep) -> None:
        self.listener = LinkListener()
        self.connected = False
        self.message = "not connected yet"
        self.reconnects = 0
        self.unreadable = 0
        self._url = url
        self._token_file = token_file
        self._sleep = sleep
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._next_id = 0

    async def command(self, channel: Channel, frame: bytes) -> CommandResult:
        """Send one whole BB55 frame to a sonar; returns when the ESP32 acknowledged it or it failed."""
        answer = await self._ask({"type": "command", "channel": channel.value, "frame": frame.hex()})
        if answer is None:
            return CommandResult("no_link", self._no_link_text())
        return CommandResult(str(answer.get("result", "unknown")), str(answer.get("message") or ""))

    async def annotate(self, operation: str, annotation: dict[str, Any]) -> AnnotationResult:
        """List, add, change or remove an annotation of the active recording."""
        answer = await self._ask({"type": "annotation", "operation": operation, "annotation": annotation})
        if answer is None:
            return AnnotationResult(False, [], self._no_link_text())
        return AnnotationResult(
            bool(answer.get("ok")), list(answer.get("annotations") or []), str(answer.get("message") or "")
        )

    async def run(self) -> None:
        """Connect, listen, reconnect with back-off; until cancelled."""
        backoff = BACKOFF_FIRST_S
        async with aiohttp.ClientSession() as session:
            while True:
                if await self._connect_and_listen(session):
                    backoff = BACKOFF_FIRST_S
                await self._sleep(backoff)
                backoff = min(BACKOFF_LAST_S, 2 * backoff)

    async def _connect_and_listen(self, session: aiohttp.ClientSession) -> bool:
        """One life of the link; True if it came up."""
        try:
            token = self._token_file.read_text().strip()
        except OSError as error:
            self._explain(f"waiting for the extension: no {self._token_file} yet ({error.strerror})")
            return False
        try:
            async with session.ws_connect(
                self._url,
                headers={"Authorization": f"Bearer {token}"},
                heartbeat=HEARTBEAT_S,
                max_msg_size=MAXIMUM_MESSAGE_BYTES,
            ) as socket:
                await self._listen(socket)
                return True
        except aiohttp.WSServerHandshakeError as error:
            self._explain(f"the extension refused the viewer's link (HTTP {error.status}); is it the same version?")
        except (aiohttp.ClientError, OSError, TimeoutError) as error:
            self._explain(f"waiting for the extension at {self._url}: {error or type(error).__name__}")
        return False

    async def _listen(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self.connected = True
        self.message = "connected"
        logger.info("connected to the extension at %s", self._url)
        self.listener.on_up()
        try:
            async for received in socket:
                if received.type is aiohttp.WSMsgType.TEXT:
                    self._take(received.data)
        finally:
            self._socket = None
            self.connected = False
            self.reconnects += 1
            self._explain("the link to the extension was lost; reconnecting")
            for waiting in self._waiting.values():
                if not waiting.done():
                    waiting.set_result({"result": "no_link", "ok": False, "message": self._no_link_text()})
            self._waiting.clear()
            self.listener.on_down()

    def _take(self, text: str) -> None:
        try:
            message = orjson.loads(text)
            kind = message["type"]
            if kind == "sonar_frame":
                self.listener.on_sonar_frame(Channel(message["channel"]), bytes.fromhex(message["frame"]))
            elif kind in ("command_result", "annotation_result"):
                waiting = self._waiting.pop(message["id"], None)
                if waiting is not None and not waiting.done():
                    waiting.set_result(message)
            else:
                self.listener.on_message(kind, message)
        except (ValueError, KeyError, TypeError, CommandError) as error:
            self.unreadable += 1
            logger.debug("unreadable message of the extension: %s", error)

    async def _ask(self, message: dict[str, Any]) -> dict[str, Any] | None:
        """Send a request and wait for the answer with its id; None without a link, or when it broke meanwhile."""
        socket = self._socket
        if socket is None or socket.closed:
            return None
        self._next_id += 1
        number = self._next_id
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            await socket.send_str(orjson.dumps({**message, "id": number}).decode())
            # Not wait_for: in Python 3.11 it swallows a cancellation that meets the answer.
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                return await answer
        except TimeoutError:
            return {"result": "timeout", "ok": False, "message": "the extension did not answer in time"}
        except (ConnectionError, aiohttp.ClientError):
            return None
        finally:
            self._waiting.pop(number, None)

    def _no_link_text(self) -> str:
        return f"no link to the extension ({self.message}): start it, or look at its page on port 8099"

    def _explain(self, message: str) -> None:
        if message != self.message:
            logger.warning("%s", message)
        self.message = message


@dataclass(slots=True)
class LinkFacts:
    """The last thing the extension said about each matter."""

    vehicle: dict[str, Any] = field(default_factory=dict)
    fed: frozenset[str] = frozenset()
    settings: dict[str, Any] = field(default_factory=dict)
    recording: str | None = None
    chips: list[dict[str, Any]] = field(default_factory=list)

    def take(self, kind: str, message: dict[str, Any]) -> None:
        """Remember a message of the extension; unknown kinds are for a later version."""
        body = {key: value for key, value in message.items() if key != "type"}
        if kind == "vehicle":
            self.vehicle = body.get("data", body)
        elif kind == "fed":
            self.fed = frozenset(str(address) for address in body.get("addresses", ()))
        elif kind == "settings":
            self.settings = body.get("data", body)
        elif kind == "recording":
            name = body.get("name")
            self.recording = str(name) if name else None
        elif kind == "health":
            self.chips = [chip for chip in body.get("chips", ()) if isinstance(chip, dict)]
