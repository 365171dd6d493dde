"""HTTP of acoustic positioning: the state and the newest raw record."""

from __future__ import annotations

from aiohttp import web

from bluerov_slam.services.acoustics_service import AcousticsService
from bluerov_slam.services.http import Route, error_response, json_response


class AcousticsApi:
    """Handlers over the running service."""

    def __init__(self, acoustics: AcousticsService) -> None:
        self._acoustics = acoustics

    def routes(self) -> list[Route]:
        """The route table."""
        return [
            Route("GET", "/api/acoustics", self.state, "Direction and distance of the transmitter", cross_origin=True),
            Route("GET", "/api/acoustics/record", self.record, "The newest raw record of the array"),
        ]

    async def state(self, _request: web.Request) -> web.Response:
        return json_response(self._acoustics.data())

    async def record(self, _request: web.Request) -> web.Response:
        record = self._acoustics.record_json()
        if record is None:
            why = "no raw record came: boards send them on request, by UDP or at 921600 baud"
            return error_response(404, why)
        return json_response(record)
