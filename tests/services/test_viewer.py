import asyncio
import base64
import json
import math
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import aiohttp
import numpy as np
import pytest

from bluerov_slam.config import Layer, Settings, combine
from bluerov_slam.errors import ExpectedError
from bluerov_slam.protocol.kogger import build_frame
from bluerov_slam.protocol.waterfall_frame import unpack_ping
from bluerov_slam.records import Channel
from bluerov_slam.services.viewer import ViewerService
from bluerov_slam.services.viewer_track import MOST_STATES, VehicleTrack
from patience import PATIENCE_S

LOOPBACK = {"Origin": "http://127.0.0.1"}


def settings(state: Path, **more: object) -> Settings:
    values: dict[str, object] = {
        "http.host": "127.0.0.1",
        "http.port": 1,  # nobody listens there: the extension is down
        "viewer.port": 0,
        "viewer.waterfall_ws_port": 0,
        "viewer.udp_port_a": 0,
        "viewer.udp_port_b": 0,
        "viewer.history_mb": 8,
        "paths.state": str(state),
    }
    return combine([Layer("test", values | more)])


@pytest.fixture
async def viewer(tmp_path: Path) -> AsyncIterator[ViewerService]:
    service = ViewerService(settings(tmp_path))
    await service.start()
    yield service
    await service.stop()


@pytest.fixture
async def http() -> AsyncIterator[aiohttp.ClientSession]:
    async with aiohttp.ClientSession() as session:
        yield session


class Extension:
    """Sends sonar frames as the extension does."""

    def __init__(self, viewer: ViewerService) -> None:
        self._viewer = viewer
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))

    def ping(self, channel: Channel, samples: np.ndarray, resolution_mm: int = 20) -> None:
        frames = [
            build_frame(
                3,
                start.to_bytes(2, "little")
                + resolution_mm.to_bytes(2, "little")
                + b"\0\0"
                + samples[start : start + 200].tobytes(),
                route=channel.index + 1,
                mark=True,
            )
            for start in range(0, samples.size, 200)
        ]
        address = ("127.0.0.1", self._viewer.udp[channel].port)
        for first in range(0, len(frames), 6):
            self._socket.sendto(b"".join(frames[first : first + 6]), address)


def samples(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, count, dtype=np.uint8)


def url(viewer: ViewerService, path: str) -> str:
    return f"http://127.0.0.1:{viewer.http.port}{path}"


async def next_ping(socket: aiohttp.ClientWebSocketResponse):
    while True:
        message = await socket.receive(timeout=PATIENCE_S)
        assert message.type in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT), message
        if message.type is aiohttp.WSMsgType.BINARY:
            return unpack_ping(message.data)


async def test_pings_come_out_whole_on_both_websockets_and_in_the_history(viewer, http) -> None:
    extension = Extension(viewer)
    async with (
        http.ws_connect(url(viewer, "/ws")) as pings,
        http.ws_connect(f"http://127.0.0.1:{viewer.waterfall_http.port}/") as waterfall,
    ):
        await pings.send_json({"subscribe": ["A", "B"]})
        sent = [samples(1000, index) for index in range(5)]
        for index, ping in enumerate(sent):
            extension.ping(Channel.A if index % 2 == 0 else Channel.B, ping)
        extension.ping(Channel.A, samples(1000, 99))
        extension.ping(Channel.B, samples(1000, 99))
        received = [await next_ping(pings) for _ in sent]
        for channel, wanted in ((Channel.A, sent[::2]), (Channel.B, sent[1::2])):
            got = [r.ping for r in received if r.ping.channel is channel]
            assert [ping.samples.tobytes() for ping in got] == [ping.tobytes() for ping in wanted]
            assert [ping.number for ping in got] == list(range(1, len(wanted) + 1))
            assert all(ping.resolution_m == 0.02 and not ping.gaps for ping in got)
        text = json.loads((await waterfall.receive(timeout=PATIENCE_S)).data)
        assert set(text) == {"ch", "amp", "n"}
        assert len(base64.b64decode(text["amp"])) == 200
    async with http.get(url(viewer, "/api/history?channel=A&before=4&limit=2")) as answer:
        body = await answer.read()
        assert answer.headers["X-First-Ping"] == "1"
        assert answer.headers["X-Last-Ping"] in (
            "3",
            "4",
        )  # three alike taught the count: the fourth may be out already
    length = int.from_bytes(body[:4], "little")
    assert unpack_ping(body[4 : 4 + length]).ping.samples.tobytes() == sent[2].tobytes()
    assert unpack_ping(body[8 + length :]).ping.number == 3


async def test_the_original_systems_keys_are_served(viewer, http) -> None:
    extension = Extension(viewer)
    async with http.ws_connect(url(viewer, "/ws")) as pings:
        for seed in range(3):
            extension.ping(Channel.A, samples(400, seed))
        await next_ping(pings)
        await next_ping(pings)
    async with asyncio.timeout(PATIENCE_S):
        health = {}
        while health.get("a_packets") != 3:  # the last one is not needed for the two pings above
            async with http.get(url(viewer, "/health")) as answer:
                health = await answer.json()
    assert health == {
        "status": "healthy",
        "a_packets": 3, "a_bytes": 3 * 2 * 214, "a_bb55": 6, "a_pings": health["a_pings"],
        "b_packets": 0, "b_bytes": 0, "b_bb55": 0, "b_pings": 0,
    }  # fmt: skip
    async with http.get(url(viewer, "/api/status")) as answer:
        status = await answer.json()
    assert {key: status[key] for key in health if key != "status"} == {k: v for k, v in health.items() if k != "status"}
    assert status["extension_link"] is False
    assert "waiting for the extension" in status["link_message"]


async def test_blueos_finds_a_service_with_its_own_name_and_every_path_answers(viewer, http) -> None:
    async with http.get(url(viewer, "/register_service")) as answer:
        service = await answer.json()
    assert service["works_in_relative_paths"] is True
    assert "".join(c for c in service["name"].lower() if c.isalnum()) == "bluerovslamsonarviewer"
    async with http.get(url(viewer, "/openapi.json")) as answer:
        paths = (await answer.json())["paths"]
    assert {"/api/sonar/{channel}", "/api/history", "/health"} <= paths.keys()
    for path in paths:
        async with http.get(url(viewer, path)) as answer:
            assert answer.status < 500, path
            await answer.read()
    async with http.get(url(viewer, "/metrics")) as answer:
        assert 'bluerov_slam_viewer_pings_total{channel="A"} 0.0' in await answer.text()


async def test_settings_without_the_extension_are_refused_with_the_cure(viewer, http) -> None:
    async with http.post(url(viewer, "/api/sonar/A"), json={"range_m": 20}, headers=LOOPBACK) as answer:
        assert answer.status == 409
        assert "no link to the extension" in (await answer.json())["error"]
    async with http.post(url(viewer, "/api/sonar/both"), json={"range_m": 2000}, headers=LOOPBACK) as answer:
        assert answer.status == 400
        assert "range_m 2000: expected 0.1 to 200 m" in (await answer.json())["error"]
    async with http.post(url(viewer, "/api/sonar/C"), json={}, headers=LOOPBACK) as answer:
        assert answer.status == 404
    async with http.post(
        url(viewer, "/api/sonar/A"), json={"range_m": 20}, headers={"Origin": "http://evil.example"}
    ) as answer:
        assert answer.status == 403


async def test_history_refuses_nonsense(viewer, http) -> None:
    for query in ("channel=X", "before=-1", "limit=abc", "after=1e3"):
        async with http.get(url(viewer, f"/api/history?{query}")) as answer:
            assert answer.status in (400, 404), query
    async with http.get(url(viewer, "/api/history?channel=B")) as answer:
        assert (answer.status, await answer.read()) == (200, b"")


async def test_contacts_survive_without_extension_and_restart(viewer, http, tmp_path) -> None:
    contact = {"name": "wreck", "channel": "A", "ping_number": 12, "range_m": 7.5}
    async with http.post(url(viewer, "/api/contacts"), json=contact, headers=LOOPBACK) as answer:
        assert answer.status == 201
        made = await answer.json()
    assert made["pending"] is True
    async with http.patch(
        url(viewer, f"/api/contacts/{made['id']}"), json={"note": "iron"}, headers=LOOPBACK
    ) as answer:
        assert (await answer.json())["note"] == "iron"
    await viewer.stop()
    again = ViewerService(settings(tmp_path))
    assert [(c["name"], c["note"]) for c in again.contacts.all()] == [("wreck", "iron")]
    again.outlets.history.close()


async def test_a_second_viewer_on_the_same_ports_says_so(viewer, tmp_path) -> None:
    second = ViewerService(settings(tmp_path, **{"viewer.udp_port_a": viewer.udp[Channel.A].port}))
    with pytest.raises(ExpectedError, match=r"\(viewer.udp_port_a\) is in use"):
        await second.start()
    third = ViewerService(settings(tmp_path, **{"viewer.port": viewer.http.port}))
    with pytest.raises(ExpectedError, match=r"viewer\.port"):
        await third.start()


async def test_a_part_that_fails_is_started_again(viewer, http, monkeypatch) -> None:
    monkeypatch.setattr("bluerov_slam.services.viewer.RESTART_PAUSE_S", 0.0)
    calls = 0
    flush = viewer.channels[Channel.A].flush

    def fails_once() -> None:
        nonlocal calls
        calls += 1
        if calls == 1:
            raise RuntimeError("broken")
        flush()

    viewer.channels[Channel.A].flush = fails_once
    async with asyncio.timeout(PATIENCE_S):
        while calls < 3:
            await asyncio.sleep(0.01)


async def test_random_datagrams_harm_nothing_and_nothing_of_them_is_shown(viewer, http) -> None:
    noise = np.random.default_rng(7)
    good = build_frame(3, bytes(206), route=1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for index in range(600):
            data = bytearray(good if index % 2 else noise.bytes(int(noise.integers(0, 3000))))
            if index % 2:
                data[int(noise.integers(2, len(data)))] ^= int(noise.integers(1, 256))
            stranger.sendto(data, ("127.0.0.1", viewer.udp[Channel.A].port))
            if index % 50 == 0:
                await asyncio.sleep(0)
    extension = Extension(viewer)
    async with http.ws_connect(url(viewer, "/ws")) as pings:
        for seed in range(2):
            extension.ping(Channel.B, samples(400, seed))
        assert (await next_ping(pings)).ping.samples.tobytes() == samples(400, 0).tobytes()
    async with http.get(url(viewer, "/api/status")) as answer:
        status = await answer.json()
    assert (status["a_bb55"], status["a_pings"], status["peers"]) == (0, 0, [])


async def test_where_the_vehicle_was_is_not_told_as_where_it_is(viewer, monkeypatch) -> None:
    clock = [100.0]
    monkeypatch.setattr(viewer.desk, "_now_s", lambda: clock[0])
    viewer.link.listener.on_message("vehicle", {"type": "vehicle", "depth_m": 8.5, "sound_speed_mps": 1502.0})
    clock[0] += 2.0
    viewer.desk.forget_old_vehicle()
    assert viewer.desk.greeting()["vehicle"] == {"depth_m": 8.5, "sound_speed_mps": 1502.0}
    assert viewer.forwarder.state()["sound_speed_ctd_mps"] == 1502.0
    clock[0] += 2.0
    viewer.desk.forget_old_vehicle()
    assert viewer.desk.greeting()["vehicle"] == {"depth_m": None, "sound_speed_mps": None}
    assert viewer.forwarder.state()["sound_speed_ctd_mps"] is None


async def test_where_the_vehicle_was_is_remembered_for_pages_that_open_later(viewer, http) -> None:
    extension = Extension(viewer)
    async with http.ws_connect(url(viewer, "/ws")) as page:
        times = []
        for number, north in enumerate((47.6, 47.7)):
            extension.ping(Channel.A, samples(400, number))
            times.append((await next_ping(page)).ping.measured_s)
            estimate = {"latitude_deg": north, "longitude_deg": -2.7, "within_m": 3.5, "heading_deg": None}
            vehicle = {"depth_m": 8.5, "heading_deg": 40.0, "latitude_deg": None, "estimate": estimate}
            viewer.link.listener.on_message("vehicle", {"type": "vehicle", **vehicle})
            viewer.link.listener.on_message("vehicle", {"type": "vehicle", "depth_m": 99.0})  # by no ping of its own
    async with http.get(url(viewer, "/api/track")) as response:
        track = await response.json()
    states = [dict(zip(track["columns"], state, strict=True)) for state in track["states"]]
    assert [state["monotonic_s"] for state in states] == times
    assert [state["estimate.latitude_deg"] for state in states] == [47.6, 47.7]
    assert (states[0]["depth_m"], states[0]["latitude_deg"], states[0]["estimate.heading_deg"]) == (8.5, None, None)


def test_another_run_of_the_clock_begins_another_track() -> None:
    track = VehicleTrack()
    for at_s in (1000.0, 1000.5, 1000.2, 3.0, 3.5):
        track.add(at_s, {"depth_m": at_s})
    track.add(math.nan, {"depth_m": 1.0})
    assert track.states()[:, 0].tolist() == [3.0, 3.5]
    for step in range(MOST_STATES + 10):
        track.add(4.0 + 0.5 * step, {})
    assert MOST_STATES * 0.8 < len(track.states()) <= MOST_STATES
    assert np.isnan(track.states()[-1, 1:]).all()
