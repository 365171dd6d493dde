"""The extension's end of the loopback link to the viewer (docs/interfaces.md section 5)."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import math
import os
import secrets
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import orjson
from aiohttp import WSMsgType, web

from bluerov_slam.errors import RecordingError
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.protocol.kogger_frame import KOGGER_SYNC, KoggerId
from bluerov_slam.protocol.navigation_json import error_ellipse, euler_angles_rad
from bluerov_slam.records import Channel, CtdSample, NavState, SensorSample, SonarFrames
from bluerov_slam.services.change_guard import is_bearer
from bluerov_slam.services.esp_link import CommandOutcome, CommandResult
from bluerov_slam.services.hub import Hub
from bluerov_slam.sinks.bounded_queue import BoundedQueue, QueueClosedError

_log = logging.getLogger(__name__)

TOKEN_FILE: Final = "viewer-link.token"  # noqa: S105  the name of the file, not a token
MESSAGE_BYTES: Final = 16 * 1024
QUEUE_LENGTH: Final = 500
VEHICLE_PERIOD_S: Final = 0.5
# An estimate older than this says nothing about now.
POSE_FRESH_S: Final = 1.5
HEARTBEAT_S: Final = 10.0
# Commands under way at once for one viewer; more would only wait for the sonar.
COMMANDS_AT_ONCE: Final = 8


class Annotations(Protocol):
    """What the link needs of the recordings store."""

    def annotations(self, name: str) -> list[dict[str, Any]]: ...
    def add_annotation(self, name: str, given: dict[str, Any]) -> dict[str, Any]: ...
    def change_annotation(self, name: str, annotation_id: str, given: dict[str, Any]) -> dict[str, Any]: ...
    def remove_annotation(self, name: str, annotation_id: str) -> None: ...


@dataclass(frozen=True, slots=True)
class ViewerFacts:
    """What the viewer is told at once when it connects, and again when it changes."""

    fed: Callable[[], Sequence[str]]
    settings: Callable[[], dict[str, Any]]
    recording: Callable[[], str | None]
    chips: Callable[[], list[dict[str, Any]]]


class ViewerLink:
    """Serves viewers on this machine that know the token: their commands go down, sonar answers come up."""

    def __init__(
        self,
        hub: Hub,
        token_file: Path,
        command: Callable[[Channel, bytes], Awaitable[CommandResult]],
        annotations: Annotations,
        facts: ViewerFacts,
    ) -> None:
        self._token_file = token_file
        self._token = secrets.token_hex(16)
        self._command = command
        self._annotations = annotations
        self._facts = facts
        self._queues: dict[web.WebSocketResponse, BoundedQueue[bytes]] = {}
        self._recording: str | None = None
        self._vehicle_s = -math.inf
        self._sample: SensorSample | None = None
        self._pose: NavState | None = None
        hub.subscribe(self._on_frames, SonarFrames, name="viewer link")
        hub.subscribe(self._on_sample, SensorSample, name="viewer link")
        hub.subscribe(self._on_ctd, CtdSample, name="viewer link")
        hub.subscribe(self._on_pose, NavState, name="viewer link")

    @property
    def viewers(self) -> int:
        """How many are connected."""
        return len(self._queues)

    def write_token(self) -> None:
        """Leave the token where only this user's processes can read it."""
        self._token_file.parent.mkdir(parents=True, exist_ok=True)
        fresh = self._token_file.with_name(f".{self._token_file.name}.new")
        fresh.unlink(missing_ok=True)
        descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(self._token)
        fresh.replace(self._token_file)

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """The aiohttp handler of /internal/viewer-link."""
        if not _is_loopback(request.remote):
            raise web.HTTPForbidden(text="this link is for the viewer on the same machine")
        if not is_bearer(request.headers.get("Authorization"), self._token):
            raise web.HTTPUnauthorized(text=f"wrong token; the present one is in {self._token_file}")
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, compress=False, max_msg_size=MESSAGE_BYTES, timeout=1.0)
        await socket.prepare(request)
        queue = self._queues[socket] = BoundedQueue("viewer link", QUEUE_LENGTH)
        self._greet(queue)
        _log.info("a viewer connected")
        try:
            async with asyncio.TaskGroup() as tasks:
                sender = tasks.create_task(_send_all(socket, queue), name="viewer link sender")
                await self._listen(socket, queue, tasks)
                sender.cancel()
        finally:
            queue.close()
            del self._queues[socket]
            _log.info("a viewer left")
        return socket

    async def close(self) -> None:
        """Let every viewer go."""
        for socket in tuple(self._queues):
            await socket.close(code=1001, message=b"shutting down")

    def tell_fed(self) -> None:
        """The forwarding targets changed."""
        self._send_all("fed", addresses=list(self._facts.fed()))

    def tell_settings(self) -> None:
        """A setting that concerns the viewer changed."""
        self._send_all("settings", **self._facts.settings())

    def tick(self) -> None:
        """Once a second: has the recording changed, and how is each part?"""
        name = self._facts.recording()
        if name != self._recording:
            self._recording = name
            self._send_all("recording", name=name)
        self._send_all("health", chips=self._facts.chips())

    def _greet(self, queue: BoundedQueue[bytes]) -> None:
        queue.put(_message("settings", **self._facts.settings()))
        queue.put(_message("fed", addresses=list(self._facts.fed())))
        queue.put(_message("recording", name=self._facts.recording()))
        queue.put(_message("health", chips=self._facts.chips()))

    async def _listen(
        self, socket: web.WebSocketResponse, queue: BoundedQueue[bytes], tasks: asyncio.TaskGroup
    ) -> None:
        busy = asyncio.Semaphore(COMMANDS_AT_ONCE)
        async for received in socket:
            if received.type is not WSMsgType.TEXT:
                continue
            try:
                message = orjson.loads(received.data)
                kind, number = message["type"], message["id"]
            except (ValueError, KeyError, TypeError):
                _log.warning("the viewer sent something unreadable")
                continue
            await busy.acquire()
            task = tasks.create_task(self._answer(kind, number, message, queue))
            task.add_done_callback(lambda _task: busy.release())

    async def _answer(self, kind: str, number: object, message: dict[str, Any], queue: BoundedQueue[bytes]) -> None:
        if kind == "command":
            result = await self._run_command(message)
            queue.put(_message("command_result", id=number, result=result.outcome, message=result.message))
        elif kind == "annotation":
            ok, found, text = await self._annotate(message)
            queue.put(_message("annotation_result", id=number, ok=ok, annotations=found, message=text))

    async def _run_command(self, message: dict[str, Any]) -> CommandResult:
        try:
            channel, frame = Channel(message["channel"]), bytes.fromhex(message["frame"])
        except (KeyError, ValueError, TypeError) as error:
            return CommandResult(CommandOutcome.REJECTED, f"unreadable command: {error}")
        return await self._command(channel, frame)

    async def _annotate(self, message: dict[str, Any]) -> tuple[bool, list[dict[str, Any]], str]:
        try:
            return True, await asyncio.to_thread(self._run_annotation, message), ""
        except RecordingError as error:
            return False, [], str(error)
        except OSError as error:
            return False, [], f"the recording cannot be written: {error.strerror or error}"
        except (KeyError, ValueError, TypeError) as error:
            return False, [], f"unreadable annotation: {error}"

    def _run_annotation(self, message: dict[str, Any]) -> list[dict[str, Any]]:
        store, given = self._annotations, dict(message.get("annotation") or {})
        match message["operation"]:
            case "list":
                return store.annotations("active")
            case "add":
                return [store.add_annotation("active", given)]
            case "change":
                return [store.change_annotation("active", str(given.pop("id")), given)]
            case "remove":
                store.remove_annotation("active", str(given["id"]))
                return []
            case unknown:
                raise ValueError(f"operation {unknown!r}, expected list, add, change or remove")

    def _on_frames(self, record: SonarFrames) -> None:
        if not self._queues:
            return
        for frame in record.frames:
            if frame[0] != KOGGER_SYNC[0] or frame[4] != KoggerId.CHART:
                self._send_all("sonar_frame", channel=record.channel, frame=frame.hex())

    def _on_sample(self, sample: SensorSample) -> None:
        self._sample = sample

    def _on_pose(self, pose: NavState) -> None:
        self._pose = pose

    def _on_ctd(self, ctd: CtdSample) -> None:
        sample = self._sample
        if not self._queues or sample is None or ctd.arrived_s - self._vehicle_s < VEHICLE_PERIOD_S * 0.9:
            return
        self._vehicle_s = ctd.arrived_s
        self._send_all("vehicle", **vehicle_json(sample, ctd), **pose_json(self._pose, ctd.arrived_s))

    def _send_all(self, kind: str, **values: Any) -> None:
        if self._queues:
            message = _message(kind, **values)
            for queue in self._queues.values():
                queue.put(message)


def vehicle_json(sample: SensorSample, ctd: CtdSample) -> dict[str, Any]:
    """Where the vehicle is and how it lies, as far as known."""
    yaw_deg = _degrees(sample.yaw_rad)
    return {
        "heading_deg": None if yaw_deg is None else yaw_deg % 360.0,
        "roll_deg": _degrees(sample.roll_rad),
        "pitch_deg": _degrees(sample.pitch_rad),
        "depth_m": ctd.depth_m,
        "latitude_deg": sample.gps_latitude_deg,
        "longitude_deg": sample.gps_longitude_deg,
        "sound_speed_mps": ctd.sound_speed_mps,
        "temperature_degc": ctd.temperature_degc,
    }


def pose_json(pose: NavState | None, now_s: float) -> dict[str, Any]:
    """What the navigator estimates, under names of its own: a GPS position and an estimate are two things."""
    place, within_m, heading_deg, heading_std_deg, altitude_m = None, None, None, None, None
    if pose is not None and abs(now_s - pose.measured_s) <= POSE_FRESH_S:
        altitude_m = pose.altitude_m
        if pose.origin_deg is not None and pose.position_ned_m is not None:
            place = LocalFrame(*pose.origin_deg).to_geodetic(*pose.position_ned_m)
            ellipse = error_ellipse(pose.pose_covariance)
            within_m = None if ellipse is None else round(ellipse.major_m, 2)
        if pose.quaternion_ned_frd is not None:
            heading_deg = _degrees(euler_angles_rad(pose.quaternion_ned_frd)[2])
        if pose.pose_covariance is not None:
            variance = float(pose.pose_covariance[5, 5])
            heading_std_deg = _degrees(math.sqrt(variance)) if math.isfinite(variance) and variance >= 0 else None
    return {
        "estimate": {
            "latitude_deg": None if place is None else round(place[0], 8),
            "longitude_deg": None if place is None else round(place[1], 8),
            "within_m": within_m,
            "heading_deg": heading_deg,
            "heading_std_deg": heading_std_deg,
            "altitude_m": altitude_m,
        }
    }


async def _send_all(socket: web.WebSocketResponse, queue: BoundedQueue[bytes]) -> None:
    try:
        while True:
            await socket.send_str((await queue.get()).decode())
    except (ConnectionError, QueueClosedError):
        return


def _message(kind: str, **values: Any) -> bytes:
    return orjson.dumps({"type": kind, **values})


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else round(math.degrees(angle_rad), 2)


def _is_loopback(remote: str | None) -> bool:
    try:
        address = ipaddress.ip_address((remote or "").partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback
