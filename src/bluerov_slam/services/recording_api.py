"""The recordings calls of the extension's HTTP API (docs/interfaces.md section 2)."""

from __future__ import annotations

import asyncio
import logging

from aiohttp import web

from bluerov_slam.errors import RecordingError
from bluerov_slam.services.http import Handler, Route, json_response, read_json_object
from bluerov_slam.services.recordings import RecordingStore, UnknownRecordingError
from bluerov_slam.sinks.mcap_recorder import Recorder

_log = logging.getLogger(__name__)

# The recorder acts within a fifth of a second; a slow disk may take longer to close a file.
_SETTLE_S = 5.0
# Each export holds a worker thread and a block of memory.
_EXPORTS_AT_ONCE = 3


def recording_routes(store: RecordingStore, recorder: Recorder | None) -> tuple[Route, ...]:
    """`recorder` None: a replay, in which nothing can be recorded."""
    api = _RecordingApi(store, recorder)
    dive = "/api/recordings/{name}"
    return (
        Route("GET", "/api/recordings", _answering(api.overview), "Every recorded dive, and the space left"),
        Route("GET", dive, _answering(api.details), "One dive", documented=False),
        Route(
            "POST", "/api/recording", _answering(api.control), "Start or stop recording",
            body={"type": "object", "properties": {"action": {"enum": ["start", "stop"]}}, "required": ["action"]},
        ),
        Route(
            "PATCH", dive, _answering(api.rename), "Name a dive and keep notes with it",
            body={"type": "object", "properties": {"title": {"type": "string"}, "notes": {"type": "string"}}},
        ),
        Route(
            "POST", dive + "/annotations", _answering(api.annotate), "Keep a note or a contact with a dive",
            body={"type": "object", "properties": {"kind": {"enum": ["note", "contact"]}, "text": {"type": "string"}}},
        ),
        Route("DELETE", dive, _answering(api.delete), "Delete a dive; needs the header X-Confirm: <name>"),
        Route("GET", dive + "/files/{file}", _answering(api.download), "One file of a dive", documented=False),
        Route("GET", dive + "/export", _answering(api.export), "A whole dive as one zip", documented=False),
    )  # fmt: skip


class _RecordingApi:
    def __init__(self, store: RecordingStore, recorder: Recorder | None) -> None:
        self._store = store
        self._recorder = recorder
        self._exports = 0

    async def overview(self, _request: web.Request) -> web.StreamResponse:
        return json_response(await asyncio.to_thread(self._store.overview))

    async def details(self, request: web.Request) -> web.StreamResponse:
        return json_response(await asyncio.to_thread(self._store.details, _name(request)))

    async def control(self, request: web.Request) -> web.StreamResponse:
        action = (await read_json_object(request)).get("action")
        recorder = self._recorder
        if action not in ("start", "stop"):
            raise web.HTTPBadRequest(text=f"action: {action!r}, expected 'start' or 'stop'")
        if recorder is None:
            raise RecordingError("this is a replay: there is no link to record")
        (recorder.request_start if action == "start" else recorder.request_stop)()
        await asyncio.to_thread(recorder.settle, _SETTLE_S)
        facts = recorder.facts()
        return json_response({"state": facts.state, "name": recorder.active_name, "error": facts.error})

    async def rename(self, request: web.Request) -> web.StreamResponse:
        changes = await read_json_object(request)
        return json_response(await asyncio.to_thread(self._store.rename, _name(request), changes))

    async def annotate(self, request: web.Request) -> web.StreamResponse:
        given = await read_json_object(request)
        return json_response(await asyncio.to_thread(self._store.add_annotation, _name(request), given), status=201)

    async def delete(self, request: web.Request) -> web.StreamResponse:
        name = _name(request)
        if request.headers.get("X-Confirm") != name:
            raise web.HTTPBadRequest(text=f"deleting cannot be undone: repeat it with the header X-Confirm: {name}")
        await asyncio.to_thread(self._store.delete, name)
        return json_response({"deleted": name})

    async def download(self, request: web.Request) -> web.StreamResponse:
        path = await asyncio.to_thread(self._store.file, _name(request), request.match_info["file"])
        return web.FileResponse(
            path,
            headers={
                "Content-Disposition": f'attachment; filename="{path.name}"',
                "Content-Type": "application/octet-stream",
            },
        )

    async def export(self, request: web.Request) -> web.StreamResponse:
        if self._exports >= _EXPORTS_AT_ONCE:
            raise web.HTTPServiceUnavailable(text=f"{_EXPORTS_AT_ONCE} exports are running: wait until one has ended")
        folder = await asyncio.to_thread(self._store.session_folder, _name(request))
        response = web.StreamResponse(
            headers={
                "Content-Type": "application/zip",
                "Content-Disposition": f'attachment; filename="{folder.name}.zip"',
            }
        )
        await response.prepare(request)
        if request.method == "HEAD":
            return response
        self._exports += 1
        try:
            blocks = self._store.export(folder.name)
            while block := await asyncio.to_thread(next, blocks, b""):
                await response.write(block)
        except (OSError, RecordingError) as error:
            # The answer is on its way already: a connection that breaks off is the only way left to say it.
            _log.warning("export of %s broke off: %s", folder.name, error)
            if request.transport is not None:
                request.transport.abort()
            return response
        finally:
            self._exports -= 1
        await response.write_eof()
        return response


def _name(request: web.Request) -> str:
    return request.match_info["name"]


def _answering(handler: Handler) -> Handler:
    """Errors of the store as answers; the rest is the server's business."""

    async def answer(request: web.Request) -> web.StreamResponse:
        try:
            return await handler(request)
        except UnknownRecordingError as error:
            raise web.HTTPNotFound(text=str(error)) from error
        except ConnectionError:
            raise
        except OSError as error:
            text = f"the recordings folder refuses this: {error.strerror or error}; free space or check its permissions"
            raise web.HTTPInternalServerError(text=text) from error

    return answer
