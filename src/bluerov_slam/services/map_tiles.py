"""Pictures of the place below the map: tiles of the user in the state folder. Nothing is fetched from elsewhere."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

from aiohttp import web

from bluerov_slam.services.http import Route, json_response

FOLDER: Final = "tiles"
DEEPEST_ZOOM: Final = 22
LARGEST_BYTES: Final = 1_000_000
_KINDS: Final = ((b"\x89PNG\r\n\x1a\n", "image/png"), (b"\xff\xd8\xff", "image/jpeg"))


class MapTiles:
    """Tiles as z/x/y.png in Web Mercator, y counted from the north; read only."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def routes(self) -> list[Route]:
        """The route table."""
        return [
            Route("GET", "/api/tiles", self.zooms, "Zoom levels of the user's own map tiles; none by default"),
            Route("GET", "/api/tiles/{z}/{x}/{y}.png", self.tile, "One tile; 204: there is none", documented=False),
        ]

    async def zooms(self, _request: web.Request) -> web.Response:
        return json_response({"zooms": await asyncio.to_thread(self._zooms)})

    async def tile(self, request: web.Request) -> web.Response:
        # No tile is no error: most of the world is missing, and a browser would complain about each.
        empty = web.Response(status=204)
        numbers = [request.match_info[name] for name in ("z", "x", "y")]
        if not all(text.isascii() and text.isdigit() and len(text) <= 8 for text in numbers):
            return empty
        z, x, y = (int(text) for text in numbers)
        if z > DEEPEST_ZOOM or max(x, y) >= 1 << z:
            return empty
        data = await asyncio.to_thread(self._read, z, x, y)
        kind = next((kind for magic, kind in _KINDS if data.startswith(magic)), None)
        if kind is None:
            return empty
        return web.Response(body=data, content_type=kind, headers={"Cache-Control": "max-age=3600"})

    def _zooms(self) -> list[int]:
        try:
            names = [entry.name for entry in self._folder.iterdir() if entry.is_dir()]
        except OSError:
            return []
        levels = {int(name) for name in names if name.isascii() and name.isdigit() and len(name) <= 2}
        return sorted(level for level in levels if level <= DEEPEST_ZOOM)

    def _read(self, z: int, x: int, y: int) -> bytes:
        """The file, empty where there is none that may be shown."""
        try:
            root = self._folder.resolve()
            path = (root / str(z) / str(x) / f"{y}.png").resolve()
            if not path.is_relative_to(root) or not path.is_file() or path.stat().st_size > LARGEST_BYTES:
                return b""
            with path.open("rb") as file:
                return file.read(LARGEST_BYTES)
        except OSError:
            return b""
