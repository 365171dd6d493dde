import asyncio
import http.client
import json
from dataclasses import replace
from urllib.parse import quote

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from firmware_build import board_in_the_loop
from patience import PATIENCE_S
from running_system import diving

SERVICES = ("http", "viewer")
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "BREW")
HIDDEN = ("/", "/widget", "/docs", "/ws", "/internal/viewer-link", "/static/dashboard/main.js", "/api/settings/backup",
          "/api/recordings/active/export", "/api/recordings/active/files/session.json",
          "/static/../../pyproject.toml", "/api/recordings/..%2f..%2fsettings.json/export")  # fmt: skip
BRIEF = settings(max_examples=150, suppress_health_check=list(HealthCheck))

words = st.one_of(
    st.sampled_from(
        ["A", "both", "active", "session_20260101_000000", "..", "%2e%2e", "0", "-1", "NaN", "1e999", "null"]
    ),
    st.text(max_size=20),
)
values = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=30)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=8), inner, max_size=3)),
    max_leaves=6,
)
known_keys = st.sampled_from(
    ["action", "confirm", "name", "channel", "ping_number", "range_m", "samples", "period_ms", "frequency_khz", "title",
     "notes", "kind", "text", "time_unix_s", "decimation", "sensors_rate_hz", "version", "settings", "values",
     "http.port", "forwarding.targets", "display.theme", "mavlink.target_host", "sonar.a_position_frd_m"]
)  # fmt: skip
documents = st.dictionaries(st.one_of(known_keys, st.text(max_size=8)), values, max_size=4)
bodies = st.one_of(
    st.just(b""), st.binary(max_size=200), st.builds(lambda d: json.dumps(d).encode(), st.one_of(documents, values))
)
queries = st.dictionaries(st.one_of(st.sampled_from(["channel", "before", "after", "limit"]), words), words, max_size=3)


@pytest.fixture
async def dive(tmp_path):
    scenario = replace(SCENARIOS["survey"], samples=500, mission_start_s=60.0)
    async with diving(tmp_path, VirtualEsp32(scenario, board=board_in_the_loop(scenario))) as dive:
        await dive.state(lambda s: s["recorder"]["state"] == "recording")
        yield dive


class Caller:
    """One kept-alive connection that speaks HTTP with as little help as possible."""

    def __init__(self, port):
        self._port = port
        self._connection = None

    def call(self, method, path, query, body, headers):
        target = quote(path, safe="/%{}") + ("?" + "&".join(f"{quote(k)}={quote(v)}" for k, v in query.items()))
        for fresh in (False, True):
            if self._connection is None or fresh:
                self._connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=PATIENCE_S)
            try:
                self._connection.request(method, target, body=body, headers=headers)
                answer = self._connection.getresponse()
                answer.read()
            except (ConnectionError, http.client.HTTPException):
                if fresh:
                    raise
            else:
                return answer.status
        raise AssertionError("unreachable")


async def paths_of(dive, service):
    document = await dive.services.get("/openapi.json", service)
    return sorted(document["paths"])


async def what_must_stay(dive):
    """Everything that a call could change."""
    get = dive.services.get
    recordings = await get("/api/recordings")
    sonar = await get("/api/sonar", "viewer")
    return {
        "settings": (await get("/api/settings"))["settings"],
        "dives": [(r["name"], r["title"], r["notes"], r["annotations"]) for r in recordings["recordings"]],
        "active": recordings["active"],
        "contacts": (await get("/api/contacts", "viewer"))["contacts"],
        "asked": [sonar[channel]["asked"] for channel in "AB"],
        "read": [sonar[channel]["read"] for channel in "AB"],
    }


async def test_the_vehicles_scanner_gets_an_answer_with_an_end_from_every_documented_path(dive):
    for service in SERVICES:
        paths = await paths_of(dive, service)
        assert len(paths) > 5
        for path in paths:
            async with asyncio.timeout(PATIENCE_S):
                url, headers = dive.services.url(path, service), {"Connection": "Upgrade"}
                async with dive.services.client.get(url, headers=headers) as response:
                    await response.read()
                    assert response.status in (200, 400, 404, 405), (path, response.status)
    await dive.finish()


async def test_junk_without_an_origin_changes_nothing_and_never_fails(dive):
    await dive.services.until(
        "/api/sonar", lambda s: all(s[c]["last_result"] == "settings read" for c in "AB"), "viewer"
    )
    before = await what_must_stay(dive)
    for service in SERVICES:
        paths = [*await paths_of(dive, service), *HIDDEN]
        await asyncio.to_thread(throw_junk_without_origin, Caller(dive.services.ports[service]), paths)
    assert await what_must_stay(dive) == before
    await dive.finish()


def throw_junk_without_origin(caller, paths):
    @BRIEF
    @given(st.sampled_from(METHODS), st.sampled_from(paths), words, queries, bodies)
    def throw(method, path, word, query, body):
        status = caller.call(method, fill(path, word), query, body, {"Content-Type": "application/json"})
        assert status < 500
        if method in ("POST", "PUT", "PATCH", "DELETE"):
            assert status >= 400

    throw()


async def test_junk_from_a_page_of_the_vehicle_is_answered_and_never_fails(dive):
    for service in SERVICES:
        document = await dive.services.get("/openapi.json", service)
        calls = [(method, path) for path, item in document["paths"].items() for method in item if method != "get"]
        await asyncio.to_thread(throw_junk_from_a_page, Caller(dive.services.ports[service]), calls)
    seen = len(dive.sensors)
    await dive.until(lambda: len(dive.sensors) > seen, "sensors go on")
    await dive.finish()


def throw_junk_from_a_page(caller, calls):
    @BRIEF
    @given(st.sampled_from(calls), words, bodies)
    def throw(call, word, body):
        method, path = call
        headers = {"Content-Type": "application/json", "Origin": "http://127.0.0.1"}
        assert caller.call(method.upper(), fill(path, word), {}, body, headers) < 500

    throw()


async def test_what_is_no_http_at_all_disturbs_nobody(dive):
    ports = [dive.services.ports[name] for name in ("http", "viewer", "sensor_ws", "waterfall_ws")]

    async def throw(port, data):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        try:
            writer.write(data)
            writer.write_eof()
            answer = await asyncio.wait_for(reader.read(), PATIENCE_S)
        except ConnectionError:
            answer = b""
        finally:
            writer.close()
        assert b" 50" not in answer[:16]

    for data in (b"\0" * 1000, b"GET", b"\x16\x03\x01\x02\0\x01\0", b"GET / HTTP/9.9\r\n\r\n", b"A" * 100_000,
                 b"POST / HTTP/1.1\r\nContent-Length: -5\r\n\r\n", b"GET / HTTP/1.1\r\nHost: \xff\r\n\r\n",
                 b"POST /api/settings HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"):  # fmt: skip
        for port in ports:
            await throw(port, data)
    seen = len(dive.sensors)
    await dive.until(lambda: len(dive.sensors) > seen, "sensors go on")
    await dive.finish()


def fill(path, word):
    """A documented path with its placeholders filled."""
    for name in ("{name}", "{id}", "{file}", "{channel}"):
        path = path.replace(name, quote(word, safe="%."))
    return path
