"""Gyro bias: leave the vehicle alone for ten seconds."""

from __future__ import annotations

import math

import numpy as np

from bluerov_slam.navigation.attitude.calibration import CalibrationError, GyroCalibration, Provenance, vector
from bluerov_slam.navigation.attitude.routine import InertialSample, RoutineState, StillWindows, Window, angle_rad

WINDOWS = 10
# A gyro of this class starts with at most 1 deg/s; more is a slow turn.
LARGEST_BIAS_RADPS = math.radians(3.0)
# Bias instability of consumer gyros, 5 to 25 deg/h: no mean is better than this.
_FLOOR_RADPS = math.radians(0.003)
_RATE_CHANGE_RADPS = math.radians(0.25)
_TILT_CHANGE_RAD = math.radians(0.4)
_FIELD_CHANGE_RAD = math.radians(3.0)


class GyroRoutine:
    """Averages the rates of a still vehicle, and begins again whenever it moves.

    A turn so slow and even that it looks like a bias is caught by gravity and the magnetic field turning with it.
    """

    kind = "gyro"

    def __init__(self) -> None:
        self._cutter = StillWindows()
        self._windows: list[Window] = []
        self._trouble = ""

    @property
    def state(self) -> RoutineState:
        """READY after ten still seconds."""
        return RoutineState.READY if len(self._windows) >= WINDOWS else RoutineState.RUNNING

    @property
    def progress(self) -> float:
        """Share of the ten seconds."""
        return min(1.0, len(self._windows) / WINDOWS)

    @property
    def instruction(self) -> str:
        """What to do now."""
        if self.state is RoutineState.READY:
            return "Done: the vehicle was still long enough."
        return f"{self._trouble}Leave the vehicle on firm ground and do not touch it."

    def feed(self, sample: InertialSample) -> None:
        """Take one sample."""
        window = self._cutter.feed(sample)
        if window is None:
            return
        trouble = self._objection(window)
        if trouble:
            self._trouble = trouble
            self._windows = [window] if window.still and trouble.startswith("It moved") else []
        elif len(self._windows) < 6 * WINDOWS:
            self._windows.append(window)

    def finish(self, made_unix_s: float | None = None) -> GyroCalibration:
        """The mean rate. Raises CalibrationError before ten still seconds."""
        if self.state is not RoutineState.READY:
            seconds = len(self._windows)
            raise CalibrationError(
                f"only {seconds} still seconds of {WINDOWS}: leave the vehicle alone and start again"
            )
        means = np.array([window.rate_radps for window in self._windows])
        bias, spread = means.mean(axis=0), means.std(axis=0, ddof=1)
        std = np.maximum(spread / math.sqrt(len(means)), _FLOOR_RADPS)
        made = Provenance(
            residual=math.degrees(float(np.sqrt((spread**2).mean()))),
            unit="deg/s",
            source=f"{len(means)} s at rest",
            samples=sum(window.samples for window in self._windows),
            made_unix_s=made_unix_s,
        )
        return GyroCalibration(vector(bias), vector(std), made)

    def _objection(self, window: Window) -> str:
        if window.still is None:
            return "The sensor's values do not change at all: check the sensor. "
        if not window.still:
            return "It moved: begin again. "
        if float(np.abs(window.rate_radps).max()) > LARGEST_BIAS_RADPS:
            degrees = math.degrees(float(np.abs(window.rate_radps).max()))
            return f"It turns at {degrees:.1f} deg/s, more than any bias. "
        if self._windows:
            first = self._windows[0]
            turned = angle_rad(window.force_mps2, first.force_mps2) > _TILT_CHANGE_RAD
            if window.field_raw is not None and first.field_raw is not None:
                turned = turned or angle_rad(window.field_raw, first.field_raw) > _FIELD_CHANGE_RAD
            if turned or float(np.abs(window.rate_radps - first.rate_radps).max()) > _RATE_CHANGE_RADPS:
                return "It moved slowly: begin again. "
        return ""
