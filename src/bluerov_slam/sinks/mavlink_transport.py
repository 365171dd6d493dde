"""The two ways MAVLink leaves and enters: UDP to a router's endpoint, or mavlink2rest's WebSocket.

Both speak in (message name, fields): a frame is parsed only if somebody wants its message, because a vehicle's
router hands out some hundred messages a second and we use a tenth of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import aiohttp
import orjson
from pymavlink.dialects.v20 import ardupilotmega as mavlink

_log = logging.getLogger(__name__)

OnMessage = Callable[[int, int, str, Mapping[str, Any]], None]
"""Called with (system id, component id, message name, fields)."""

WANTED = (
    "HEARTBEAT", "ATTITUDE", "GPS_RAW_INT", "SERVO_OUTPUT_RAW", "BATTERY_STATUS", "VISION_POSITION_DELTA",
    "SCALED_PRESSURE2", "DISTANCE_SENSOR", "GPS_INPUT", "GPS_GLOBAL_ORIGIN", "PARAM_VALUE",
)  # fmt: skip
WANTED_IDS = frozenset(getattr(mavlink, f"MAVLINK_MSG_ID_{name}") for name in WANTED)
RETRY_S = 2.0
# A failure that is not repeated for so long is over: nothing tells that a datagram arrived.
ERROR_SHOWN_S = 5.0
SEND_QUEUE_MESSAGES = 100


class Transport(Protocol):
    """What the bridge needs of a way out."""

    peer: str
    bad_frames: int

    @property
    def error(self) -> str | None: ...
    async def start(self) -> None: ...
    async def stop(self) -> None: ...
    def send(self, name: str, fields: Mapping[str, Any]) -> bool: ...


class UdpTransport(asyncio.DatagramProtocol):
    """MAVLink v2 frames to one UDP address; only answers from that very address are heard."""

    def __init__(self, host: str, port: int, system_id: int, component_id: int, on_message: OnMessage) -> None:
        self.peer = f"{host}:{port}"
        self.bad_frames = 0
        self._error: tuple[float, str] | None = None
        self._address = (host, port)
        self._on_message = on_message
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._transport: asyncio.DatagramTransport | None = None
        self._opening: asyncio.Task[None] | None = None

    @property
    def error(self) -> str | None:
        """Why sending failed lately."""
        if self._error is None or time.monotonic() - self._error[0] > ERROR_SHOWN_S:
            return None
        return self._error[1]

    async def start(self) -> None:
        self._opening = asyncio.create_task(self._open(), name="mavlink-udp")

    async def stop(self) -> None:
        if self._opening is not None:
            self._opening.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._opening
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def send(self, name: str, fields: Mapping[str, Any]) -> bool:
        if self._transport is None:
            return False
        frame = _message(name, fields).pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        self._transport.sendto(bytes(frame))
        return True

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._error = None
        for frame in wanted_frames(data):
            try:
                message = self._mav.decode(bytearray(frame))
            except mavlink.MAVError:
                self.bad_frames += 1
                continue
            self._on_message(message.get_srcSystem(), message.get_srcComponent(), message.get_type(), message.to_dict())

    def error_received(self, exc: Exception) -> None:
        # A refusal means that nobody listens there yet: "nobody answers" says so, and how to cure it.
        if not isinstance(exc, ConnectionRefusedError):
            self._fail(exc)

    def _fail(self, error: Exception) -> None:
        self._error = (time.monotonic(), (error.strerror if isinstance(error, OSError) else None) or str(error))

    async def _open(self) -> None:
        """Open the socket; a name that does not resolve or a missing network is tried again."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                self._transport, _ = await loop.create_datagram_endpoint(lambda: self, remote_addr=self._address)
            except OSError as error:
                self._fail(error)
                await asyncio.sleep(RETRY_S)
            else:
                return


class Mavlink2RestTransport:
    """The same messages as JSON through mavlink2rest, for those whose router has no endpoint to spare."""

    def __init__(self, url: str, system_id: int, component_id: int, on_message: OnMessage) -> None:
        self.peer = url
        self.error: str | None = None
        self.bad_frames = 0
        self._url = f"{url}?filter={'|'.join(WANTED)}"
        self._header = {"system_id": system_id, "component_id": component_id}
        self._sequence = 0
        self._on_message = on_message
        self._outgoing: asyncio.Queue[bytes] = asyncio.Queue(SEND_QUEUE_MESSAGES)
        self._connected = False
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        self._task = asyncio.create_task(self._run(), name="mavlink2rest")

    async def stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    def send(self, name: str, fields: Mapping[str, Any]) -> bool:
        # JSON has no NaN: a message with an unknown value cannot go this way, and zero would be a lie.
        unknown = any(_has_unknown(value) for value in fields.values())
        if unknown or not self._connected or self._outgoing.full():
            return False
        header = self._header | {"sequence": self._sequence}
        self._sequence = (self._sequence + 1) % 256
        self._outgoing.put_nowait(orjson.dumps({"header": header, "message": rest_message(name, fields)}))
        return True

    async def _run(self) -> None:
        async with aiohttp.ClientSession() as session:
            while True:
                try:
                    async with session.ws_connect(self._url, max_msg_size=1 << 20, heartbeat=20.0) as socket:
                        self.error, self._connected = None, True
                        await self._exchange(socket)
                except (aiohttp.ClientError, OSError, TimeoutError) as error:
                    self.error = str(error) or type(error).__name__
                finally:
                    self._connected = False
                await asyncio.sleep(RETRY_S)

    async def _exchange(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        sender = asyncio.create_task(self._send_all(socket))
        try:
            async for message in socket:
                if message.type is aiohttp.WSMsgType.TEXT:
                    self._receive(message.data)
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError, aiohttp.ClientError):
                await sender

    async def _send_all(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        while True:
            await socket.send_str((await self._outgoing.get()).decode())

    def _receive(self, text: str) -> None:
        try:
            document = orjson.loads(text)
            header, message = document["header"], document["message"]
            name, system_id, component_id = message["type"], int(header["system_id"]), int(header["component_id"])
        except (orjson.JSONDecodeError, KeyError, TypeError, ValueError):
            self.bad_frames += 1
            return
        if name in WANTED:
            self._on_message(system_id, component_id, name, message)


def _has_unknown(value: object) -> bool:
    if isinstance(value, list):
        return any(map(_has_unknown, value))
    return isinstance(value, float) and not math.isfinite(value)


def wanted_frames(datagram: bytes) -> list[bytes]:
    """The MAVLink frames (v1 or v2) of one datagram whose message somebody wants; the rest is skipped unparsed."""
    frames: list[bytes] = []
    at, size = 0, len(datagram)
    while size - at >= 8:
        magic = datagram[at]
        if magic == mavlink.PROTOCOL_MARKER_V2 and size - at >= 12:
            # Bit 0 of the incompatibility flags: a 13-byte signature follows the checksum.
            length = datagram[at + 1] + 12 + (13 if datagram[at + 2] & 1 else 0)
            message_id = int.from_bytes(datagram[at + 7 : at + 10], "little")
        elif magic == mavlink.PROTOCOL_MARKER_V1:
            length = datagram[at + 1] + 8
            message_id = datagram[at + 5]
        else:
            at += 1
            continue
        if at + length > size:
            break
        if message_id in WANTED_IDS:
            frames.append(datagram[at : at + length])
        at += length
    return frames


def rest_message(name: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    """`fields` as mavlink2rest wants them: enums by name, text as single padded characters."""
    message: dict[str, Any] = {"type": name}
    for key, value in fields.items():
        enum = _REST_ENUMS.get((name, key))
        if enum is not None:
            message[key] = {"type": mavlink.enums[enum][value].name}
        elif key == "base_mode":
            message[key] = {"bits": value}
        elif isinstance(value, bytes):
            width = _REST_TEXT_WIDTH[name, key]
            message[key] = list(value.decode("ascii", "replace")[:width].ljust(width, "\0"))
        else:
            message[key] = value
    return message


_REST_ENUMS = {
    ("HEARTBEAT", "type"): "MAV_TYPE",
    ("HEARTBEAT", "autopilot"): "MAV_AUTOPILOT",
    ("HEARTBEAT", "system_status"): "MAV_STATE",
    ("GPS_RAW_INT", "fix_type"): "GPS_FIX_TYPE",
    ("STATUSTEXT", "severity"): "MAV_SEVERITY",
    ("COMMAND_LONG", "command"): "MAV_CMD",
    ("PARAM_SET", "param_type"): "MAV_PARAM_TYPE",
}
_REST_TEXT_WIDTH = {
    ("NAMED_VALUE_FLOAT", "name"): 10,
    ("STATUSTEXT", "text"): 50,
    ("PARAM_SET", "param_id"): 16,
    ("PARAM_REQUEST_READ", "param_id"): 16,
}


def _message(name: str, fields: Mapping[str, Any]) -> Any:
    return getattr(mavlink, f"MAVLink_{name.lower()}_message")(**fields)
