"""The whole system as processes, a watched browser page and BlueOS's proxy: what the browser tests run on."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from aiohttp import ClientSession, WSMsgType, web
from playwright.sync_api import Page

from free_ports import free_ports
from patience import PATIENCE_S

START_PATIENCE_S = 120.0

OpenPage = Callable[..., Page]


class RunningSystem:
    """The whole system as a user starts it."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder = folder
        self.ports = free_ports()
        settings = {
            "http.host": "127.0.0.1",
            "http.port": self.ports["http"],
            "http.sensor_ws_port": self.ports["sensor_ws"],
            "viewer.port": self.ports["viewer"],
            "viewer.waterfall_ws_port": self.ports["waterfall_ws"],
            "viewer.udp_port_a": self.ports["udp_a"],
            "viewer.udp_port_b": self.ports["udp_b"],
            "paths.state": folder / "state",
            "recording.min_free_mb": 10,
        }
        flags = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
        command = [sys.executable, "-m", "bluerov_slam", "run", "--simulate", *flags, *arguments]
        self.log = folder / "run.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        self.dashboard = f"http://127.0.0.1:{self.ports['http']}/"
        self.viewer = f"http://127.0.0.1:{self.ports['viewer']}/"

    def get(self, path: str, base: str | None = None) -> Any:
        """The JSON answer of a GET of the extension, or of another base address."""
        with urllib.request.urlopen((base or self.dashboard) + path, timeout=PATIENCE_S) as response:
            return json.load(response)

    def active_recording(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The dive that is being recorded, once it satisfies the condition; there may be none for a while."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            overview = self.get("api/recordings")
            active = next((dive for dive in overview["recordings"] if dive["name"] == overview["active"]), None)
            if active is not None and condition(active):
                return active
            assert time.monotonic() < deadline, f"not within {PATIENCE_S} s; last: {json.dumps(overview)[:4000]}"
            time.sleep(0.1)

    def until_up(self) -> None:
        """Return once the serial port is open and both pages are served."""
        deadline = time.monotonic() + START_PATIENCE_S
        while time.monotonic() < deadline:
            assert self.process.poll() is None, self.log.read_text(errors="replace")
            with contextlib.suppress(OSError, urllib.error.URLError):
                if self.get("health")["serial"] and self.get("health", self.viewer)["status"] == "healthy":
                    return
            time.sleep(0.1)
        raise AssertionError(f"not up in {START_PATIENCE_S} s:\n{self.log.read_text(errors='replace')}")

    def stop(self) -> None:
        """End it as Ctrl-C does; what does not end is killed with its children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGINT)
        try:
            self.process.wait(PATIENCE_S)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)


# The pages never read a canvas back; tests do, again and again.
OF_THE_TESTS = "Canvas2D: Multiple readback operations"


@dataclass
class Watch:
    """What the pages of one test did; checked when the test ends."""

    complaints: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    expected: tuple[str, ...] = ()

    def expect_complaints(self, *parts: str) -> None:
        """Complaints of the browser's console that this test provokes."""
        self.expected = parts

    def unexpected(self) -> list[str]:
        """What is left."""
        return [text for text in self.complaints if not any(part in text for part in self.expected)]

    def follow(self, page: Page, host: str | None) -> None:
        """Note what this page complains of and where it asks."""
        page.on("console", self._note_console)
        page.on("pageerror", lambda error: self.complaints.append(f"page error: {error}"))
        page.on("request", lambda request: self._note_address(request.url, host))
        page.on("websocket", lambda socket: self._note_address(socket.url, host))

    def _note_console(self, message: Any) -> None:
        if message.type in ("error", "warning") and OF_THE_TESTS not in message.text:
            self.complaints.append(f"{message.type}: {message.text}")

    def _note_address(self, url: str, host: str | None) -> None:
        parts = urlsplit(url)
        if parts.scheme in ("http", "https", "ws", "wss") and parts.hostname != host:
            self.foreign.append(url)


class PrefixProxy:
    """BlueOS's nginx in small: one service under a path prefix, which it strips. A thread of its own serves it.

    `websockets=False` is nginx of BlueOS 1.4.3, which passes no upgrade: the service then sees a plain GET.
    """

    PREFIX = "/extensionv2/blueslam"

    def __init__(self, target: str, websockets: bool = True) -> None:
        self._target = target.rstrip("/")
        self._websockets = websockets
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._stop = asyncio.Event()
        self.port = 0
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._serve(),), daemon=True)
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)

    @property
    def url(self) -> str:
        """Where the page is, with its slash."""
        return f"http://127.0.0.1:{self.port}{self.PREFIX}/"

    @property
    def frame_url(self) -> str:
        """A page that holds the service in an iframe, as BlueOS does."""
        return f"http://127.0.0.1:{self.port}/frame"

    def close(self) -> None:
        """Stop serving."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(PATIENCE_S)

    async def _serve(self) -> None:
        app = web.Application()
        app.router.add_get("/frame", self._frame)
        app.router.add_route("*", self.PREFIX + "/{path:.*}", self._pass_on)
        runner = web.AppRunner(app, handler_cancellation=True, shutdown_timeout=0.5)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        self.port = runner.addresses[0][1]
        async with ClientSession(auto_decompress=False) as self._client:
            self._ready.set()
            await self._stop.wait()
            await runner.cleanup()

    async def _frame(self, _request: web.Request) -> web.Response:
        page = (
            "<!doctype html><title>BlueOS</title><style>body{margin:0}iframe{border:0;width:100%;height:100vh}</style>"
            f'<link rel="icon" href="data:,"><iframe src="{self.PREFIX}/"></iframe>'
        )
        return web.Response(text=page, content_type="text/html")

    async def _pass_on(self, request: web.Request) -> web.StreamResponse:
        address = f"{self._target}/{request.match_info['path']}"
        if request.headers.get("Upgrade", "").lower() == "websocket" and self._websockets:
            return await self._pass_socket(request, address)
        skipped = {"host", "connection", "upgrade", "transfer-encoding", "content-length"}
        headers = {name: value for name, value in request.headers.items() if name.lower() not in skipped}
        headers["Connection"] = "Upgrade"
        async with self._client.request(
            request.method,
            address,
            params=request.query,
            headers=headers,
            data=await request.read(),
            allow_redirects=False,
        ) as answer:
            kept = {name: value for name, value in answer.headers.items() if name.lower() not in skipped}
            return web.Response(status=answer.status, headers=kept, body=await answer.read())

    async def _pass_socket(self, request: web.Request, address: str) -> web.StreamResponse:
        inner = web.WebSocketResponse()
        async with self._client.ws_connect(address, origin=request.headers.get("Origin")) as outer:
            await inner.prepare(request)

            async def upward() -> None:
                async for message in inner:
                    if message.type is WSMsgType.TEXT:
                        await outer.send_str(message.data)

            sending = asyncio.create_task(upward())
            try:
                async for message in outer:
                    if message.type is WSMsgType.TEXT:
                        await inner.send_str(message.data)
                    elif message.type is WSMsgType.BINARY:
                        await inner.send_bytes(message.data)
            finally:
                sending.cancel()
                await inner.close()
        return inner
