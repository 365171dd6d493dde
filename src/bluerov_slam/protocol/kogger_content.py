"""Content that we send ourselves, so that KoggerApp and its files know attitude, position, temperature and time.

Angles and positions arrive in our own units; the wire's are in each docstring.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import degrees, pi, radians

from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrame, KoggerId, build_frame

_ATTITUDE = struct.Struct("<3h")
_TEMPERATURE = struct.Struct("<h")
_TIMESTAMP_V0 = struct.Struct("<I")
_TIMESTAMP_V1 = struct.Struct("<2I")
_NAVIGATION_V1 = struct.Struct("<3f2df")
_NAVIGATION_V2 = struct.Struct("<2BIh2i5h")
_MAX_SPEED_MPS = 32.767


@dataclass(frozen=True, slots=True)
class Attitude:
    """ATTITUDE v0: yaw, pitch, roll in 0.01 deg. KoggerApp takes all zero for no attitude."""

    yaw_rad: float
    pitch_rad: float
    roll_rad: float

    def to_bytes(self, route: int = 0) -> bytes:
        angles = map(_centidegrees, (self.yaw_rad, self.pitch_rad, self.roll_rad))
        return build_frame(KoggerId.ATTITUDE, _ATTITUDE.pack(*angles), route=route)


@dataclass(frozen=True, slots=True)
class Temperature:
    """TEMP v0: 0.01 degC."""

    temperature_degc: float

    def to_bytes(self, route: int = 0) -> bytes:
        return build_frame(KoggerId.TEMPERATURE, _TEMPERATURE.pack(round(self.temperature_degc * 100)), route=route)


@dataclass(frozen=True, slots=True)
class Timestamp:
    """TIMESTAMP v0 (ms since the device started) or, with a wall clock, v1 (ms and unix seconds)."""

    device_ms: int
    unix_s: int | None = None

    def to_bytes(self, route: int = 0) -> bytes:
        device_ms = self.device_ms & 0xFFFFFFFF
        if self.unix_s is None:
            return build_frame(KoggerId.TIMESTAMP, _TIMESTAMP_V0.pack(device_ms), route=route)
        return build_frame(KoggerId.TIMESTAMP, _TIMESTAMP_V1.pack(device_ms, self.unix_s), version=1, route=route)


@dataclass(frozen=True, slots=True)
class NavigationDepth:
    """NAV v1: attitude and position in degrees, depth in metres; KoggerApp records it without time."""

    latitude_deg: float
    longitude_deg: float
    depth_m: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float

    def to_bytes(self, route: int = 0) -> bytes:
        angles = map(degrees, (self.yaw_rad, self.pitch_rad, self.roll_rad))
        payload = _NAVIGATION_V1.pack(*angles, self.latitude_deg, self.longitude_deg, self.depth_m)
        return build_frame(KoggerId.NAVIGATION, payload, version=1, route=route)


@dataclass(frozen=True, slots=True)
class NavigationTime:
    """NAV v2: fix, UTC, position 1e-7 deg, course 0.01 deg, speed mm/s, attitude 0.01 deg; carries no depth."""

    fix: int
    satellites: int
    unix_ms: int
    latitude_deg: float
    longitude_deg: float
    course_rad: float
    speed_mps: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float

    def to_bytes(self, route: int = 0) -> bytes:
        speed_mps = min(max(self.speed_mps, -_MAX_SPEED_MPS), _MAX_SPEED_MPS)
        payload = _NAVIGATION_V2.pack(
            self.fix,
            self.satellites,
            self.unix_ms // 1000,
            self.unix_ms % 1000,
            round(self.latitude_deg * 1e7),
            round(self.longitude_deg * 1e7),
            _centidegrees(self.course_rad),
            round(speed_mps * 1000),
            *map(_centidegrees, (self.yaw_rad, self.pitch_rad, self.roll_rad)),
        )
        return build_frame(KoggerId.NAVIGATION, payload, version=2, route=route)


KoggerContent = Attitude | Temperature | Timestamp | NavigationDepth | NavigationTime


def parse_content(frame: KoggerFrame) -> KoggerContent | None:
    """What one of the frames above says; None for any other frame and for a short one."""
    if frame.frame_type != FrameType.CONTENT or frame.response:
        return None
    layout = _LAYOUTS.get((frame.frame_id, frame.version))
    if layout is None or len(frame.payload) < layout.size:
        return None
    values = layout.unpack_from(frame.payload)
    if layout is _ATTITUDE:
        return Attitude(*(radians(value / 100) for value in values))
    if layout is _TEMPERATURE:
        return Temperature(values[0] / 100)
    if layout is _NAVIGATION_V1:
        yaw_deg, pitch_deg, roll_deg, latitude_deg, longitude_deg, depth_m = values
        return NavigationDepth(
            latitude_deg, longitude_deg, depth_m, radians(yaw_deg), radians(pitch_deg), radians(roll_deg)
        )
    if layout is _NAVIGATION_V2:
        fix, satellites, unix_s, milliseconds, latitude, longitude, course, speed, *angles = values
        return NavigationTime(
            fix,
            satellites,
            unix_s * 1000 + milliseconds,
            latitude / 1e7,
            longitude / 1e7,
            radians(course / 100),
            speed / 1000,
            *(radians(angle / 100) for angle in angles),
        )
    return Timestamp(*values)


_LAYOUTS: dict[tuple[int, int], struct.Struct] = {
    (KoggerId.TIMESTAMP, 0): _TIMESTAMP_V0,
    (KoggerId.TIMESTAMP, 1): _TIMESTAMP_V1,
    (KoggerId.ATTITUDE, 0): _ATTITUDE,
    (KoggerId.TEMPERATURE, 0): _TEMPERATURE,
    (KoggerId.NAVIGATION, 1): _NAVIGATION_V1,
    (KoggerId.NAVIGATION, 2): _NAVIGATION_V2,
}


def _centidegrees(angle_rad: float) -> int:
    """0.01 deg in -18000..17999: a signed field holds no course of 350 deg."""
    wrapped_rad = (angle_rad + pi) % (2 * pi) - pi
    return (round(degrees(wrapped_rad) * 100) + 18_000) % 36_000 - 18_000
