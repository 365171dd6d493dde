"""The web server both services share: one route table, pages, description for BlueOS, errors as JSON, listening."""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import orjson
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from bluerov_slam.errors import CommandError, ConfigError, ExpectedError, RecordingError
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.openapi import DOCS_PAGE, DOCS_SCRIPT, openapi_document

_log = logging.getLogger(__name__)

Handler: TypeAlias = Callable[[web.Request], Awaitable[web.StreamResponse]]
JsonObject: TypeAlias = dict[str, Any]

BODY_LIMIT_BYTES: Final = 256 * 1024
BODY_TIMEOUT_S: Final = 10.0
# A client that has not finished its first request header by then is cut off (slow-loris).
HEADER_TIMEOUT_S: Final = 10.0
KEEP_ALIVE_S: Final = 30.0
MAX_CONNECTIONS: Final = 600
STOP_TIMEOUT_S: Final = 1.0
PAGE_FOLDERS: Final = ("dashboard", "viewer", "rig", "shared", "vendor")
# No inline script and nothing from outside; pages may talk to the other service's port. No frame-ancestors: BlueOS and
# Cockpit show the pages in an iframe.
CONTENT_POLICY: Final = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' http: https: ws: wss: blob:; worker-src 'self' blob:; object-src 'none'; base-uri 'none'"
)
_STATUS_OF_ERROR: Final = ((ConfigError, 400), (RecordingError, 409), (CommandError, 409), (ExpectedError, 400))
_CHANGING: Final = frozenset({"POST", "PUT", "PATCH", "DELETE"})


@dataclass(frozen=True, slots=True)
class Route:
    """One row of a service's route table. The OpenAPI document and the router are both made from it.

    `documented`: false for streams, downloads and WebSockets, because BlueOS's scanner GETs every documented path.
    `cross_origin`: pages of other origins may read the answer. `body`: JSON schema of the request body.
    """

    method: str
    path: str
    handler: Handler
    summary: str
    documented: bool = True
    cross_origin: bool = False
    body: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class ServicePage:
    """Who the service is: what BlueOS and Cockpit are told, and where its page lies under web/."""

    name: str
    description: str
    icon: str
    version: str
    folder: str
    widgets: tuple[JsonObject, ...] = ()


def build_app(
    page: ServicePage,
    routes: Sequence[Route],
    *,
    guard: ChangeGuard,
    metrics: Callable[[], bytes],
    web_folder: Path | None = None,
) -> web.Application:
    """The application of one service: its own routes, and the pages and descriptions that both services have."""
    folder = web_folder or find_web_folder()
    table = [*routes, *_common_routes(page, metrics, folder)]
    document = openapi_document(page.name, page.description, page.version, table)
    table.append(Route("GET", "/openapi.json", _fixed_json(document), "This document", documented=False))
    cross_origin = frozenset(route.path for route in table if route.cross_origin)
    app = web.Application(middlewares=[_errors_as_json, _guarded(guard)], client_max_size=BODY_LIMIT_BYTES)
    for route in table:
        app.router.add_route(route.method, route.path, route.handler)
        if route.method == "GET":
            app.router.add_route("HEAD", route.path, route.handler)
    for name in PAGE_FOLDERS:
        if (folder / name).is_dir():
            app.router.add_static(f"/static/{name}/", folder / name)
        elif name in (page.folder, "shared", "vendor"):
            _log.warning("%s is missing: the page will not be complete; run `make run` in a checkout", folder / name)
    app.on_response_prepare.append(_headers(cross_origin))
    return app


def build_websocket_port_app(title: str, handler: Handler) -> web.Application:
    """The application of a port that speaks WebSocket at `/`; BlueOS's scanner gets a small page there."""
    body = f"<!doctype html><title>{title}</title><p>{title}: connect with a WebSocket.</p>".encode()

    async def root(request: web.Request) -> web.StreamResponse:
        if wants_websocket(request):
            return await handler(request)
        return web.Response(body=body, content_type="text/html")

    app = web.Application(middlewares=[_errors_as_json], client_max_size=BODY_LIMIT_BYTES)
    app.router.add_get("/", root)
    return app


def wants_websocket(request: web.Request) -> bool:
    """True for a real upgrade; BlueOS's nginx puts `Connection: Upgrade` on every request."""
    return request.headers.get("Upgrade", "").lower() == "websocket"


def find_web_folder() -> Path:
    """The folder of the pages: inside the installed package, or at the root of a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "web"
    return installed if installed.is_dir() else package.parents[1] / "web"


def json_response(data: object, status: int = 200, headers: Mapping[str, str] | None = None) -> web.Response:
    """JSON by orjson (NaN becomes null)."""
    body = orjson.dumps(data, option=orjson.OPT_SERIALIZE_NUMPY)
    return web.Response(body=body, status=status, content_type="application/json", headers=headers)


def error_response(status: int, text: str) -> web.Response:
    """`{"error": text}`: what happened and how to cure it."""
    return json_response({"error": text}, status)


async def read_json_object(request: web.Request, limit_bytes: int = BODY_LIMIT_BYTES) -> JsonObject:
    """The request body as a JSON object. Raises HTTP errors with a readable text otherwise, also when it dawdles."""
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_TIMEOUT_S):
            async for chunk in request.content.iter_chunked(65536):
                body += chunk
                if len(body) > limit_bytes:
                    raise web.HTTPRequestEntityTooLarge(
                        max_size=limit_bytes, actual_size=len(body), text=f"the body exceeds {limit_bytes} bytes"
                    )
    except TimeoutError as error:
        raise web.HTTPRequestTimeout(text=f"the body did not arrive within {BODY_TIMEOUT_S:g} s") from error
    try:
        data = orjson.loads(body)
    except orjson.JSONDecodeError as error:
        raise web.HTTPBadRequest(text=f"the body is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise web.HTTPBadRequest(text=f"the body must be a JSON object, not {type(data).__name__}")
    return data


class WebServer:
    """One listening TCP port for an application; refuses slow-loris clients and more than `max_connections`."""

    def __init__(
        self,
        app: web.Application,
        *,
        header_timeout_s: float = HEADER_TIMEOUT_S,
        max_connections: int = MAX_CONNECTIONS,
    ) -> None:
        self.refused = 0
        self.port = 0
        self._header_timeout_s = header_timeout_s
        self._max_connections = max_connections
        self._silent: set[object] = set()  # connections that have not sent a whole request yet
        app.middlewares.insert(0, self._mark)
        self._runner = web.AppRunner(
            app,
            logger=_server_log(),
            access_log=None,
            handle_signals=False,
            keepalive_timeout=KEEP_ALIVE_S,
            shutdown_timeout=STOP_TIMEOUT_S,
        )
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int, setting: str) -> None:
        """Listen. Raises ExpectedError naming the setting when the port is taken or the address is not ours."""
        await self._runner.setup()
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(self._protocol, host, port, backlog=128)
        except OSError as error:
            await self._runner.cleanup()
            cause = os.strerror(error.errno) if error.errno else str(error)
            raise ExpectedError(
                f"cannot listen on {host}:{port} ({setting}): {cause}; "
                "is another BlueROV SLAM running? Stop it, or choose another port"
            ) from error
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Stop listening and end every connection."""
        if self._server is not None:
            self._server.close()
            self._server = None
        await self._runner.cleanup()

    def _protocol(self) -> asyncio.Protocol:
        server = self._runner.server
        assert server is not None
        if len(server.connections) >= self._max_connections:
            self.refused += 1
            return _Refusal()
        protocol = server()
        self._silent.add(protocol)
        asyncio.get_running_loop().call_later(self._header_timeout_s, self._cut_off_if_silent, protocol)
        return protocol

    def _cut_off_if_silent(self, protocol: web.RequestHandler) -> None:
        if protocol not in self._silent:
            return
        self._silent.discard(protocol)
        if protocol.transport is not None:
            self.refused += 1
            protocol.transport.abort()

    @web.middleware
    async def _mark(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        self._silent.discard(request.protocol)
        return await handler(request)


class _OurFaultsOnly(logging.Filter):
    """Without the tracebacks of what is no HTTP: it was answered with 400, and anybody can send a flood of it."""

    def filter(self, record: logging.LogRecord) -> bool:
        return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))


def _server_log() -> logging.Logger:
    log = logging.getLogger(f"{__name__}.server")
    if not log.filters:
        log.addFilter(_OurFaultsOnly())
    return log


class _Refusal(asyncio.Protocol):
    """Closes at once: the server has as many connections as it serves."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()


def _common_routes(page: ServicePage, metrics: Callable[[], bytes], folder: Path) -> list[Route]:
    registration = {
        "name": page.name,
        "description": page.description,
        "icon": page.icon,
        "company": "BlueROV SLAM",
        "version": page.version,
        "webpage": "",
        "api": "/docs",
        "works_in_relative_paths": True,
        "new_page": False,
        "extras": {"cockpit": "/cockpit_extras.json"},
    }
    extras = {"targetSystem": "Cockpit", "targetCockpitApiVersion": "1.0.0", "widgets": list(page.widgets)}

    async def serve_metrics(_request: web.Request) -> web.Response:
        return web.Response(body=metrics(), headers={"Content-Type": "text/plain; version=0.0.4; charset=utf-8"})

    return [
        Route("GET", "/", _page(folder / page.folder / "index.html", page.name), "The page", documented=False),
        Route("GET", "/widget", _page(folder / page.folder / "widget.html", page.name), "The widget", documented=False),
        Route("GET", "/docs", _fixed(DOCS_PAGE.encode(), "text/html"), "This API, readable", documented=False),
        Route("GET", "/docs/start.js", _fixed(DOCS_SCRIPT, "text/javascript"), "Script of /docs", documented=False),
        Route("GET", "/register_service", _fixed_json(registration), "What BlueOS shows", cross_origin=True),
        Route("GET", "/cockpit_extras.json", _fixed_json(extras), "What Cockpit is offered", cross_origin=True),
        Route("GET", "/metrics", serve_metrics, "Counters for Prometheus"),
    ]


def _page(path: Path, title: str) -> Handler:
    if not path.is_file():
        text = f"<!doctype html><title>{title}</title><p>The page's files are missing ({path.name}).</p>"
        return _fixed(text.encode(), "text/html")

    async def serve_page(_request: web.Request) -> web.StreamResponse:
        return web.FileResponse(path)

    return serve_page


def _fixed(body: bytes, content_type: str) -> Handler:
    async def serve_fixed(_request: web.Request) -> web.StreamResponse:
        return web.Response(body=body, content_type=content_type, charset="utf-8")

    return serve_fixed


def _fixed_json(data: object) -> Handler:
    return _fixed(json.dumps(data).encode(), "application/json")


def _headers(cross_origin: Collection[str]) -> Callable[[web.Request, web.StreamResponse], Awaitable[None]]:
    async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
        headers = response.headers
        headers.setdefault("X-Content-Type-Options", "nosniff")
        headers.setdefault("Cache-Control", "no-cache")
        if request.path in cross_origin:
            headers["Access-Control-Allow-Origin"] = "*"
        if response.content_type == "text/html":
            headers.setdefault("Content-Security-Policy", CONTENT_POLICY)

    return add_headers


def _guarded(guard: ChangeGuard) -> Any:
    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        if request.method in _CHANGING:
            refusal = guard.refusal(
                request.headers.get("Origin"), request.headers.get("Host"), request.headers.get("Authorization")
            )
            if refusal:
                return error_response(403, refusal)
        return await handler(request)

    return check


@web.middleware
async def _errors_as_json(request: web.Request, handler: Handler) -> web.StreamResponse:
    try:
        return await handler(request)
    except web.HTTPException as error:
        if error.status < 400:
            raise
        response = error_response(error.status, _readable(request, error))
        if "Allow" in error.headers:
            response.headers["Allow"] = error.headers["Allow"]
        return response
    except ExpectedError as error:
        status = next(code for kind, code in _STATUS_OF_ERROR if isinstance(error, kind))
        return error_response(status, str(error))
    except Exception:  # a fault of ours must not end the connection without an answer
        _log.exception("%s %s failed", request.method, request.path)
        return error_response(500, "an error of this service; its log has the details, please report them")


def _readable(request: web.Request, error: web.HTTPException) -> str:
    if error.status == 404 and (error.text or "").startswith("404"):
        return f"{request.path}: not found; /docs lists what there is"
    if error.status == 405:
        return f"{request.path} does not take {request.method}; use {_allowed(error.headers.get('Allow', ''))}"
    return error.text or error.reason


def _allowed(header: str) -> str:
    methods: Iterable[str] = (part.strip() for part in header.split(","))
    return " or ".join(method for method in methods if method != "HEAD")
