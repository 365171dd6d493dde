"""The guided calibrations while they run: fed with what the vehicle's sensors say, and their results taken up.

Two of them give the compass deviation: turning on the spot (B and C), or driving at the surface under GPS (A, too).
"""

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
from bluerov_slam.navigation.attitude.swing_routine import CourseSwingRoutine, TurnSwingRoutine
from bluerov_slam.navigation.attitude.thruster_field_routine import ThrusterFieldRoutine
from bluerov_slam.navigation.rotation import wrap_angle
from bluerov_slam.pipeline.navigator_commands import CalibrationProgress
from bluerov_slam.pipeline.navigator_position import align
from bluerov_slam.pipeline.navigator_start import THRUSTER_FIELD, thruster_field_std_rad
from bluerov_slam.pipeline.navigator_timeline import level_heading_rad

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from bluerov_slam.navigation.measurements import MagneticField
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_imu import ImuIntake
    from bluerov_slam.records import GpsFix, ImuBurst

    Array = NDArray[np.float64]

# The name of each result in `Calibration`, in the order in which they are best made.
FIELDS = {
    "gyro": "gyro",
    "accelerometer": "accelerometer",
    "magnetometer": "magnetometer",
    "thruster_field": "thruster_field",
    "swing": "compass",
    "course_swing": "compass",
}
INERTIAL = ("gyro", "accelerometer", "magnetometer")
THRUSTER_FIELD_PERIOD_S = 0.09
# A compass value and a GPS report are of one heading when they lie so near in time and the vehicle turns so slowly.
SAME_HEADING_S = 1.0
STRAIGHT_RADPS = math.radians(5.0)
# The bow must point where the vehicle goes through the water.
MOST_SIDEWAYS = 0.2
MAKERS: dict[str, Callable[[], Any]] = {
    "gyro": GyroRoutine,
    "accelerometer": AccelerometerRoutine,
    "magnetometer": MagnetometerRoutine,
    "swing": TurnSwingRoutine,
    "course_swing": CourseSwingRoutine,
}
NEVER = "Never calibrated."
MADE = "Calibrated."


class UnknownCalibrationError(ExpectedError):
    """There is no calibration of this kind, or it does not run."""


class Calibrations:
    """At most one routine of each kind runs at a time."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._running: dict[str, Any] = {}
        self._compass: tuple[float, float, float] | None = None
        self._thruster_field_s = -math.inf

    def feed(self, record: ImuBurst, imu: ImuIntake, field_raw: Array, effort: Array | None) -> None:
        """A burst, in the vehicle's axes, uncorrected, and what the thrusters draw meanwhile."""
        if not self._running:
            return
        self._feed_thruster_field(record, imu, field_raw, effort)
        forces = imu.mounted(record.acceleration_mps2).tolist()
        rates = imu.mounted(record.angular_rate_radps).tolist()
        for k, (force, rate, field) in enumerate(zip(forces, rates, field_raw.tolist(), strict=True)):
            sample = InertialSample(record.measured_s + k * record.interval_s, tuple(rate), tuple(force), tuple(field))
            for kind, routine in self._running.items():
                if kind in INERTIAL:
                    routine.feed(sample)

    def _feed_thruster_field(self, record: ImuBurst, imu: ImuIntake, field_raw: Array, effort: Array | None) -> None:
        routine = self._running.get("thruster_field")
        if routine is None or effort is None:
            return
        fields = self._core.calibration.magnetic_field(field_raw).tolist()
        rates = self._core.calibration.angular_rate(imu.mounted(record.angular_rate_radps)).tolist()
        for k, (field, rate) in enumerate(zip(fields, rates, strict=True)):
            at_s = record.measured_s + k * record.interval_s
            if not 0.0 <= at_s - self._thruster_field_s < THRUSTER_FIELD_PERIOD_S:
                self._thruster_field_s = at_s
                routine.feed(at_s, field, effort.tolist(), rate)

    def feed_heading(self, heading: MagneticField | None) -> None:
        """A compass value: what the magnetometer says, levelled by the filter, and how fast the heading turns."""
        timeline, rate = self._core.timeline, self._core.rate_frd_radps()
        if not self._running or heading is None or timeline is None or rate is None:
            return
        rotation = timeline.filter.estimate.rotation_ned_frd
        north, east, _ = (rotation @ np.asarray(heading.field_frd)).tolist()
        compass_rad = level_heading_rad(timeline.filter) + heading.declination_rad - math.atan2(east, north)
        self._compass = (heading.at_s, wrap_angle(compass_rad), float(rotation[2] @ rate))
        routine = self._running.get("swing")
        if routine is not None:
            routine.feed(*self._compass)

    def feed_course(self, record: GpsFix, water_frd_mps: tuple[float, float] | None) -> None:
        """A GPS report, and how fast the thrusters drive the vehicle ahead and to starboard, where they tell it."""
        routine, compass = self._running.get("course_swing"), self._compass
        if routine is None or compass is None:
            return
        at_s, compass_rad, rate_radps = compass
        if abs(record.measured_s - at_s) > SAME_HEADING_S or abs(rate_radps) > STRAIGHT_RADPS:
            return
        if self._core.options.thrust.layout is None:
            routine.feed(compass_rad, record.speed_mps, record.course_rad)
        elif water_frd_mps is not None and abs(water_frd_mps[1]) <= MOST_SIDEWAYS * water_frd_mps[0]:
            routine.feed(compass_rad, record.speed_mps, record.course_rad, water_frd_mps[0])

    def start(self, kind: str) -> str:
        """Begin (anew); what the user does now. Raises CalibrationError where something else must come first."""
        self._running[kind] = routine = self._make(kind)
        return str(routine.instruction)

    def _make(self, kind: str) -> Any:
        if kind != "thruster_field":
            if kind not in MAKERS:
                raise UnknownCalibrationError(f"there is no calibration of the kind {kind!r}")
            return MAKERS[kind]()
        layout = self._core.options.thrust.layout
        if layout is None:
            raise CalibrationError("which channel drives which thruster is not known: choose the frame in the settings")
        if self._core.calibration.magnetometer is None:
            raise CalibrationError("calibrate the magnetometer first: the thrusters' field is measured against it")
        return ThrusterFieldRoutine(len(layout.thrusters))

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
        return [self._progress(kind) for kind in FIELDS]

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
        elif kind == "thruster_field":
            buffer.reset_block(THRUSTER_FIELD, (0.0, 0.0), thruster_field_std_rad(core.options, core.calibration))
        else:
            align(core, 0.0)


__all__ = ["CalibrationError", "Calibrations", "UnknownCalibrationError"]
