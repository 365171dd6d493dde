from __future__ import annotations

from pathlib import Path

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from bluerov_slam.services.map_tiles import LARGEST_BYTES, MapTiles

PNG = b"\x89PNG\r\n\x1a\n" + b"picture"


async def client_of(folder: Path) -> TestClient[web.Request, web.Application]:
    app = web.Application()
    for route in MapTiles(folder).routes():
        app.router.add_route(route.method, route.path, route.handler)
    client = TestClient(TestServer(app))
    await client.start_server()
    return client


def put(folder: Path, name: str, data: bytes) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


async def test_what_the_user_has_put_there_is_served(tmp_path: Path) -> None:
    put(tmp_path, "16/32268/22963.png", PNG)
    put(tmp_path, "9/0/0.png", b"\xff\xd8\xff\xe0 a JPEG that calls itself PNG")
    put(tmp_path, "readme/x.txt", b"")
    client = await client_of(tmp_path)
    try:
        assert await (await client.get("/api/tiles")).json() == {"zooms": [9, 16]}
        answer = await client.get("/api/tiles/16/32268/22963.png")
        assert (answer.status, answer.content_type, await answer.read()) == (200, "image/png", PNG)
        assert (await client.get("/api/tiles/9/0/0.png")).content_type == "image/jpeg"
    finally:
        await client.close()


async def test_without_a_folder_there_are_no_tiles(tmp_path: Path) -> None:
    client = await client_of(tmp_path / "none")
    try:
        assert await (await client.get("/api/tiles")).json() == {"zooms": []}
        assert (await client.get("/api/tiles/1/0/0.png")).status == 204
    finally:
        await client.close()


@pytest.mark.parametrize(
    "name",
    [
        "16/32268/1.png",  # not there
        "16/32268/2.png",  # a folder
        "16/32268/3.png",  # too large
        "16/32268/4.png",  # no picture
        "16/32268/5.png",  # leads out of the folder
        "1/2/0.png",  # beyond the world
        "23/0/0.png",  # finer than any map
        "16/-1/0.png",
        "16/%2e%2e/secret.png",
        "16/..%2f..%2f/secret.png",
        "٣/0/0.png",
        "99999999999999999999/0/0.png",
    ],
)
async def test_nothing_else_is_served(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "tiles"
    put(tmp_path, "secret.png", PNG)
    (folder / "16/32268/2.png").mkdir(parents=True)
    put(folder, "16/32268/3.png", PNG + bytes(LARGEST_BYTES))
    put(folder, "16/32268/4.png", b"#!/bin/sh")
    (folder / "16/32268/5.png").symlink_to(tmp_path / "secret.png")
    put(folder, "1/2/0.png", PNG)
    client = await client_of(folder)
    try:
        answer = await client.get(f"/api/tiles/{name}")
        assert answer.status in (204, 404)
        assert PNG not in await answer.read()
    finally:
        await client.close()
