"""The viewer's HTTP API: every route and what it answers. What happens behind them is in the objects it is given."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from aiohttp import web
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from bluerov_slam import __version__
from bluerov_slam.errors import CommandError, ConfigError
from bluerov_slam.records import Channel
from bluerov_slam.services.command_forwarder import CommandForwarder
from bluerov_slam.services.contacts import ContactBook
from bluerov_slam.services.http import Route, ServicePage, error_response, json_response, read_json_object
from bluerov_slam.services.viewer_channel import ViewerChannel
from bluerov_slam.services.viewer_outlets import ViewerOutlets
from bluerov_slam.services.viewer_track import track_json

PAGE = ServicePage(
    name="BlueROV SLAM Sonar Viewer",
    description="Side-scan sonar waterfalls of the BlueROV2: live, scroll-back, contacts and sonar settings.",
    icon="mdi-waves-arrow-right",
    version=__version__,
    folder="viewer",
    widgets=(
        {
            "name": "Side-scan sonar",
            "iframeUrl": "/widget",
            "iconUrl": "/static/viewer/icon.svg",
            "version": __version__,
            "useExtensionPathAsBaseUrl": True,
        },
    ),
)
DEFAULT_HISTORY_PINGS = 200
MAXIMUM_HISTORY_PINGS = 2000
_LENGTH = struct.Struct("<I")
# Counters of a channel that only grow, for Prometheus.
_COUNTED = (
    "packets", "bytes", "bb55", "pings", "incomplete", "gap_samples", "duplicates", "oversize_chunks", "unsupported",
    "checksum_errors", "bytes_skipped", "sonar_restarts",
)  # fmt: skip
_SETTINGS_SCHEMA = {
    "type": "object",
    "properties": {
        key: {"type": "number"}
        for key in (
            "range_m", "samples", "resolution_mm", "first_sample", "period_ms", "frequency_khz", "pulses",
            "sound_speed_mps", "smoothing",
        )
    }
    | {"boost": {"type": "boolean"}},
}  # fmt: skip
_ACTION_SCHEMA = {
    "type": "object",
    "required": ["action"],
    "properties": {
        "action": {"type": "string", "enum": ["save_to_flash", "reboot", "stop", "refresh"]},
        "confirm": {"type": "boolean"},
    },
}
_CONTACT_SCHEMA = {
    "type": "object",
    "properties": {
        "name": {"type": "string"},
        "note": {"type": "string"},
        "channel": {"type": "string", "enum": ["A", "B"]},
        "ping_number": {"type": "integer", "nullable": True},
        "range_m": {"type": "number", "nullable": True},
        "time_unix_s": {"type": "number", "nullable": True},
        "latitude_deg": {"type": "number", "nullable": True},
        "longitude_deg": {"type": "number", "nullable": True},
        "position_within_m": {"type": "number", "nullable": True},
        "ground_range_m": {"type": "number", "nullable": True},
    },
}


class ViewerApi:
    """The handlers; `status` gives what the page's status topic carries."""

    def __init__(
        self,
        channels: Mapping[Channel, ViewerChannel],
        forwarder: CommandForwarder,
        contacts: ContactBook,
        outlets: ViewerOutlets,
        status: Callable[[], dict[str, Any]],
    ) -> None:
        self._channels = channels
        self._forwarder = forwarder
        self._contacts = contacts
        self._history = outlets.history
        self._pings = outlets.pings
        self._track = outlets.track
        self._status = status

    def routes(self) -> list[Route]:
        """The route table of this service."""
        return [
            Route("GET", "/health", self.health, "Is it working", cross_origin=True),
            Route("GET", "/api/status", self.status, "Counters and state in detail", cross_origin=True),
            Route("GET", "/api/sonar", self.sonar, "Settings of both sonars, asked and read back"),
            Route("POST", "/api/sonar/{channel}", self.set_sonar, "Change settings of A, B or both",
                  body=_SETTINGS_SCHEMA),
            Route("POST", "/api/sonar/{channel}/action", self.act, "Save to flash, restart, stop or re-read",
                  body=_ACTION_SCHEMA),
            Route("GET", "/api/history", self.history, "Binary pings of this dive, each after its u32 length"),
            Route("GET", "/api/track", self.track, "Where the vehicle was during the pings of /api/history"),
            Route("GET", "/api/contacts", self.list_contacts, "Named contacts"),
            Route("POST", "/api/contacts", self.add_contact, "A new contact", body=_CONTACT_SCHEMA),
            Route("PATCH", "/api/contacts/{id}", self.change_contact, "Change a contact", body=_CONTACT_SCHEMA),
            Route("DELETE", "/api/contacts/{id}", self.remove_contact, "Delete a contact"),
            Route("GET", "/ws", self._pings.handle, "Binary pings and status", documented=False),
        ]  # fmt: skip

    async def health(self, _request: web.Request) -> web.Response:
        return json_response({"status": "healthy", **self._original_counters()})

    async def status(self, _request: web.Request) -> web.Response:
        gateways = {channel.value: asdict(c.gateway.counters) for channel, c in self._channels.items()}
        return json_response({**self._original_counters(), **self._status(), "kogger_app": gateways})

    async def sonar(self, _request: web.Request) -> web.Response:
        return json_response(self._forwarder.state())

    async def set_sonar(self, request: web.Request) -> web.Response:
        body = await read_json_object(request)
        channels = _channels(request.match_info["channel"])
        outcomes = await asyncio.gather(
            *(self._forwarder.apply(channel, body) for channel in channels), return_exceptions=True
        )
        return _outcome_response(channels, outcomes, body)

    async def act(self, request: web.Request) -> web.Response:
        body = await read_json_object(request)
        channels = _channels(request.match_info["channel"])
        action, confirm = str(body.get("action", "")), body.get("confirm") is True
        outcomes = await asyncio.gather(
            *(self._forwarder.act(channel, action, confirm) for channel in channels), return_exceptions=True
        )
        return _outcome_response(channels, outcomes, body)

    async def history(self, request: web.Request) -> web.Response:
        channel = _channels(request.query.get("channel", "A"))[0]
        before, after = _number(request, "before"), _number(request, "after")
        limit = min(MAXIMUM_HISTORY_PINGS, _number(request, "limit") or DEFAULT_HISTORY_PINGS)
        pings = await asyncio.to_thread(self._history.read, channel, before=before, after=after, limit=limit)
        first, last = self._history.span(channel) or ("", "")
        body = b"".join(part for ping in pings for part in (_LENGTH.pack(len(ping)), ping))
        headers = {"X-First-Ping": str(first), "X-Last-Ping": str(last)}
        return web.Response(body=body, content_type="application/octet-stream", headers=headers)

    async def track(self, _request: web.Request) -> web.Response:
        body = await asyncio.to_thread(track_json, self._track.states())
        return web.Response(body=body, content_type="application/json")

    async def list_contacts(self, _request: web.Request) -> web.Response:
        return self._contacts_response()

    async def add_contact(self, request: web.Request) -> web.Response:
        return json_response(await self._contacts.add(await read_json_object(request)), 201)

    async def change_contact(self, request: web.Request) -> web.Response:
        identifier = request.match_info["id"]
        try:
            return json_response(await self._contacts.change(identifier, await read_json_object(request)))
        except KeyError:
            return _unknown_contact(identifier)

    async def remove_contact(self, request: web.Request) -> web.Response:
        identifier = request.match_info["id"]
        try:
            await self._contacts.remove(identifier)
        except KeyError:
            return _unknown_contact(identifier)
        return self._contacts_response()

    def metrics(self) -> bytes:
        """Everything countable, for Prometheus."""
        registry = CollectorRegistry(auto_describe=False)
        registry.register(_Collected(self._metrics()))
        return bytes(generate_latest(registry))

    def _contacts_response(self) -> web.Response:
        return json_response({"contacts": self._contacts.all(), "message": self._contacts.message})

    def _original_counters(self) -> dict[str, int]:
        counters: dict[str, int] = {}
        for channel, state in self._channels.items():
            letter = channel.value.lower()
            counted = state.counters
            counters |= {
                f"{letter}_packets": counted.packets,
                f"{letter}_bytes": counted.bytes_received,
                f"{letter}_bb55": counted.frames,
                f"{letter}_pings": counted.pings,
            }
        return counters

    def _metrics(self) -> list[Metric]:
        metrics: list[Metric] = []
        statuses = {channel.value: state.status() for channel, state in self._channels.items()}
        for name in _COUNTED:
            family = CounterMetricFamily(f"bluerov_slam_viewer_{name}", f"Sonar {name}", labels=["channel"])
            for channel, status in statuses.items():
                family.add_metric([channel], status[name])
            metrics.append(family)
        gateway = CounterMetricFamily(
            "bluerov_slam_viewer_kogger_app", "What came from the network", labels=["channel", "what"]
        )
        for channel_, state in self._channels.items():
            for what, count in asdict(state.gateway.counters).items():
                gateway.add_metric([channel_.value, what], count)
        clients = GaugeMetricFamily("bluerov_slam_viewer_clients", "WebSocket clients", value=self._pings.clients)
        broadcast = CounterMetricFamily("bluerov_slam_viewer_websocket", "WebSocket messages", labels=["what"])
        for what, count in asdict(self._pings.counters).items():
            broadcast.add_metric([what], count)
        return [*metrics, gateway, clients, broadcast]


class _Collected:
    """What prometheus_client calls a collector."""

    def __init__(self, metrics: list[Metric]) -> None:
        self._metrics = metrics

    def collect(self) -> list[Metric]:
        return self._metrics


def _channels(text: str) -> list[Channel]:
    if text.lower() == "both":
        return list(Channel)
    try:
        return [Channel(text.upper())]
    except ValueError as error:
        raise web.HTTPNotFound(text=f"sonar {text!r}: expected A, B or both") from error


def _number(request: web.Request, key: str) -> int | None:
    text = request.query.get(key)
    if text is None or text == "":
        return None
    if not text.isascii() or not text.isdigit() or len(text) > 10:
        raise web.HTTPBadRequest(text=f"{key} {text[:20]!r}: expected a whole number from 0")
    return int(text)


def _outcome_response(channels: list[Channel], outcomes: list[Any], body: Mapping[str, Any]) -> web.Response:
    """All refused: the refusal. Otherwise each sonar's own outcome, since one may do what the other cannot."""
    failures = [outcome for outcome in outcomes if isinstance(outcome, BaseException)]
    for failure in failures:
        if len(failures) == len(outcomes) or not isinstance(failure, CommandError | ConfigError):
            raise failure
    answer = {
        channel.value: {"ok": False, "asked": dict(body), "read": {}, "message": str(outcome)}
        if isinstance(outcome, BaseException)
        else outcome.as_json()
        for channel, outcome in zip(channels, outcomes, strict=True)
    }
    return json_response(answer)


def _unknown_contact(identifier: str) -> web.Response:
    return error_response(404, f"contact {identifier[:40]}: there is none; it may have been deleted on another page")
