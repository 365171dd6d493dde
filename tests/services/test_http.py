import asyncio
import json
from contextlib import asynccontextmanager

import aiohttp
import pytest
from aiohttp import web

from bluerov_slam.errors import CommandError, ExpectedError
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.http import (
    Route,
    ServicePage,
    WebServer,
    build_app,
    build_websocket_port_app,
    json_response,
    read_json_object,
)
from patience import PATIENCE_S

PAGE = ServicePage("Test Service", "for tests", "mdi-radar", "1.2.3", "dashboard")
# What BlueOS's ServiceMetadata demands; one wrong field loses the whole of it.
MANDATORY = ("name", "description", "icon", "company", "version", "webpage", "api")


async def answer(_request):
    return json_response({"ok": True})


async def echo(request):
    return json_response(await read_json_object(request))


async def refuse(_request):
    raise CommandError("the sonar did not answer; is it on?")


async def break_down(_request):
    raise ZeroDivisionError


ROUTES = (
    Route("GET", "/api/thing", answer, "A thing", cross_origin=True),
    Route("POST", "/api/thing", echo, "Change it", body={"type": "object"}),
    Route("DELETE", "/api/things/{name}", answer, "Remove it"),
    Route("GET", "/api/things/{name}/file", answer, "A download", documented=False),
    Route("GET", "/api/refused", refuse, "Fails as expected"),
    Route("GET", "/api/broken", break_down, "Fails by a bug"),
)


@pytest.fixture
def web_folder(tmp_path):
    for name, text in {
        "dashboard/index.html": "<title>Dashboard</title>",
        "dashboard/main.js": "export {};",
        "shared/x.js": "export {};",
        "test/secret.js": "no",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    (tmp_path / "vendor").mkdir()
    return tmp_path


@asynccontextmanager
async def serving(app, **options):
    server = WebServer(app, **options)
    await server.start("127.0.0.1", 0, "http.port")
    async with aiohttp.ClientSession(f"http://127.0.0.1:{server.port}") as session:
        session.server = server
        try:
            yield session
        finally:
            await session.close()
            await server.stop()


@pytest.fixture
async def client(web_folder):
    guard = ChangeGuard(lambda: ["http://trusted.example"], lambda: "s3cret")
    app = build_app(PAGE, ROUTES, guard=guard, metrics=lambda: b"frames_total 1\n", web_folder=web_folder)
    async with serving(app) as session:
        session.app = app
        yield session


async def fetch(client, method, path, **options):
    async with client.request(method, path, **options) as response:
        return response.status, await response.read(), response.headers


async def test_the_document_and_the_router_agree(client):
    _, body, _ = await fetch(client, "GET", "/openapi.json")
    documented = {(m.upper(), path) for path, item in json.loads(body)["paths"].items() for m in item}
    routed = {
        (route.method, route.resource.canonical)
        for route in client.app.router.routes()
        if route.resource is not None and route.method != "HEAD" and not route.resource.canonical.startswith("/static")
    }
    undocumented = {
        ("GET", p) for p in ("/", "/widget", "/docs", "/docs/start.js", "/openapi.json", "/api/things/{name}/file")
    }
    assert documented == routed - undocumented


async def test_every_documented_path_survives_the_scanners_bare_get(client):
    _, body, _ = await fetch(client, "GET", "/openapi.json")
    statuses = {}
    for path in json.loads(body)["paths"]:
        statuses[path], _, _ = await fetch(client, "GET", path, headers={"Connection": "Upgrade"})
    assert statuses.pop("/api/broken") == 500
    assert statuses.pop("/api/refused") == 409
    assert statuses.pop("/api/things/{name}") == 404  # braces are no name
    assert set(statuses.values()) == {200}


async def test_register_service_has_the_seven_strings_blueos_demands(client):
    _, body, headers = await fetch(client, "GET", "/register_service")
    data = json.loads(body)
    assert all(isinstance(data[key], str) for key in MANDATORY)
    assert data["works_in_relative_paths"] is True
    assert data["extras"] == {"cockpit": "/cockpit_extras.json"}
    assert headers["Access-Control-Allow-Origin"] == "*"


async def test_the_page_has_a_title_and_no_framing_ban(client):
    status, body, headers = await fetch(client, "GET", "/")
    assert (status, b"<title>Dashboard</title>" in body) == (200, True)
    assert "X-Frame-Options" not in headers
    assert "frame-ancestors" not in headers["Content-Security-Policy"]


async def test_docs_ask_nobody_outside(client):
    _, page, _ = await fetch(client, "GET", "/docs")
    _, script, _ = await fetch(client, "GET", "/docs/start.js")
    assert b"http" not in page
    assert b"swagger-ui" in page
    assert b"validatorUrl: null" in script


@pytest.mark.parametrize(
    "path",
    [
        "/static/test/secret.js",
        "/static/jsconfig.json",
        "/static/dashboard/../test/secret.js",
        "/static/dashboard/%2e%2e/test/secret.js",
        "/static/dashboard/..%2ftest%2fsecret.js",
    ],
)
async def test_only_the_pages_folders_are_served(client, path):
    from yarl import URL

    base = f"http://127.0.0.1:{client.server.port}"
    async with aiohttp.ClientSession() as session, session.get(URL(base + path, encoded=True)) as response:
        assert response.status in (403, 404)
        assert b"no" not in (await response.read()).split()


async def test_page_modules_are_served_where_the_source_tree_has_them(client):
    assert (await fetch(client, "GET", "/static/dashboard/main.js"))[0] == 200
    assert (await fetch(client, "GET", "/static/shared/x.js"))[0] == 200


async def test_errors_are_json_that_names_the_cure(client):
    status, body, _ = await fetch(client, "GET", "/api/refused")
    assert (status, json.loads(body)) == (409, {"error": "the sonar did not answer; is it on?"})
    status, body, _ = await fetch(client, "GET", "/nothing")
    assert (status, json.loads(body)) == (404, {"error": "/nothing: not found; /docs lists what there is"})
    status, body, headers = await fetch(client, "GET", "/api/things/x")
    assert (status, json.loads(body)["error"]) == (405, "/api/things/x does not take GET; use DELETE")
    assert headers["Allow"] == "DELETE"
    status, body, _ = await fetch(client, "GET", "/api/broken")
    assert status == 500
    assert "ZeroDivision" not in body.decode()


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://127.0.0.1:8100", 200),
        ("http://192.168.2.2", 200),
        ("http://[fe80::1]:8099", 200),
        ("http://blueos.local", 200),
        ("http://trusted.example", 200),
        ("http://evil.example", 403),
        ("http://blueos.local.evil.example", 403),
        ("http://trusted.example.evil", 403),
        ("null", 403),
        ("http://[broken", 403),
        ("", 403),
    ],
)
async def test_only_pages_of_the_vehicle_may_change_something(client, origin, status):
    result = await fetch(client, "POST", "/api/thing", json={"a": 1}, headers={"Origin": origin})
    assert result[0] == status


async def test_the_host_itself_may_change_something_by_its_name(client):
    headers = {"Origin": "http://my-vehicle:8099", "Host": "my-vehicle"}
    assert (await fetch(client, "POST", "/api/thing", json={}, headers=headers))[0] == 200


@pytest.mark.parametrize(
    ("authorization", "status"),
    [(None, 403), ("Bearer wrong", 403), ("Bearer s3cret", 200), ("Bearer ", 403)],
)
async def test_a_program_without_origin_needs_the_token(client, authorization, status):
    headers = {"Authorization": authorization} if authorization is not None else {}
    assert (await fetch(client, "POST", "/api/thing", json={}, headers=headers))[0] == status


async def test_a_token_that_is_no_text_is_refused_and_not_our_fault(client, caplog):
    reader, writer = await asyncio.open_connection("127.0.0.1", client.server.port)
    writer.write(
        b"POST /api/thing HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer \xff\xfe\r\nContent-Length: 2\r\n\r\n{}"
    )
    assert b" 403 " in await reader.readline()
    writer.close()
    assert not [record for record in caplog.records if record.exc_info]


def test_an_empty_token_lets_no_program_in():
    guard = ChangeGuard(lambda: [], lambda: "")
    assert guard.refusal(None, "x", "Bearer ") is not None


@pytest.mark.parametrize(
    ("body", "status", "text"),
    [
        (b"{not json", 400, "the body is not JSON"),
        (b"[1]", 400, "the body must be a JSON object, not list"),
        (b" " * (256 * 1024 + 1), 413, "the body exceeds 262144 bytes"),
    ],
)
async def test_a_bad_body_is_answered_with_the_reason(client, body, status, text):
    result = await fetch(client, "POST", "/api/thing", data=body, headers={"Origin": "http://127.0.0.1"})
    assert result[0] == status
    assert text in json.loads(result[1])["error"]


async def test_what_is_no_http_is_refused_without_a_traceback_in_the_log(client, caplog):
    reader, writer = await asyncio.open_connection("127.0.0.1", client.server.port)
    writer.write(b"GET / HTTP/9.9 and more\r\n\r\n")
    assert b" 400 " in await reader.readline()
    writer.close()
    async with client.get("/api/broken") as response:
        assert response.status == 500
    told = [record.getMessage() for record in caplog.records if record.exc_info]
    assert told == ["GET /api/broken failed"], "our own faults are told"


async def test_a_client_that_dribbles_its_header_is_cut_off_and_others_are_served(web_folder):
    app = build_app(PAGE, ROUTES, guard=ChangeGuard(lambda: [], lambda: ""), metrics=bytes, web_folder=web_folder)
    async with serving(app, header_timeout_s=0.1) as session:
        reader, writer = await asyncio.open_connection("127.0.0.1", session.server.port)
        writer.write(b"GET /api/thing HTTP/1.1\r\nHost: x\r\nX-Slow: ")
        await writer.drain()
        assert (await fetch(session, "GET", "/api/thing"))[0] == 200
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await asyncio.wait_for(reader.readexactly(1), PATIENCE_S)
        writer.close()
        assert session.server.refused == 1
        assert (await fetch(session, "GET", "/api/thing"))[0] == 200


async def test_connections_beyond_the_limit_are_closed_at_once(web_folder):
    app = build_app(PAGE, ROUTES, guard=ChangeGuard(lambda: [], lambda: ""), metrics=bytes, web_folder=web_folder)
    async with serving(app, max_connections=1) as session:
        assert (await fetch(session, "GET", "/api/thing"))[0] == 200  # stays open, keep-alive
        reader, writer = await asyncio.open_connection("127.0.0.1", session.server.port)
        assert await asyncio.wait_for(reader.read(), PATIENCE_S) == b""
        writer.close()


async def test_a_taken_port_is_one_clear_line(client, web_folder):
    second = WebServer(web.Application())
    with pytest.raises(ExpectedError) as caught:
        await second.start("127.0.0.1", client.server.port, "http.port")
    text = str(caught.value)
    assert "\n" not in text
    assert f"127.0.0.1:{client.server.port} (http.port): Address already in use" in text
    assert "is another BlueROV SLAM running?" in text


async def test_a_websocket_port_answers_the_scanner_quietly():
    async def socket(request):
        ws = web.WebSocketResponse()
        await ws.prepare(request)
        await ws.send_str("hello")
        await ws.close()
        return ws

    async with serving(build_websocket_port_app("Sensor data", socket)) as session:
        status, body, _ = await fetch(session, "GET", "/", headers={"Connection": "Upgrade"})
        assert status == 200
        assert b"<title>Sensor data</title>" in body
        assert (await fetch(session, "GET", "/register_service"))[0] == 404
        async with session.ws_connect("/") as ws:
            assert (await ws.receive()).data == "hello"
