"""The rig's page: its stack in three dimensions at any set points, with reach, margin and uncertainty.

It computes and shows; it moves nothing. So every route is a GET, and what it takes is a bounded list of numbers.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, get_args

import numpy as np
from aiohttp import web
from numpy.typing import NDArray

from bluerov_slam import __version__
from bluerov_slam.errors import ConfigError
from bluerov_slam.geometry.platform_stack import PLATFORMS, rotations
from bluerov_slam.navigation.rotation import euler_from_rotation
from bluerov_slam.rig import demo
from bluerov_slam.rig.dimensions import FO_SHIP, AxisLimits
from bluerov_slam.rig.limits import FO_SHIP_LIMITS, platform_margins
from bluerov_slam.rig.planner import Aim, plan_set_points
from bluerov_slam.rig.scene import StackScene, margin_shares, stack_scene
from bluerov_slam.rig.stack import StackPose
from bluerov_slam.rig.trajectory import smooth_path
from bluerov_slam.rig.uncertainty import pose_covariance
from bluerov_slam.rig.validation import logged_spread
from bluerov_slam.rig.workspace import StackWorkspace
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.http import Route, ServicePage, WebServer, build_app, json_response

Array = NDArray[np.float64]

PAGE = ServicePage(
    name="BlueROV SLAM Rig",
    description="The ground-truth rig in three dimensions: set points, reach, margin and the truth's uncertainty.",
    icon="mdi-robot-industrial",
    version=__version__,
    folder="rig",
)
FRAME_S = 0.04
# No demonstration lasts longer; a page that asks for the impossible gets an answer, not a gigabyte.
MOST_FRAMES = 6000
LARGEST_NUMBER = 1e4
LARGEST_CIRCLE_DEG = 15.0


class RigPageService:
    """`start`, then it serves until `stop`."""

    def __init__(self, host: str, port: int, announce: Callable[[str], None]) -> None:
        self._host, self._port, self._announce = host, port, announce
        self._workspace = StackWorkspace()
        self._planning = asyncio.Lock()
        guard = ChangeGuard(tuple, str)
        self.http = WebServer(build_app(PAGE, self._routes(), guard=guard, metrics=lambda: b""))

    async def start(self) -> None:
        """Listen. Raises ExpectedError when the port is taken."""
        await self.http.start(self._host, self._port, "--port")
        self._announce(f"The rig: http://{self._host}:{self.http.port} (Ctrl-C ends it)")

    async def stop(self) -> None:
        """Stop listening."""
        await self.http.stop()

    def _routes(self) -> list[Route]:
        return [
            Route("GET", "/api/rig/limits", self._limits, "How far each axis of one platform goes, mm and degrees"),
            Route("GET", "/api/rig/scene", self._scene, "The stack at set points: ?set_points=6 or 24 numbers"),
            Route(
                "GET", "/api/rig/plan", self._plan, "Set points for a pose of the tool: ?tool=6 numbers&aim=...&start="
            ),
            Route("GET", "/api/rig/demo", self._demo, "A demonstration: ?name=...", documented=False),
        ]

    async def _limits(self, _request: web.Request) -> web.Response:
        axes = AxisLimits().array()
        axes[3:] = np.degrees(axes[3:])
        home = stack_scene(np.zeros((PLATFORMS, 6))).tool
        return json_response({"platform": axes.round(6), "aims": get_args(Aim), "home_tool": _pose_numbers(home)})

    async def _scene(self, request: web.Request) -> web.Response:
        return json_response(_told(_set_points(request, "set_points")))

    async def _plan(self, request: web.Request) -> web.Response:
        values = _numbers(request, "tool", (6,))
        aim = request.query.get("aim", "least_motion")
        if aim not in get_args(Aim):
            raise ConfigError(f"aim is one of {', '.join(get_args(Aim))}")
        start = _set_points(request, "start") if "start" in request.query else None
        pose = StackPose(values[:3], rotations(np.radians(values[None, 3:]))[0])

        def work() -> dict[str, Any]:
            plan = plan_set_points(pose, aim=aim, start=start, workspace=self._workspace)  # type: ignore[arg-type]
            return {
                "reached": plan.reached,
                "words": plan.words,
                "margin": _number(plan.margin),
                **_told(plan.set_points),
            }

        async with self._planning:
            return json_response(await asyncio.to_thread(work))

    async def _demo(self, request: web.Request) -> web.Response:
        name = request.query.get("name", "")
        if name not in DEMOS:
            raise ConfigError(f"name is one of {', '.join(DEMOS)}")
        waypoints = DEMOS[name](request)
        async with self._planning:
            return json_response(await asyncio.to_thread(_frames, waypoints))


def _axis_limits(_request: web.Request) -> Array:
    return demo.axis_limits()


def _inverted_pairs(_request: web.Request) -> Array:
    return demo.inverted_pairs()


def _circle(request: web.Request) -> Array:
    radius_deg = float(_numbers(request, "radius_deg", (1,))[0]) if "radius_deg" in request.query else 11.25
    if not 0.0 < radius_deg <= LARGEST_CIRCLE_DEG:
        raise ConfigError(f"radius_deg is above 0 and at most {LARGEST_CIRCLE_DEG:g} degrees of a platform")
    return demo.circle(float(np.radians(radius_deg)))


def _tracking(request: web.Request) -> Array:
    found = demo.track_transmitter(_numbers(request, "transmitter", (3,)))
    return np.stack([np.zeros_like(found.set_points), found.set_points])


def _move(request: web.Request) -> Array:
    return np.stack([_set_points(request, "start"), _set_points(request, "end")])


DEMOS: dict[str, Callable[[web.Request], Array]] = {
    "axis-limits": _axis_limits,
    "inverted-pairs": _inverted_pairs,
    "circle": _circle,
    "tracking": _tracking,
    "move": _move,
}


def _frames(waypoints: Array) -> dict[str, Any]:
    """A way through set points as the servos go it, 25 times a second."""
    way = smooth_path(waypoints, FO_SHIP)
    wanted_s = np.arange(0.0, way.duration_s + FRAME_S, FRAME_S)[:MOST_FRAMES]
    at = np.minimum(np.searchsorted(way.times_s, wanted_s), len(way.times_s) - 1)
    points = way.set_points[at]
    scene = stack_scene(points)
    return {
        "duration_s": way.duration_s,
        "times_s": way.times_s[at].round(3),
        "set_points": _degrees(points).round(4),
        **_lines(scene),
        "tool": [
            _pose_numbers(StackPose(*pose)) for pose in zip(scene.tool.position_mm, scene.tool.rotation, strict=True)
        ],
        "tool_mm": scene.tool.position_mm.round(2),
        "tool_rotation": scene.tool.rotation.round(5),
        "reach": np.min([_reach(points[:, place], place) for place in range(PLATFORMS)], axis=0).round(4),
    }


def _reach(points: Array, place: int) -> Array:
    """Share of the room to the limit of the legs' reach, (n,)."""
    home = platform_margins(np.zeros(6), FO_SHIP.platforms[place], FO_SHIP_LIMITS).reach
    return platform_margins(points, FO_SHIP.platforms[place], FO_SHIP_LIMITS).reach / home


def _told(points: Array) -> dict[str, Any]:
    """All that the page shows at set points (4, 6)."""
    scene = stack_scene(points)
    platforms = []
    for place, point in enumerate(points):
        shares = margin_shares(point, place)
        broken = platform_margins(point, FO_SHIP.platforms[place], FO_SHIP_LIMITS).broken()
        platforms.append(
            {
                "servos_deg": _list(np.degrees(scene.servo_rad[place]).round(2)),
                "margins": [
                    {"limit": one.limit.value, "words": one.limit.words, "share": _number(one.share)} for one in shares
                ],
                "broken": None if broken is None else broken.words,
            }
        )
    reached = all(one["broken"] is None for one in platforms)
    covariance = pose_covariance(points, FO_SHIP, logged_spread()) if reached else np.full((6, 6), np.nan)
    return {
        "set_points": _degrees(points).round(4),
        **_lines(scene),
        "tool": _pose_numbers(scene.tool),
        "tool_mm": scene.tool.position_mm.round(3),
        "tool_rotation": scene.tool.rotation.round(6),
        "reached_here": reached,
        "covariance_mm2": covariance[:3, :3].copy() if reached else None,
        "std": _list(np.concatenate([np.sqrt(np.diag(covariance))[:3], np.degrees(np.sqrt(np.diag(covariance))[3:])])),
        "platforms": platforms,
    }


def _lines(scene: StackScene) -> dict[str, Array]:
    return {
        "base_mm": scene.base_mm.round(2),
        "arm_ends_mm": scene.arm_ends_mm.round(2),
        "plate_mm": scene.plate_mm.round(2),
    }


def _pose_numbers(pose: StackPose) -> list[float]:
    """x, y, z in mm and roll, pitch, yaw in degrees."""
    angles = euler_from_rotation(pose.rotation)
    return [round(float(value), 4) + 0.0 for value in (*pose.position_mm, *np.degrees(angles))]


def _degrees(points: Array) -> Array:
    told = points.copy()
    told[..., 3:] = np.degrees(told[..., 3:])
    return told


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _list(values: Array) -> list[float | None]:
    return [_number(value) for value in values]


def _set_points(request: web.Request, name: str) -> Array:
    """(4, 6) in mm and rad, of 6 numbers for all platforms alike or 24, mm and degrees."""
    values = _numbers(request, name, (6, 24))
    points = np.tile(values, (PLATFORMS, 1)) if values.size == 6 else values.reshape(PLATFORMS, 6)
    points[:, 3:] = np.radians(points[:, 3:])
    return points


def _numbers(request: web.Request, name: str, counts: tuple[int, ...]) -> Array:
    text = request.query.get(name, "")
    parts = text.split(",", max(counts))
    try:
        values = np.array([float(part) for part in parts])
    except ValueError:
        values = np.full(0, np.nan)
    if values.size not in counts or not np.all(np.abs(values) <= LARGEST_NUMBER):
        how_many = " or ".join(str(count) for count in counts)
        raise ConfigError(
            f"{name}: {how_many} numbers with commas are expected, in mm and degrees, up to {LARGEST_NUMBER:g}"
        )
    return values
