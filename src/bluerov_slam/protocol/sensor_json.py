"""The sensor JSON of the WebSocket at :8766: the original keys, nesting and units, null for what is unknown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from bluerov_slam.protocol.sensor_frame import STANDARD_GRAVITY_MPS2

if TYPE_CHECKING:
    from bluerov_slam.records import CtdSample, SensorSample


def sensor_json(
    sample: SensorSample, a_alive: bool, b_alive: bool, ctd: CtdSample | None = None
) -> dict[str, dict[str, Any] | int]:
    """One sample for a client of the original system.

    `a_alive` and `b_alive` are derived from the packet counters. Where the short `ctd` fields of the wire are
    saturated, the value computed from the same sample (`ctd`) stands in. A GPS that is alive without a fix keeps
    `alive` true and has null coordinates.
    """
    acceleration = sample.acceleration_frd_mps2 or (None, None, None)
    return {
        "ts": sample.device_ms,
        "imu": {
            "r": _degrees(sample.roll_rad),
            "p": _degrees(sample.pitch_rad),
            "y": _degrees(sample.yaw_rad),
            "ax": _g(acceleration[0]),
            "ay": _g(acceleration[1]),
            "az": _g(acceleration[2]),
            "alive": sample.imu_alive and sample.roll_rad is not None,
        },
        "gps": {
            "lat": _rounded(sample.gps_latitude_deg, 7),
            "lon": _rounded(sample.gps_longitude_deg, 7),
            "alt": _rounded(sample.gps_altitude_m, 1),
            "sat": sample.gps_satellites,
            "alive": sample.gps_alive,
        },
        "ec": {
            "conductivity": _scaled(sample.conductivity_s_per_m, 1e4, 1),
            "salinity": _rounded(sample.ec_salinity_psu, 2),
            "alive": sample.ec_alive and sample.conductivity_s_per_m is not None,
        },
        "depth": {
            "press": _scaled(sample.pressure_pa, 1e-2, 2),
            "temp": _rounded(sample.depth_sensor_temperature_degc, 2),
            "ok": sample.depth_ok and sample.pressure_pa is not None,
        },
        "celsius": {
            "temp": _rounded(sample.temperature_degc, 2),
            "ok": sample.temperature_ok and sample.temperature_degc is not None,
        },
        "ctd": {
            "sv": _rounded(_first(sample.sound_speed_wire_mps, ctd.sound_speed_mps if ctd else None), 1),
            "d": _rounded(_first(sample.depth_wire_m, ctd.depth_m if ctd else None), 2),
            "s": _rounded(_first(sample.salinity_wire_psu, ctd.salinity_psu if ctd else None), 1),
            "t": _rounded(sample.temperature_degc, 2),
        },
        "ka": {"pkts": sample.a_packets, "bytes": sample.a_bytes, "alive": a_alive},
        "kb": {"pkts": sample.b_packets, "bytes": sample.b_bytes, "alive": b_alive},
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _scaled(value: float | None, factor: float, digits: int) -> float | None:
    return None if value is None else round(value * factor, digits)


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else round(math.degrees(angle_rad), 2)


def _g(acceleration_mps2: float | None) -> float | None:
    return None if acceleration_mps2 is None else round(acceleration_mps2 / STANDARD_GRAVITY_MPS2, 3)


def _first(wire: float | None, computed: float | None) -> float | None:
    return computed if wire is None else wire
