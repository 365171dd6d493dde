"""The newest reading of every sensor: as the seed's JSON on both WebSockets and in the answers of the HTTP API."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, Final

import orjson

from bluerov_slam.protocol.sensor_json import sensor_json
from bluerov_slam.records import (
    Channel,
    CtdSample,
    FixType,
    GpsFix,
    Sender,
    SensorSample,
    VehicleMotionDelta,
)
from bluerov_slam.services.hub import Hub
from bluerov_slam.sinks.websocket import Broadcaster

# A GPS report or a DVL measurement older than this says nothing about now.
FRESH_S: Final = 5.0
DVL_FRESH_S: Final = 2.0
_FIX_NAMES: Final = {FixType.NONE: "none", FixType.FIX_2D: "2d", FixType.FIX_3D: "3d"}
_FLAGS: Final = ("alive", "ok")
_NOTHING_YET: Final = SensorSample(
    measured_s=0.0, arrived_s=0.0, device_ms=0, sender=Sender.LEGACY, roll_rad=None, pitch_rad=None, yaw_rad=None,
    acceleration_frd_mps2=None, imu_packets=0, imu_errors=0, imu_alive=False, gps_latitude_deg=None,
    gps_longitude_deg=None, gps_altitude_m=None, gps_satellites=0, gps_alive=False, conductivity_s_per_m=None,
    ec_salinity_psu=None, ec_alive=False, pressure_pa=None, depth_sensor_temperature_degc=None, depth_ok=False,
    temperature_degc=None, temperature_ok=False, sound_speed_wire_mps=None, depth_wire_m=None, salinity_wire_psu=None,
    a_packets=0, a_bytes=0, b_packets=0, b_bytes=0,
)  # fmt: skip


class SensorFeed:
    """Publishes each SENSORS frame: bare on `bare` (the seed's port), with what we know beyond it on `topics`."""

    def __init__(
        self,
        hub: Hub,
        bare: Broadcaster,
        topics: Broadcaster,
        *,
        alive: Callable[[Channel], bool],
        unix_s: Callable[[float], float],
        now_s: Callable[[], float],
    ) -> None:
        self.sample: SensorSample | None = None
        self.ctd: CtdSample | None = None
        self._gps: GpsFix | None = None
        self._motion: VehicleMotionDelta | None = None
        self._bare = bare
        self._topics = topics
        self._alive = alive
        self._unix_s = unix_s
        self._now_s = now_s
        hub.subscribe(self._on_sample, SensorSample, name="sensor feed")
        hub.subscribe(self._on_ctd, CtdSample, name="sensor feed")
        hub.subscribe(self._on_gps, GpsFix, name="sensor feed")
        hub.subscribe(self._on_motion, VehicleMotionDelta, name="sensor feed")

    def latest(self) -> dict[str, Any]:
        """The newest frame in the seed's JSON; nothing is alive in an old one, and before the first all is null."""
        if self.sample is None:
            return {key: _unknown(part) for key, part in sensor_json(_NOTHING_YET, False, False).items()}
        latest = self._seed_json(self.sample)
        if self._now_s() - self.sample.arrived_s > FRESH_S:  # the link is down: what was, not what is
            for part in latest.values():
                if isinstance(part, dict):
                    part.update({flag: False for flag in _FLAGS if flag in part})
        return latest

    def ctd_json(self) -> dict[str, Any]:
        """What GET /api/ctd answers."""
        ctd = self.ctd
        if ctd is None:
            keys = ("depth_m", "temperature_c", "conductivity_us", "salinity_psu", "sound_velocity_ms", "pressure_mbar")
            return {"timestamp": None, **dict.fromkeys(keys)}
        return {
            "timestamp": datetime.fromtimestamp(self._unix_s(ctd.measured_s), UTC).isoformat(timespec="milliseconds"),
            "depth_m": _rounded(ctd.depth_m, 1.0, 3),
            "temperature_c": _rounded(ctd.temperature_degc, 1.0, 3),
            "conductivity_us": _rounded(ctd.conductivity_s_per_m, 1e4, 1),
            "salinity_psu": _rounded(ctd.salinity_psu, 1.0, 3),
            "sound_velocity_ms": _rounded(ctd.sound_speed_mps, 1.0, 2),
            "pressure_mbar": _rounded(ctd.pressure_pa, 1e-2, 2),
        }

    def dvl_json(self) -> dict[str, Any]:
        """What GET /api/dvl answers: zero and not valid unless a DVL on the vehicle reported within 2 s."""
        motion = self._motion
        if (
            motion is None
            or self._now_s() - motion.arrived_s > DVL_FRESH_S
            or motion.confidence_percent <= 0
            or motion.interval_s <= 0
        ):
            return {"vx": 0.0, "vy": 0.0, "vz": 0.0, "valid": False}
        vx, vy, vz = (round(metres / motion.interval_s, 4) for metres in motion.displacement_frd_m)
        return {"vx": vx, "vy": vy, "vz": vz, "valid": True}

    def extra(self) -> dict[str, Any]:
        """What is known beyond the seed's keys."""
        sample, ctd = self.sample, self.ctd
        assert sample is not None
        return {
            "salinity_psu": _rounded(ctd.salinity_psu, 1.0, 3) if ctd else None,
            "sound_speed_mps": _rounded(ctd.sound_speed_mps, 1.0, 2) if ctd else None,
            "depth_m": _rounded(ctd.depth_m, 1.0, 3) if ctd else None,
            "conductivity_us": _rounded(ctd.conductivity_s_per_m, 1e4, 1) if ctd else None,
            "gps_fix": self._fix_name(sample),
            "hdop": self._gps.hdop if self._gps_is_fresh(sample) and self._gps else None,
            "sender": "legacy" if sample.sender is Sender.LEGACY else "full_range",
            "measured_unix_s": round(self._unix_s(sample.measured_s), 4),
        }

    def _on_sample(self, sample: SensorSample) -> None:
        self.sample = sample

    def _on_ctd(self, ctd: CtdSample) -> None:
        """The CTD record follows its SENSORS record at once, so here both are known."""
        self.ctd = ctd
        sample = self.sample
        to_bare, to_topics = self._bare.wants("sensors"), self._topics.wants("sensors")
        if sample is None or not (to_bare or to_topics):
            return
        data = orjson.dumps(self._seed_json(sample))
        if to_bare:
            self._bare.publish_text("sensors", data)
        if to_topics:
            message = {
                "topic": "sensors",
                "t": round(self._unix_s(sample.arrived_s), 4),
                "data": orjson.Fragment(data),
                "extra": self.extra(),
            }
            self._topics.publish_text("sensors", orjson.dumps(message))

    def _on_gps(self, fix: GpsFix) -> None:
        self._gps = fix

    def _on_motion(self, motion: VehicleMotionDelta) -> None:
        self._motion = motion

    def _seed_json(self, sample: SensorSample) -> dict[str, Any]:
        ctd = self.ctd if self.ctd is not None and self.ctd.arrived_s == sample.arrived_s else None
        return sensor_json(sample, self._alive(Channel.A), self._alive(Channel.B), ctd)

    def _gps_is_fresh(self, sample: SensorSample) -> bool:
        return self._gps is not None and sample.arrived_s - self._gps.arrived_s <= FRESH_S

    def _fix_name(self, sample: SensorSample) -> str | None:
        """The receiver's word where it sends one; without it only the absence of a position is certain."""
        if self._gps_is_fresh(sample) and self._gps is not None:
            return _FIX_NAMES[self._gps.fix]
        return "none" if sample.gps_alive and sample.gps_latitude_deg is None else None


def _unknown(part: dict[str, Any] | int) -> dict[str, Any] | None:
    """The same keys with nothing known: counts too, because 0 packets would be a measurement."""
    return {key: False if key in _FLAGS else None for key in part} if isinstance(part, dict) else None


def _rounded(value: float | None, factor: float, digits: int) -> float | None:
    return None if value is None else round(value * factor, digits)
