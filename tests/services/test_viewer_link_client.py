import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from aiohttp import WSMsgType, web

from bluerov_slam.records import Channel
from bluerov_slam.services.viewer_link_client import LINK_PATH, TOKEN_FILE, LinkFacts, ViewerLinkClient
from patience import PATIENCE_S


class FakeExtension:
    """The server side of the viewer link, scripted by the test."""

    def __init__(self) -> None:
        self.token = "secret"
        self.heard: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.sockets: list[web.WebSocketResponse] = []
        self.answers = True
        self.port = 0
        self._runner: web.AppRunner | None = None

    async def start(self) -> None:
        app = web.Application()
        app.router.add_get(LINK_PATH, self._serve)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", self.port)
        await site.start()
        self.port = site._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        for socket in self.sockets:
            await socket.close()
        await self._runner.cleanup()

    async def say(self, message: object) -> None:
        await self.sockets[-1].send_str(message if isinstance(message, str) else json.dumps(message))

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Authorization") != f"Bearer {self.token}":
            return web.Response(status=403)
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        self.sockets.append(socket)
        async for message in socket:
            if message.type is WSMsgType.TEXT:
                heard = json.loads(message.data)
                self.heard.put_nowait(heard)
                if self.answers and heard["type"] == "command":
                    await self.say({"type": "command_result", "id": heard["id"], "result": "ok", "message": "done"})
                elif self.answers:
                    await self.say(
                        {"type": "annotation_result", "id": heard["id"], "ok": True, "annotations": [{"id": "x"}]}
                    )
        return socket


@pytest.fixture
async def extension() -> AsyncIterator[FakeExtension]:
    extension = FakeExtension()
    await extension.start()
    yield extension
    await extension.stop()


@pytest.fixture
async def client(extension: FakeExtension, tmp_path: Path) -> AsyncIterator[ViewerLinkClient]:
    (tmp_path / TOKEN_FILE).write_text("secret\n")
    client = ViewerLinkClient(
        f"http://127.0.0.1:{extension.port}{LINK_PATH}", tmp_path / TOKEN_FILE, sleep=lambda _: asyncio.sleep(0.01)
    )
    up = asyncio.Event()
    client.listener.on_up = up.set
    client.up = up
    task = asyncio.create_task(client.run())
    yield client
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def up(client: ViewerLinkClient) -> None:
    async with asyncio.timeout(PATIENCE_S):
        await client.up.wait()
    client.up.clear()


async def test_a_command_travels_as_hex_and_its_result_comes_back(client, extension) -> None:
    await up(client)
    result = await client.command(Channel.B, bytes.fromhex("bb5500832000a3c9"))
    heard = await extension.heard.get()
    assert {key: heard[key] for key in ("type", "channel", "frame")} == {
        "type": "command", "channel": "B", "frame": "bb5500832000a3c9",
    }  # fmt: skip
    assert (result.result, result.message) == ("ok", "done")


async def test_answers_are_matched_by_their_id(client, extension) -> None:
    await up(client)
    extension.answers = False
    first = asyncio.create_task(client.command(Channel.A, b"1"))
    second = asyncio.create_task(client.command(Channel.B, b"2"))
    ids = [(await extension.heard.get())["id"] for _ in range(2)]
    await extension.say({"type": "command_result", "id": 999, "result": "busy"})
    await extension.say({"type": "command_result", "id": ids[1], "result": "rejected"})
    await extension.say({"type": "command_result", "id": ids[0], "result": "ok"})
    assert [(await task).result for task in (first, second)] == ["ok", "rejected"]


async def test_without_a_link_a_command_fails_at_once_with_the_cure(tmp_path) -> None:
    client = ViewerLinkClient("ws://127.0.0.1:1/", tmp_path / TOKEN_FILE)
    result = await client.command(Channel.A, b"")
    assert result.result == "no_link"
    assert "port 8099" in result.message
    assert not (await client.annotate("list", {})).ok


async def test_a_link_that_breaks_ends_the_waiting_and_comes_back_with_the_new_token(
    client, extension, tmp_path
) -> None:
    await up(client)
    extension.answers = False
    waiting = asyncio.create_task(client.command(Channel.A, b"1"))
    await extension.heard.get()
    await extension.stop()
    assert (await waiting).result == "no_link"
    assert not client.connected
    extension.token = "newer"
    extension.answers = True
    extension.sockets.clear()
    await extension.start()
    (tmp_path / TOKEN_FILE).write_text("newer")
    await up(client)
    assert (await client.command(Channel.A, b"1")).result == "ok"
    assert client.reconnects == 1


async def test_what_the_extension_says_reaches_the_listener_and_nonsense_does_not(client, extension) -> None:
    await up(client)
    frames: asyncio.Queue[tuple[Channel, bytes]] = asyncio.Queue()
    facts = LinkFacts()
    client.listener.on_sonar_frame = lambda channel, frame: frames.put_nowait((channel, frame))
    client.listener.on_message = facts.take
    for nonsense in (
        "{",
        "[]",
        '{"type": "sonar_frame"}',
        {"type": "sonar_frame", "channel": "C", "frame": "zz"},
        {"type": "x"},
    ):
        await extension.say(nonsense)
    await extension.say({"type": "fed", "addresses": ["192.168.2.1"]})
    await extension.say({"type": "recording", "name": "session_20260101_000000"})
    await extension.say({"type": "vehicle", "heading_deg": 12.0})
    await extension.say({"type": "settings", "mirror": True})
    await extension.say({"type": "health", "chips": [{"id": "link"}, "nonsense"]})
    await extension.say({"type": "sonar_frame", "channel": "A", "frame": "bb55"})
    async with asyncio.timeout(PATIENCE_S):
        assert await frames.get() == (Channel.A, b"\xbb\x55")
    assert facts.fed == {"192.168.2.1"}
    assert facts.recording == "session_20260101_000000"
    assert facts.chips == [{"id": "link"}]
    assert (facts.vehicle, facts.settings) == ({"heading_deg": 12.0}, {"mirror": True})
    assert frames.empty()
    assert client.unreadable == 4


async def test_a_refused_token_is_explained(client, extension, tmp_path) -> None:
    await up(client)
    extension.token = "other"
    for socket in extension.sockets:
        await socket.close()
    async with asyncio.timeout(PATIENCE_S):
        while "refused" not in client.message:
            await asyncio.sleep(0.01)
    assert "HTTP 403" in client.message


async def test_annotations_are_asked_and_answered(client, extension) -> None:
    await up(client)
    result = await client.annotate("add", {"name": "wreck"})
    heard = await extension.heard.get()
    assert (heard["operation"], heard["annotation"]) == ("add", {"name": "wreck"})
    assert result.ok
    assert result.annotations == [{"id": "x"}]
