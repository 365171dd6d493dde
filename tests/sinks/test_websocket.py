import asyncio
import json
import socket as sockets
from contextlib import asynccontextmanager

import aiohttp
import pytest
from aiohttp import web

from bluerov_slam.sinks.websocket import Broadcaster
from patience import PATIENCE_S

TOPICS = ("sensors", "status", "A")


@asynccontextmanager
async def serving(broadcaster):
    app = web.Application()
    app.router.add_get("/ws", broadcaster.handle)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=1)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    port = site._server.sockets[0].getsockname()[1]
    async with aiohttp.ClientSession(f"http://127.0.0.1:{port}") as session:
        session.port = port
        yield session
    await broadcaster.close()
    await runner.cleanup()


async def connected(broadcaster, count):
    """Wait until the server side has this many clients."""
    while broadcaster.clients != count:
        await asyncio.sleep(0)


async def stuck_client(port):
    """A client that finishes the handshake and never reads again, with as little kernel buffer as possible."""
    raw = sockets.socket()
    raw.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, 4096)
    raw.setblocking(False)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(raw, ("127.0.0.1", port))
    await loop.sock_sendall(
        raw,
        b"GET /ws HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n",
    )
    return raw


@pytest.mark.parametrize("length", [0, 1, 125, 126, 65535, 65536, 100_000])
async def test_text_and_binary_of_any_length_arrive_whole(length):
    broadcaster = Broadcaster(TOPICS)
    async with serving(broadcaster) as session, session.ws_connect("/ws") as client:
        await connected(broadcaster, 1)
        broadcaster.publish_binary("A", bytes(length))
        broadcaster.publish_text("sensors", b"x" * length)
        assert (await client.receive()).data == bytes(length)
        assert (await client.receive()).data == "x" * length


async def test_a_client_gets_only_the_topics_it_asked_for():
    broadcaster = Broadcaster(TOPICS)
    async with serving(broadcaster) as session, session.ws_connect("/ws") as client:
        await client.send_json({"subscribe": ["status"]})
        await connected(broadcaster, 1)
        while broadcaster.wants("sensors"):
            await asyncio.sleep(0)
        broadcaster.publish_text("sensors", b"no")
        broadcaster.publish_text("status", b"yes")
        assert (await client.receive()).data == "yes"
        assert broadcaster.wants("status")


async def test_nobody_wants_anything_once_the_last_client_left():
    broadcaster = Broadcaster(TOPICS)
    async with serving(broadcaster) as session:
        async with session.ws_connect("/ws"):
            await connected(broadcaster, 1)
            assert broadcaster.wants("A")
        await connected(broadcaster, 0)
        assert not broadcaster.wants("A")
        broadcaster.publish_text("A", b"into the void")
        assert broadcaster.counters.messages == 0


async def test_a_new_client_is_greeted_with_the_latest():
    broadcaster = Broadcaster(TOPICS, greeting=lambda: [("status", b"latest")])
    async with serving(broadcaster) as session, session.ws_connect("/ws") as client:
        assert (await client.receive()).data == "latest"


@pytest.mark.parametrize(
    ("message", "text"),
    [
        ("{not json", "not JSON"),
        ("[1, 2]", "expected"),
        ('{"subscribe": "status"}', "expected"),
        ('{"subscribe": [1]}', "expected"),
        ('{"subscribe": ["nonsense"]}', "no such topic: nonsense"),
    ],
)
async def test_a_bad_message_is_answered_and_the_connection_lives_on(message, text):
    broadcaster = Broadcaster(TOPICS)
    async with serving(broadcaster) as session, session.ws_connect("/ws") as client:
        await client.send_str(message)
        assert text in json.loads((await client.receive()).data)["error"]
        await client.send_json({"subscribe": ["A"]})
        while broadcaster.wants("status") or not broadcaster.wants("A"):
            await asyncio.sleep(0)
        broadcaster.publish_text("A", b"still here")
        assert (await client.receive()).data == "still here"
        assert broadcaster.counters.bad_messages == 1


async def test_a_megabyte_from_a_client_closes_it_politely_and_only_it():
    broadcaster = Broadcaster(TOPICS)
    async with serving(broadcaster) as session, session.ws_connect("/ws") as good, session.ws_connect("/ws") as bad:
        await connected(broadcaster, 2)
        await bad.send_str("x" * 1_000_000)
        message = await bad.receive()
        assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        assert bad.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
        await connected(broadcaster, 1)
        broadcaster.publish_text("A", b"fine")
        assert (await good.receive()).data == "fine"


async def test_a_client_that_never_reads_costs_bounded_memory_and_delays_nobody():
    broadcaster = Broadcaster(TOPICS, queue_length=10, write_buffer_bytes=20_000)
    payload = bytes(10_000)
    async with serving(broadcaster) as session, session.ws_connect("/ws", max_msg_size=0) as good:
        raw = await stuck_client(session.port)
        await connected(broadcaster, 2)
        for number in range(500):
            broadcaster.publish_binary("A", number.to_bytes(4, "big") + payload)
            assert int.from_bytes((await good.receive()).data[:4], "big") == number
        stuck = next(client for client in broadcaster._clients if client.waiting)
        assert stuck.transport.get_write_buffer_size() <= 20_000 + len(payload) + 14
        assert len(stuck.waiting) == 10
        assert stuck.dropped > 300
        assert broadcaster.counters.dropped == stuck.dropped
        assert broadcaster.clients_behind == 1
        raw.close()


async def test_a_client_without_progress_is_cut_off():
    broadcaster = Broadcaster(TOPICS, queue_length=2, write_buffer_bytes=5_000, stall_s=0.1)
    async with serving(broadcaster) as session:
        raw = await stuck_client(session.port)
        await connected(broadcaster, 1)
        while not broadcaster.clients_behind:
            broadcaster.publish_binary("A", bytes(50_000))
        await asyncio.wait_for(connected(broadcaster, 0), PATIENCE_S)
        assert broadcaster.counters.clients_stalled == 1
        assert broadcaster.clients_behind == 0
        raw.close()


async def test_a_client_that_was_behind_gets_the_newest_messages_in_order():
    broadcaster = Broadcaster(TOPICS, queue_length=5, write_buffer_bytes=5_000)
    async with serving(broadcaster) as session:
        raw = await stuck_client(session.port)
        await connected(broadcaster, 1)
        count = 0
        while broadcaster.counters.dropped < 20:
            broadcaster.publish_binary("A", count.to_bytes(4, "big") * 2500)
            count += 1
        loop = asyncio.get_running_loop()
        received = bytearray()
        last = (count - 1).to_bytes(4, "big") * 2500
        while not received.endswith(last):
            received += await asyncio.wait_for(loop.sock_recv(raw, 65536), PATIENCE_S)
        frames = received[received.index(b"\r\n\r\n") + 4 :]
        numbers = [int.from_bytes(frames[at + 4 : at + 8], "big") for at in range(0, len(frames), 10_004)]
        assert numbers == sorted(set(numbers))
        assert numbers[-5:] == list(range(count - 5, count))
        assert len(numbers) == count - broadcaster.counters.dropped
        raw.close()


async def test_too_many_clients_are_told_so():
    broadcaster = Broadcaster(TOPICS, max_clients=1)
    async with serving(broadcaster) as session, session.ws_connect("/ws"):
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            await session.ws_connect("/ws")
        assert caught.value.status == 503
        assert broadcaster.counters.clients_refused == 1


async def test_closing_says_goodbye_to_readers_and_cuts_off_the_others():
    broadcaster = Broadcaster(TOPICS, queue_length=2, write_buffer_bytes=5_000)
    async with serving(broadcaster) as session, session.ws_connect("/ws", max_msg_size=0) as good:
        raw = await stuck_client(session.port)
        await connected(broadcaster, 2)
        while not broadcaster.clients_behind:
            broadcaster.publish_binary("A", bytes(50_000))
            await good.receive()
        await asyncio.wait_for(asyncio.gather(broadcaster.close(), good.receive()), PATIENCE_S)
        assert good.close_code == aiohttp.WSCloseCode.GOING_AWAY
        raw.close()
