"""HTTP of navigation: the state, the track, actions, calibrations and the dive-start assistant."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Final

from aiohttp import web

from bluerov_slam.errors import ConfigError
from bluerov_slam.services.http import Route, json_response, read_json_object
from bluerov_slam.services.navigation_autopilot import AutopilotParameters
from bluerov_slam.services.navigation_service import NavigationService
from bluerov_slam.services.navigation_track import DEFAULT_POINTS

KINDS: Final = ("gyro", "accelerometer", "magnetometer", "thruster_field", "swing", "course_swing")
MAX_POINTS: Final = 20_000
_POSITION: Final = ("latitude_deg", "longitude_deg")
_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "zero_depth": (),
    "set_origin": _POSITION,
    "reset": (),
    "start_calibration": ("kind",),
    "finish_calibration": ("kind",),
    "cancel_calibration": ("kind",),
    "clear_calibration": ("kind",),
}
_BODY: Final = {
    "type": "object",
    "required": ["action"],
    "additionalProperties": False,
    "properties": {
        "action": {"type": "string", "enum": list(_KEYS)},
        "latitude_deg": {"type": "number", "minimum": -90, "maximum": 90},
        "longitude_deg": {"type": "number", "minimum": -180, "maximum": 180},
        "kind": {"type": "string", "enum": list(KINDS)},
    },
}

_AUTOPILOT_BODY: Final = {
    "type": "object",
    "required": ["action", "confirm"],
    "additionalProperties": False,
    "properties": {"action": {"type": "string", "enum": ["set_parameters"]}, "confirm": {"type": "boolean"}},
}


class NavigationApi:
    """Handlers over the running navigation."""

    def __init__(
        self,
        navigation: NavigationService,
        parameters: AutopilotParameters,
        wall_time: Callable[[], float] = time.time,
    ) -> None:
        self._navigation = navigation
        self._parameters = parameters
        self._wall_time = wall_time

    def routes(self) -> list[Route]:
        """The route table."""
        return [
            Route("GET", "/api/navigation", self.state, "Where the vehicle is, and how well that is known",
                  cross_origin=True),
            Route("GET", "/api/navigation/track", self.track, "Where it has been, thinned"),
            Route("GET", "/api/navigation/calibration", self.calibration, "Calibrations and the dive-start assistant"),
            Route("GET", "/api/navigation/water", self.water, "Sound speed and density against depth",
                  cross_origin=True),
            Route("POST", "/api/navigation", self.act, "Zero the depth, set the origin, calibrate", body=_BODY),
            Route("GET", "/api/navigation/autopilot", self.autopilot, "Parameters that ODOMETRY needs"),
            Route("POST", "/api/navigation/autopilot", self.set_parameters, "Set them", body=_AUTOPILOT_BODY),
        ]  # fmt: skip

    async def state(self, _request: web.Request) -> web.Response:
        return json_response(self._navigation.data())

    async def track(self, request: web.Request) -> web.Response:
        since_unix_s = _number(request, "since", -math.inf, -math.inf, math.inf)
        points = _number(request, "points", DEFAULT_POINTS, 2, MAX_POINTS)
        return json_response(self._navigation.track.listing(since_unix_s, int(points)))

    async def calibration(self, _request: web.Request) -> web.Response:
        return json_response(self._navigation.calibration_json())

    async def water(self, _request: web.Request) -> web.Response:
        return json_response(self._navigation.water or {"nodes": []})

    async def act(self, request: web.Request) -> web.Response:
        action, arguments = action_of(await read_json_object(request))
        if action.endswith("_calibration"):
            arguments["unix_s"] = self._wall_time()
        return json_response({"ok": True, "message": await self._navigation.act(action, arguments)})

    async def autopilot(self, _request: web.Request) -> web.Response:
        return json_response(await self._parameters.read())

    async def set_parameters(self, request: web.Request) -> web.Response:
        body = await read_json_object(request)
        if body.get("action") != "set_parameters":
            raise ConfigError(f"action = {body.get('action')!r}: expected set_parameters")
        if body.get("confirm") is not True:
            raise ConfigError('setting parameters of the autopilot needs "confirm": true')
        return json_response({"ok": True, "parameters": await self._parameters.set_needed()})


def action_of(body: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Action and arguments of a request. Raises ConfigError naming what does not fit."""
    action = body.get("action")
    if not isinstance(action, str) or action not in _KEYS:
        raise ConfigError(f"action = {action!r}: expected one of {', '.join(_KEYS)}")
    arguments = {key: value for key, value in body.items() if key != "action"}
    unknown = sorted(set(arguments) - set(_KEYS[action]))
    if unknown:
        raise ConfigError(f"{action} takes no {', '.join(unknown)}")
    if "kind" in _KEYS[action] and arguments.get("kind") not in KINDS:
        raise ConfigError(f"kind = {arguments.get('kind')!r}: expected one of {', '.join(KINDS)}")
    if action == "set_origin" and arguments:
        latitude, longitude = (arguments.get(key) for key in _POSITION)
        if not (_is_within(latitude, 90.0) and _is_within(longitude, 180.0)):
            raise ConfigError("set_origin: expected both latitude_deg -90 to 90 and longitude_deg -180 to 180, or none")
        if latitude == 0 and longitude == 0:
            raise ConfigError("set_origin: 0, 0 is what a receiver without a fix says; give the real position")
        arguments = {key: float(arguments[key]) for key in _POSITION}
    return action, arguments


def _is_within(value: object, limit: float) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value) and abs(value) <= limit  # type: ignore[arg-type]


def _number(request: web.Request, name: str, default: float, low: float, high: float) -> float:
    text = request.query.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        expected = "a number" if math.isinf(high) else f"a number from {low:g} to {high:g}"
        raise ConfigError(f"{name} = {text!r}: expected {expected}")
    return value
