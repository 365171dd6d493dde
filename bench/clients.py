"""Ten pilots' browsers as one process: WebSocket clients that note when what arrived.

`python -m bench.clients SENSORS_URL PINGS_URL COUNT SECONDS` prints one JSON object:
{"sensors": [[device_ms, [arrival of each client]]...], "pings": [["A", number, [...]]...], "messages": n,
"navigation": [[t, arrival]...]} (t: the state's instant, unix seconds).
Arrival times are host monotonic seconds, the same clock as the writer's.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from collections import defaultdict

import aiohttp
import numpy as np
import orjson

from bench.load import ping_number
from bluerov_slam.protocol.waterfall_frame import unpack_ping


class Clients:
    """What all clients of both pages have received."""

    def __init__(self) -> None:
        self.sensors: dict[int, list[float]] = defaultdict(list)
        self.pings: dict[tuple[str, int], list[float]] = defaultdict(list)
        self.navigation: list[tuple[float, float]] = []
        self.messages = 0
        self.ready = 0

    async def dashboard(self, session: aiohttp.ClientSession, url: str) -> None:
        async with session.ws_connect(url, max_msg_size=0) as socket:
            self.ready += 1
            async for message in socket:
                arrived_s = time.monotonic()
                self.messages += 1
                if message.type is not aiohttp.WSMsgType.TEXT:
                    continue
                if message.data.startswith('{"topic":"sensors"'):
                    self.sensors[orjson.loads(message.data)["data"]["ts"]].append(arrived_s)
                elif message.data.startswith('{"topic":"navigation"'):
                    self.navigation.append((orjson.loads(message.data)["t"], arrived_s))

    async def viewer(self, session: aiohttp.ClientSession, url: str) -> None:
        async with session.ws_connect(url, max_msg_size=0) as socket:
            self.ready += 1
            async for message in socket:
                arrived_s = time.monotonic()
                self.messages += 1
                if message.type is aiohttp.WSMsgType.BINARY:
                    ping = unpack_ping(message.data).ping
                    self.pings[ping.channel.value, ping_number(np.asarray(ping.samples))].append(arrived_s)


async def run(sensors_url: str, pings_url: str, count: int, seconds: float) -> dict[str, object]:
    """Connect `count` clients to each page (none to a page without address), collect for this long."""
    clients = Clients()
    async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0)) as session:
        tasks = [asyncio.create_task(clients.dashboard(session, sensors_url)) for _ in range(count) if sensors_url]
        tasks += [asyncio.create_task(clients.viewer(session, pings_url)) for _ in range(count) if pings_url]
        while clients.ready < len(tasks):
            await asyncio.sleep(0.05)
        print("ready", file=sys.stderr, flush=True)
        await asyncio.sleep(seconds)
        for task in tasks:
            task.cancel()
        for task in tasks:
            with contextlib.suppress(asyncio.CancelledError):
                await task
    return {
        "sensors": [[key, times] for key, times in clients.sensors.items()],
        "pings": [[*key, times] for key, times in clients.pings.items()],
        "messages": clients.messages,
        "navigation": clients.navigation,
    }


if __name__ == "__main__":
    result = asyncio.run(run(sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])))
    json.dump(result, sys.stdout)
