"""A navigator for tests of what surrounds one: states that look right, and nothing is estimated.

It believes compass angles and GPS as they come. A `GpsFix` with 99 satellites ends its process, one with 98 hangs it.
"""

from __future__ import annotations

import math
import os
import signal
import time
from dataclasses import dataclass, replace

import numpy as np

from bluerov_slam.navigation.seawater import WaterColumn
from bluerov_slam.pipeline.navigator import NavigatorAction, NavigatorCommand, NavigatorOptions, SavedNavigation
from bluerov_slam.pipeline.navigator_water import Water
from bluerov_slam.records import (
    CtdSample,
    Event,
    EventLevel,
    GpsFix,
    NavMode,
    NavSensor,
    NavState,
    PositionFix,
    Record,
    SensorSample,
    SensorTrust,
)

METRES_PER_DEGREE = 111_195.0
KILLER_SATELLITES = 99
HANGING_SATELLITES = 98
SPEED_MPS = 0.3
GROWTH_MPS = 0.05


@dataclass(frozen=True, slots=True)
class Progress:
    """As the contract's CalibrationProgress."""

    kind: str
    state: str
    progress: float | None = None
    instruction: str = ""
    residual: float | None = None
    unit: str = ""
    made_unix_s: float | None = None


class PlausibleNavigator:
    """Fixes set the position, a heading of the sensor and 0.3 m/s carry it on."""

    def __init__(
        self, options: NavigatorOptions, saved: SavedNavigation | None = None, saved_age_s: float | None = None
    ) -> None:
        self.options = options
        self._origin = options.origin_deg
        self._position = np.zeros(2)
        self._known = False
        self._std_m = 1.0
        self._depth_m: float | None = None
        self._heading: float | None = None
        self._tilt = (0.0, 0.0)
        self._at_s: float | None = None
        self._fix_s: float | None = None
        self._distance_m = 0.0
        self._resets = 0
        self._water = Water(0.016)
        self._counts = {"gps": [0, 0], "position": [0, 0], "depth": [0, 0], "compass": [0, 0]}
        kinds = ("gyro", "accelerometer", "magnetometer", "thruster_field", "swing", "course_swing")
        self._kinds = {kind: Progress(kind, "none") for kind in kinds}
        if saved is not None and saved.position_known:
            self._origin, self._known = saved.origin_deg, True
            self._position[:] = saved.values[:2]
            self._at_s, self._std_m = saved.at_s, saved.covariance[0] ** 0.5
            self._resets = saved.reset_counter + 1

    def feed(self, record: Record) -> list[NavState | Event]:
        if isinstance(record, CtdSample):
            self._depth_m = record.depth_m
            self._water.take(record, record.surface_pressure_pa)
        elif isinstance(record, GpsFix):
            if record.satellites == KILLER_SATELLITES:
                os.kill(os.getpid(), signal.SIGKILL)
            if record.satellites == HANGING_SATELLITES:
                time.sleep(3600.0)
            if record.latitude_deg is not None and record.longitude_deg is not None:
                self._take("gps", record.measured_s, record.latitude_deg, record.longitude_deg)
        elif isinstance(record, PositionFix):
            self._take("position", record.measured_s, record.latitude_deg, record.longitude_deg)
        elif isinstance(record, SensorSample):
            return [self._moved(record)]
        return []

    def command(self, command: NavigatorCommand) -> list[NavState | Event]:
        if command.action is NavigatorAction.SET_ORIGIN:
            if command.latitude_deg is None or command.longitude_deg is None:
                if self._origin is None:
                    return [Event(0.0, EventLevel.WARNING, "no position yet: give latitude and longitude")]
            else:
                self._origin = (command.latitude_deg, command.longitude_deg)
            self._position[:], self._resets = 0.0, self._resets + 1
        elif command.kind is not None:
            if command.kind not in self._kinds:
                raise ValueError(f"no calibration {command.kind}")
            state = {"start_calibration": "running", "finish_calibration": "done"}.get(command.action.value, "none")
            residual = 0.5 if state == "done" else None
            self._kinds[command.kind] = replace(self._kinds[command.kind], state=state, residual=residual)
        return [Event(0.0, EventLevel.INFO, f"{command.action.value}: done")]

    def expire(self, now_s: float) -> list[NavState | Event]:
        return []

    def save(self) -> SavedNavigation:
        return SavedNavigation(
            at_s=self._at_s or 0.0,
            origin_deg=self._origin,
            position_known=self._known,
            layout=(("position", 2),),
            values=(float(self._position[0]), float(self._position[1])),
            covariance=(self._std_m**2, 0.0, self._std_m**2),
            reset_counter=self._resets,
            calibration={"gyro": [0.0, 0.0, 0.0]},
        )

    def water_column(self) -> WaterColumn | None:
        return self._water.column

    def calibrations(self) -> list[Progress]:
        return list(self._kinds.values())

    def _take(self, name: str, at_s: float, latitude_deg: float, longitude_deg: float) -> None:
        if self._origin is None:
            self._origin = (latitude_deg, longitude_deg)
        east_scale = METRES_PER_DEGREE * math.cos(math.radians(self._origin[0]))
        fix = np.array([(latitude_deg - self._origin[0]) * METRES_PER_DEGREE,
                        (longitude_deg - self._origin[1]) * east_scale])  # fmt: skip
        if self._known and np.linalg.norm(fix - self._position) > 200.0:
            self._counts[name][1] += 1
            return
        self._counts[name][0] += 1
        self._position, self._known, self._std_m, self._fix_s = fix, True, 1.5, at_s

    def _moved(self, sample: SensorSample) -> NavState:
        elapsed_s = 0.0 if self._at_s is None else max(0.0, sample.measured_s - self._at_s)
        self._at_s = sample.measured_s
        if sample.yaw_rad is not None:
            self._heading = sample.yaw_rad
            self._tilt = (sample.roll_rad or 0.0, sample.pitch_rad or 0.0)
            self._counts["compass"][0] += 1
        if self._heading is not None and self._known:
            step_m = SPEED_MPS * elapsed_s
            self._position = self._position + step_m * np.array([math.cos(self._heading), math.sin(self._heading)])
            self._distance_m += step_m
            self._std_m += GROWTH_MPS * elapsed_s
        return self._state(sample)

    def _state(self, sample: SensorSample) -> NavState:
        heading, aided = self._heading, self._fix_s is not None and sample.measured_s - self._fix_s < 10.0
        velocity = None if heading is None else (SPEED_MPS * math.cos(heading), SPEED_MPS * math.sin(heading), 0.0)
        pose = np.diag([self._std_m**2, (0.5 * self._std_m) ** 2, 0.01, 3e-4, 3e-4, 2e-3])
        mode = NavMode.STARTING if heading is None else NavMode.ATTITUDE
        if self._known and heading is not None:
            mode = NavMode.AIDED if aided else NavMode.DEAD_RECKONING
        return NavState(
            measured_s=sample.measured_s,
            arrived_s=sample.arrived_s,
            mode=mode,
            origin_deg=self._origin if self._known else None,
            position_ned_m=(*map(float, self._position), self._depth_m or 0.0) if self._known else None,  # type: ignore[arg-type]
            velocity_ned_mps=velocity,
            quaternion_ned_frd=None if heading is None else quaternion(*self._tilt, heading),
            angular_rate_frd_radps=(0.0, 0.0, 0.0),
            pose_covariance=pose if self._known else None,
            velocity_covariance_m2ps2=np.diag([0.01, 0.01, 0.0004]),
            depth_m=self._depth_m,
            depth_std_m=None if self._depth_m is None else 0.1,
            altitude_m=None,
            current_ne_mps=(0.05, -0.02),
            current_std_mps=(0.1, 0.1),
            last_fix_s=self._fix_s,
            distance_m=self._distance_m,
            reset_counter=self._resets,
            sensors=tuple(self._sensor(name) for name in ("compass", "depth", "gps", "position")),
        )

    def _sensor(self, name: str) -> NavSensor:
        accepted, rejected = self._counts[name]
        trust = SensorTrust.USED if accepted else SensorTrust.ABSENT
        reason = "" if accepted else "never heard"
        return NavSensor(name, trust, reason, accepted, rejected, self._at_s if accepted else None, 1.0, accepted)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """(w, x, y, z) of Rz(yaw) Ry(pitch) Rx(roll), w >= 0."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    values = (cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy,
              cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy)  # fmt: skip
    sign = -1.0 if values[0] < 0 else 1.0
    return tuple(sign * value for value in values)  # type: ignore[return-value]
