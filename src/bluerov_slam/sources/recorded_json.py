"""The records that a recording holds as JSON and that no link bytes can give back: the way back from JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import orjson

from bluerov_slam.records import (
    AcousticBytes,
    FixType,
    GpsFix,
    NavMode,
    NavSensor,
    NavState,
    PositionFix,
    Record,
    SensorTrust,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleRange,
    VehicleRecord,
    VehicleServoOutput,
)

VEHICLE_TOPICS: dict[str, type[VehicleRecord]] = {
    "/vehicle/attitude": VehicleAttitude,
    "/vehicle/servo_output": VehicleServoOutput,
    "/vehicle/battery": VehicleBattery,
    "/vehicle/motion_delta": VehicleMotionDelta,
    "/vehicle/depth": VehicleDepth,
    "/vehicle/range": VehicleRange,
}
POSITION_FIX_TOPIC = "/position_fix"
GPS_TOPIC = "/gps"
NAVIGATION_TOPIC = "/navigation"
ACOUSTIC_RAW_TOPIC = "/acoustics/raw"


def read_record(topic: str, data: bytes) -> Record | None:
    """The record that was written as JSON; None if it was not written by this program."""
    try:
        fields = orjson.loads(data)
        return _READERS[topic](fields)
    except (AttributeError, KeyError, TypeError, ValueError):
        return None


def read_datagram(data: bytes, arrived_s: float) -> AcousticBytes | None:
    """A datagram of an acoustic board with its sender; None if it was cut off."""
    if not data or len(data) < 1 + data[0]:
        return None
    return AcousticBytes(data[1 + data[0] :], arrived_s, data[1 : 1 + data[0]].decode(errors="replace"))


def _plain(kind: Callable[..., Record]) -> Callable[[Mapping[str, Any]], Record]:
    """For records whose fields are numbers, words and tuples of numbers."""
    return lambda fields: kind(**{name: _tupled(value) for name, value in fields.items()})


def _gps_fix(fields: Mapping[str, Any]) -> GpsFix:
    return GpsFix(**{**fields, "fix": FixType(fields["fix"])})


def _navigation(fields: Mapping[str, Any]) -> NavState:
    values = {name: _tupled(value) for name, value in fields.items()}
    values["mode"] = NavMode(fields["mode"])
    for name in ("pose_covariance", "velocity_covariance_m2ps2"):
        values[name] = None if fields[name] is None else np.array(fields[name], dtype=np.float64)
    values["sensors"] = tuple(NavSensor(**{**each, "trust": SensorTrust(each["trust"])}) for each in fields["sensors"])
    return NavState(**values)


def _tupled(value: Any) -> Any:
    """JSON has no NaN: null among numbers was one."""
    return tuple(math.nan if each is None else each for each in value) if isinstance(value, list) else value


_READERS: dict[str, Callable[[Mapping[str, Any]], Record]] = {
    **{topic: _plain(kind) for topic, kind in VEHICLE_TOPICS.items()},
    POSITION_FIX_TOPIC: _plain(PositionFix),
    GPS_TOPIC: _gps_fix,
    NAVIGATION_TOPIC: _navigation,
}
