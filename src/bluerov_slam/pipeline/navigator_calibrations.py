"""The guided calibrations while they run: fed with what the vehicle's sensors say, and their results taken up."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.errors import ExpectedError
from bluerov_slam.navigation.attitude.accelerometer_routine import AccelerometerRoutine
from bluerov_slam.navigation.attitude.calibration import CalibrationError
from bluerov_slam.navigation.attitude.gyro_routine import GyroRoutine
from bluerov_slam.navigation.attitude.magnetometer_routine import MagnetometerRoutine
from bluerov_slam.navigation.attitude.routine import InertialSample, RoutineState
from bluerov_slam.navigation.attitude.swing_routine import TurnSwingRoutine
from bluerov_slam.navigation.rotation import wrap_angle
from bluerov_slam.pipeline.navigator_commands import CalibrationProgress
from bluerov_slam.pipeline.navigator_position import align
from bluerov_slam.pipeline.navigator_timeline import level_heading_rad

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from bluerov_slam.navigation.measurements import MagneticField
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_imu import ImuIntake
    from bluerov_slam.records import ImuBurst

    Array = NDArray[np.float64]

MAKERS: dict[str, Callable[[], Any]] = {
    "gyro": GyroRoutine,
    "accelerometer": AccelerometerRoutine,
    "magnetometer": MagnetometerRoutine,
    "swing": TurnSwingRoutine,
}
# The name of each result in `Calibration`.
FIELDS = {"gyro": "gyro", "accelerometer": "accelerometer", "magnetometer": "magnetometer", "swing": "compass"}
NEVER = "Never calibrated."
MADE = "Calibrated."


class UnknownCalibrationError(ExpectedError):
    """There is no calibration of this kind, or it does not run."""


class Calibrations:
    """At most one routine of each kind runs at a time."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._running: dict[str, Any] = {}

    def feed(self, record: ImuBurst, imu: ImuIntake, field_raw: Array) -> None:
        """A burst, in the vehicle's axes, uncorrected."""
        if not self._running:
            return
        forces = imu.mounted(record.acceleration_mps2).tolist()
        rates = imu.mounted(record.angular_rate_radps).tolist()
        for k, (force, rate, field) in enumerate(zip(forces, rates, field_raw.tolist(), strict=True)):
            sample = InertialSample(record.measured_s + k * record.interval_s, tuple(rate), tuple(force), tuple(field))
            for kind, routine in self._running.items():
                if kind != "swing":
                    routine.feed(sample)

    def feed_heading(self, heading: MagneticField | None) -> None:
        """A compass value: what the magnetometer says, levelled by the filter, and how fast the heading turns."""
        routine, timeline, rate = self._running.get("swing"), self._core.timeline, self._core.rate_frd_radps()
        if routine is None or heading is None or timeline is None or rate is None:
            return
        rotation = timeline.filter.estimate.rotation_ned_frd
        north, east, _ = (rotation @ np.asarray(heading.field_frd)).tolist()
        compass_rad = level_heading_rad(timeline.filter) + heading.declination_rad - math.atan2(east, north)
        routine.feed(heading.at_s, wrap_angle(compass_rad), float(rotation[2] @ rate))

    def start(self, kind: str) -> str:
        """Begin (anew); what the user does now."""
        if kind not in MAKERS:
            raise UnknownCalibrationError(f"there is no calibration of the kind {kind!r}")
        self._running[kind] = routine = MAKERS[kind]()
        return str(routine.instruction)

    def finish(self, kind: str, unix_s: float | None) -> str:
        """Take the result up. Raises CalibrationError, which says what was wrong with it."""
        routine = self._routine(kind)
        result = routine.finish(unix_s)
        del self._running[kind]
        self._take(kind, result)
        return f"Calibrated: {result.made.residual:.2g} {result.made.unit} are left ({result.made.source})"

    def cancel(self, kind: str) -> str:
        """Forget the running one."""
        self._routine(kind)
        del self._running[kind]
        return "The calibration was stopped; the one before stays"

    def clear(self, kind: str) -> str:
        """Forget the saved one."""
        if kind not in FIELDS:
            raise UnknownCalibrationError(f"there is no calibration of the kind {kind!r}")
        self._take(kind, None)
        return "The calibration was removed"

    def progress(self) -> list[CalibrationProgress]:
        """Every kind, in the order in which they are best made."""
        return [self._progress(kind) for kind in MAKERS]

    def _progress(self, kind: str) -> CalibrationProgress:
        routine = self._running.get(kind)
        result = getattr(self._core.calibration, FIELDS[kind])
        made = None if result is None else result.made
        residual, unit = (None, "") if made is None else (made.residual, made.unit)
        dated = None if made is None else made.made_unix_s
        if routine is not None:
            state = "ready" if routine.state is RoutineState.READY else "running"
            return CalibrationProgress(kind, state, routine.progress, routine.instruction, residual, unit, dated)
        state, text = ("none", NEVER) if made is None else ("done", MADE)
        return CalibrationProgress(kind, state, None, text, residual, unit, dated)

    def _routine(self, kind: str) -> Any:
        if kind not in self._running:
            raise UnknownCalibrationError(f"no calibration of the kind {kind!r} is running: start it first")
        return self._running[kind]

    def _take(self, kind: str, result: Any) -> None:
        core = self._core
        core.calibration = replace(core.calibration, **{FIELDS[kind]: result})
        if core.timeline is None:
            return
        buffer = core.timeline.buffer
        if kind == "gyro":
            std = core.options.imu.gyro_bias_std_radps if result is None else result.std_radps
            buffer.reset_block("gyro_bias", 0.0 if result is None else (0.0, 0.0, 0.0), std)
        elif kind == "accelerometer":
            buffer.reset_block("accel_bias", (0.0, 0.0, 0.0), core.options.imu.accelerometer_bias_std_mps2)
        else:
            align(core, 0.0)


__all__ = ["CalibrationError", "Calibrations", "UnknownCalibrationError"]
