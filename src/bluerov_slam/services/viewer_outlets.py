"""Where a finished ping goes: full-resolution and seed WebSockets, and the history."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

import orjson

from bluerov_slam.protocol.waterfall_frame import pack_ping, seed_json
from bluerov_slam.records import Channel, Ping
from bluerov_slam.services.viewer_track import VehicleTrack
from bluerov_slam.sinks.ping_history import PingHistory
from bluerov_slam.sinks.websocket import Broadcaster

TOPICS = ("A", "B", "status", "sonar", "vehicle")


class ViewerOutlets:
    """The viewer's two WebSockets and its history. `greeting` gives topic and data of what a new client gets first."""

    def __init__(self, history: PingHistory, greeting: Callable[[], dict[str, dict[str, Any]]]) -> None:
        self.history = history
        self.pings = Broadcaster(TOPICS, greeting=lambda: [(t, _message(t, data)) for t, data in greeting().items()])
        self.waterfall = Broadcaster(("ping",))
        self.track = VehicleTrack()
        self.newest_ping_s = math.nan
        self.simulated = False
        self._block_full = asyncio.Event()

    @property
    def clients(self) -> int:
        """How many pages and programs are connected."""
        return self.pings.clients + self.waterfall.clients

    def show(self, ping: Ping, time_unix_s: float) -> None:
        """Send one ping to everybody who wants it, and keep it."""
        self.newest_ping_s = ping.measured_s
        packed = pack_ping(ping, time_unix_s, simulated=self.simulated)
        self.pings.publish_binary(ping.channel.value, packed)
        # The seed's JSON knows no sub-channels.
        if ping.sub_channel == 0 and self.waterfall.wants("ping"):
            self.waterfall.publish_text("ping", orjson.dumps(seed_json(ping)))
        if self.history.append(ping.channel, ping.number, packed):
            self._block_full.set()

    def tell(self, topic: str, data: Callable[[], dict[str, Any]]) -> None:
        """Publish a JSON topic; `data` is only asked when somebody listens."""
        if self.pings.wants(topic):
            self.pings.publish_text(topic, _message(topic, data()))

    def history_status(self) -> dict[str, Any]:
        """What can be scrolled back to."""
        spans = {channel.value: self.history.span(channel) for channel in Channel}
        known = {key: {"first": span[0], "last": span[1]} if span else None for key, span in spans.items()}
        return {**known, "message": self.history.message}

    async def write_history(self) -> None:
        """Bring full blocks to the disk, off the event loop; until cancelled."""
        while True:
            await self._block_full.wait()
            self._block_full.clear()
            await asyncio.to_thread(self.history.write_pending)

    async def close(self) -> None:
        """Let every client go."""
        await asyncio.gather(self.pings.close(), self.waterfall.close())
        self.history.close()


def _message(topic: str, data: dict[str, Any]) -> bytes:
    return orjson.dumps({"topic": topic, "data": data})
