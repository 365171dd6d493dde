"""The extension's HTTP API (docs/interfaces.md section 2): every route in one table, handlers below."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from aiohttp import web

from bluerov_slam import __version__
from bluerov_slam.errors import CommandError, ConfigError
from bluerov_slam.protocol.esp32_messages import ConfigKey
from bluerov_slam.services.esp_link import CommandOutcome
from bluerov_slam.services.http import Route, ServicePage, json_response, read_json_object
from bluerov_slam.services.status_report import PROTOCOL, is_connected

if TYPE_CHECKING:
    from bluerov_slam.services.extension import Extension
    from bluerov_slam.services.sensor_feed import SensorFeed

RESTORE_LIMIT_BYTES: Final = 1_000_000
PAGE: Final = ServicePage(
    name="BlueROV SLAM",
    description="Sensors, recordings and health of the BlueROV SLAM payload",
    icon="mdi-map-marker-path",
    version=__version__,
    folder="dashboard",
    widgets=(
        {
            "name": "BlueROV SLAM sensors",
            "iframeUrl": "/widget",
            "iconUrl": "/static/dashboard/icon.svg",
            "version": __version__,
            "useExtensionPathAsBaseUrl": True,
        },
    ),
)
# Key of POST /api/esp32 -> CONFIG key, wire units per unit, allowed range.
_ESP32_KEYS: Final = {
    "sensors_rate_hz": (ConfigKey.SENSORS_RATE_MHZ, 1000, (0.5, 20.0)),
    "imu_rate_hz": (ConfigKey.IMU_RATE_MHZ, 1000, (1.0, 20.0)),
    "decimation": (ConfigKey.DECIMATION, 1, (1.0, 8.0)),
}
_OBJECT: Final = {"type": "object"}
_ESP32_BODY: Final = {
    "type": "object",
    "minProperties": 1,
    "additionalProperties": False,
    "properties": {
        key: {"type": "integer" if scale == 1 else "number", "minimum": low, "maximum": high}
        for key, (_, scale, (low, high)) in _ESP32_KEYS.items()
    },
}


class ExtensionApi:
    """Handlers over a running extension."""

    def __init__(self, extension: Extension, sensors: SensorFeed) -> None:
        self._extension = extension
        self.sensors = sensors

    def routes(self) -> list[Route]:
        """The route table, without recordings."""
        websocket = self._extension.topics.handle
        return [
            Route("GET", "/health", self.health, "Alive?", cross_origin=True),
            Route("GET", "/api/latest", self.latest, "The latest sensor frame", cross_origin=True),
            Route("GET", "/api/dvl", self.dvl, "Velocity over ground by a DVL", cross_origin=True),
            Route("GET", "/api/ctd", self.ctd, "Conductivity, temperature, depth", cross_origin=True),
            Route("GET", "/api/status", self.overview, "The service at a glance", cross_origin=True),
            Route("GET", "/api/state", self.state, "Everything the status topic carries"),
            Route("GET", "/api/events", self.events, "The last 500 events"),
            Route("GET", "/api/settings", self.settings, "Every setting with value, default, range and reason"),
            Route("PATCH", "/api/settings", self.change_settings, "Change settings, all or nothing", body=_OBJECT),
            Route("GET", "/api/settings/backup", self.backup, "The changed settings as a file", documented=False),
            Route("POST", "/api/settings/restore", self.restore, "Take a backup back", body=_OBJECT),
            Route("POST", "/api/esp32", self.configure_esp32, "Rates and decimation of the ESP32", body=_ESP32_BODY),
            Route("GET", "/ws", websocket, "WebSocket: sensors, status, event", documented=False),
            Route(
                "GET", "/internal/viewer-link", self._extension.viewer_link.handle, "For the viewer", documented=False
            ),
        ]

    async def health(self, _request: web.Request) -> web.Response:
        link = self._extension.link
        return json_response(
            {
                "status": "healthy",
                "serial": is_connected(link.source.facts()),
                "frames": link.counters.link.frames_ok,
                "protocol": PROTOCOL,
            }
        )

    async def latest(self, _request: web.Request) -> web.Response:
        return json_response(self.sensors.latest())

    async def dvl(self, _request: web.Request) -> web.Response:
        return json_response(self.sensors.dvl_json())

    async def ctd(self, _request: web.Request) -> web.Response:
        return json_response(self.sensors.ctd_json())

    async def overview(self, _request: web.Request) -> web.Response:
        extension = self._extension
        facts, counters = extension.link.source.facts(), extension.link.counters.link
        settings, mavlink = extension.store.settings, extension.mavlink.facts()
        return json_response(
            {
                "frames": counters.frames_ok,
                "clients": extension.topics.clients + extension.bare.clients,
                "port": facts.port,
                "serial_connected": is_connected(facts),
                "log": extension.recorder.log_path if extension.recorder is not None else None,
                "ws_port": extension.sensor_http.port,
                "crc_errors": counters.checksum_errors,
                "protocol": PROTOCOL,
                "udp_targets": list(settings.forwarding.targets),
                "mavlink_enabled": mavlink.enabled,
                "mavlink_target": mavlink.target,
                "mavlink_sent": mavlink.sent,
                "version": __version__,
                "simulated": extension.simulated,
            }
        )

    async def state(self, _request: web.Request) -> web.Response:
        return json_response(self._extension.status.data())

    async def events(self, _request: web.Request) -> web.Response:
        return json_response(self._extension.events.listing())

    async def settings(self, _request: web.Request) -> web.Response:
        return json_response(self._extension.store.listing())

    async def change_settings(self, request: web.Request) -> web.Response:
        values = await read_json_object(request)
        store = self._extension.store
        await self._extension.change_settings(lambda: store.change(values))
        return json_response(store.listing())

    async def backup(self, _request: web.Request) -> web.Response:
        headers = {"Content-Disposition": 'attachment; filename="bluerov-slam-settings.json"'}
        return json_response(self._extension.store.backup(), headers=headers)

    async def restore(self, request: web.Request) -> web.Response:
        data = await read_json_object(request, RESTORE_LIMIT_BYTES)
        store = self._extension.store
        await self._extension.change_settings(lambda: store.restore(data))
        return json_response(store.listing())

    async def configure_esp32(self, request: web.Request) -> web.Response:
        values = esp32_values(await read_json_object(request))
        result = await self._extension.link.configure(values)
        if result.outcome is not CommandOutcome.OK:
            raise CommandError(f"{result.outcome}: {result.message}")
        return json_response({"result": result.outcome, "message": result.message})


def esp32_values(body: dict[str, Any]) -> dict[ConfigKey, int]:
    """CONFIG keys and wire values of a request. Raises ConfigError naming key and range."""
    if not body:
        raise ConfigError(f"nothing to set; there are {', '.join(_ESP32_KEYS)}")
    values: dict[ConfigKey, int] = {}
    for key, value in body.items():
        if key not in _ESP32_KEYS:
            raise ConfigError(f"{key}: unknown; there are {', '.join(_ESP32_KEYS)}")
        config_key, scale, (low, high) = _ESP32_KEYS[key]
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not number or not low <= value <= high or (scale == 1 and value != int(value)):
            kind = "a whole number" if scale == 1 else "a number"
            raise ConfigError(f"{key} = {value!r}: expected {kind} from {low:g} to {high:g}")
        values[config_key] = round(value * scale)
    return values
