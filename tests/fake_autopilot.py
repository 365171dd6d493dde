"""An autopilot at the far end of a UDP endpoint, built on pymavlink: it takes ODOMETRY as ArduPilot does.

Frames it would drop are dropped, positions count from its own origin, the velocity is turned by the message's own
quaternion. Parameters answer, are set and can be stubborn.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import Quaternion
from pymavlink.rotmat import Vector3

EKF_PARAMETERS = {
    "AHRS_EKF_TYPE": 3.0,
    "EK3_ENABLE": 1.0,
    "VISO_TYPE": 0.0,
    "VISO_ORIENT": 0.0,
    "EK3_SRC1_POSXY": 3.0,
    "EK3_SRC1_VELXY": 3.0,
    "EK3_SRC1_POSZ": 1.0,
    "EK3_SRC1_VELZ": 3.0,
    "EK3_SRC1_YAW": 1.0,
    "EK3_GPS_TYPE": 3.0,
}


@dataclass
class Taken:
    """What the EKF got of one ODOMETRY."""

    message: Any
    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]


@dataclass
class FakeAutopilot(asyncio.DatagramProtocol):
    """System 1, component 1. `stubborn`: parameters that do not keep what is set; `deaf`: tells nothing about them."""

    parameters: dict[str, float] = field(default_factory=lambda: dict(EKF_PARAMETERS))
    stubborn: set[str] = field(default_factory=set)
    deaf: bool = False
    armed: bool = False
    origin: tuple[int, int] | None = None
    tells_origin: bool = True
    odometry: list[Taken] = field(default_factory=list)
    dropped_frames: int = 0
    writes: list[tuple[str, float]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def connection_made(self, transport: Any) -> None:
        self.transport = transport
        self.port = transport.get_extra_info("sockname")[1]
        self._parser = mavlink.MAVLink(None)
        self._mav = mavlink.MAVLink(None, 1, 1)
        self.peer: Any = None

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.peer = addr
        for message in self._parser.parse_buffer(bytearray(data)) or []:
            self.names.append(message.get_type())
            handler = getattr(self, f"_on_{message.get_type().lower()}", None)
            if handler is not None:
                handler(message)

    def say(self, message: Any) -> None:
        self.transport.sendto(bytes(message.pack(self._mav)), self.peer)

    def beat(self) -> None:
        mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        self.say(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_SUBMARINE, 3, mode, 0, 3, 3))

    def _on_heartbeat(self, _message: Any) -> None:
        self.beat()

    def _on_odometry(self, message: Any) -> None:
        if message.frame_id != mavlink.MAV_FRAME_LOCAL_FRD or message.child_frame_id != mavlink.MAV_FRAME_BODY_FRD:
            self.dropped_frames += 1
            return
        velocity = Quaternion(list(message.q)).dcm * Vector3(message.vx, message.vy, message.vz)
        self.odometry.append(Taken(message, (message.x, message.y, message.z), (velocity.x, velocity.y, velocity.z)))

    def _on_command_long(self, message: Any) -> None:
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE and message.param1 == 49.0:
            self._tell_origin()

    def _on_set_gps_global_origin(self, message: Any) -> None:
        if self.origin is None:
            self.origin = (message.latitude, message.longitude)
            self._tell_origin()

    def _tell_origin(self) -> None:
        if self.origin is not None and self.tells_origin:
            self.say(mavlink.MAVLink_gps_global_origin_message(*self.origin, 0))

    def _on_param_request_read(self, message: Any) -> None:
        self._tell_parameter(message.param_id)

    def _on_param_set(self, message: Any) -> None:
        if self.deaf or message.param_id not in self.parameters:
            return
        self.writes.append((message.param_id, message.param_value))
        before = self.parameters[message.param_id]
        self.parameters[message.param_id] = message.param_value
        self._tell_parameter(message.param_id)
        if message.param_id in self.stubborn:
            self.parameters[message.param_id] = before

    def _tell_parameter(self, name: str) -> None:
        if not self.deaf and name in self.parameters:
            value = self.parameters[name]
            self.say(mavlink.MAVLink_param_value_message(name.encode(), value, mavlink.MAV_PARAM_TYPE_INT8, 900, 65535))


async def fly(**options: Any) -> FakeAutopilot:
    """A new autopilot on a free port of the loopback."""
    loop = asyncio.get_running_loop()
    _, autopilot = await loop.create_datagram_endpoint(lambda: FakeAutopilot(**options), local_addr=("127.0.0.1", 0))
    return autopilot
