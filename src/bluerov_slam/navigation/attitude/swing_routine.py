"""Compass deviation A, B, C: two slow turns on the spot, or driving around at the surface under GPS.

Turning, the reference is the gyro: it knows every change of heading but not where north is, so that B and C come out
and A stays as unknown as it was. Driving, the reference is the velocity over ground: at one speed through the water it
lies on a circle about the current, and the direction from the circle's centre is the true heading; all three come out,
and the current does no harm.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude import least_squares
from bluerov_slam.navigation.attitude.calibration import CalibrationError, CompassCalibration, Provenance, vector
from bluerov_slam.navigation.attitude.routine import JudgedRoutine, RoutineState

_TURN_RAD = 2.0 * math.pi
_TURNS = 2.0
_TURN_ENOUGH = 0.97
_FASTEST_RADPS = math.radians(30.0)
_GAP_S = 1.0
_SECTORS = 12
# Errors of a compass wander over tens of degrees: what counts is 10-degree bins, not samples.
_BIN_RAD = math.radians(10.0)
_LEAST_ERROR_RAD = math.radians(0.3)
_LARGEST_RESIDUAL_RAD = math.radians(4.0)
_LARGEST_DEVIATION_RAD = math.radians(30.0)
_UNKNOWN_A_RAD = math.radians(3.0)
_MOST_SAMPLES = 5000


class TurnSwingRoutine:
    """Two full slow turns, against the gyro."""

    kind = "swing"

    def __init__(self, unknown_a_std_rad: float = _UNKNOWN_A_RAD) -> None:
        self._unknown_a_std_rad = unknown_a_std_rad
        self._samples: list[tuple[float, float, float]] = []
        self._last_s: float | None = None
        self._last_rate = self._angle = self._lowest = self._highest = 0.0
        self._trouble = ""

    @property
    def state(self) -> RoutineState:
        """READY after two turns."""
        return RoutineState.READY if self.progress >= 1.0 else RoutineState.RUNNING

    @property
    def progress(self) -> float:
        """Share of the two turns."""
        return min(1.0, self._turned / (_TURN_ENOUGH * _TURNS * _TURN_RAD))

    @property
    def instruction(self) -> str:
        """What to do now."""
        if self.state is RoutineState.READY:
            return "Done: two turns were seen."
        left = max(0.0, _TURNS * _TURN_RAD - self._turned)
        degrees = math.degrees(left)
        return (
            f"{self._trouble}Keep level and turn slowly on the spot, always the same way: {degrees:.0f} degrees to go."
        )

    def feed(self, at_s: float, compass_rad: float, heading_rate_radps: float) -> None:
        """A compass reading (tilt-compensated, declination put on) and the rate of the heading by the gyro."""
        if not math.isfinite(at_s + compass_rad + heading_rate_radps):
            return
        if self._last_s is not None:
            interval_s = at_s - self._last_s
            if not 0.0 < interval_s <= _GAP_S:
                self._begin_again("The data had a gap: begin again. ")
            elif abs(heading_rate_radps) > _FASTEST_RADPS:
                self._begin_again("Too fast, 30 degrees per second at most: begin again. ")
            else:
                self._angle += 0.5 * (heading_rate_radps + self._last_rate) * interval_s
        self._lowest, self._highest = min(self._lowest, self._angle), max(self._highest, self._angle)
        self._last_s, self._last_rate = at_s, heading_rate_radps
        self._samples.append((at_s, self._angle, compass_rad))
        if len(self._samples) > _MOST_SAMPLES:
            self._samples = self._samples[::2]

    def finish(self, made_unix_s: float | None = None) -> CompassCalibration:
        """B and C, with A = 0 and its old uncertainty. Raises CalibrationError."""
        if self.state is not RoutineState.READY:
            raise CalibrationError(
                f"only {math.degrees(self._turned):.0f} of {math.degrees(_TURNS * _TURN_RAD):.0f} degrees were turned:"
                " turn on slowly"
            )
        at_s, turned, compass = np.array(self._samples).T
        middle_s = at_s - at_s.mean()
        # Unknowns: heading at angle 0, B, C, the gyro's bias and its scale error.
        prior = np.diag([0.0, 0.0, 0.0, 1.0 / math.radians(0.5) ** 2, 1.0 / 0.02**2])

        def residuals_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
            heading = p[0] + turned * (1.0 + p[4]) + p[3] * middle_s
            return _wrapped(compass - heading - p[1] * np.cos(heading) - p[2] * np.sin(heading))

        start = np.array([_mean_angle(compass - turned), 0.0, 0.0, 0.0, 0.0])
        solution = least_squares.fit(residuals_of, start, np.array([1e-4, 1e-4, 1e-4, 1e-6, 1e-5]), prior)
        residual = _rms(solution.residuals)
        _check(solution, residual, solution.parameters[1:3])
        bins = len(np.unique(np.floor(turned / _BIN_RAD)))
        std = _std(solution, residual, bins, prior)
        made = Provenance(
            residual=math.degrees(residual),
            unit="deg",
            source=f"{self._turned / _TURN_RAD:.1f} turns against the gyro; A cannot be seen in them",
            samples=len(self._samples),
            made_unix_s=made_unix_s,
        )
        _, b, c = (float(value) for value in solution.parameters[:3])
        return CompassCalibration(0.0, b, c, (self._unknown_a_std_rad, float(std[1]), float(std[2])), made)

    @property
    def _turned(self) -> float:
        return self._highest - self._lowest

    def _begin_again(self, trouble: str) -> None:
        self._samples = []
        self._angle = self._lowest = self._highest = 0.0
        self._trouble = trouble


class CourseSwingRoutine(JudgedRoutine):
    """Driving at one speed on many headings, against the velocity over ground; it may go on during a survey.

    Ready when A, B and C are known to 2.5 degrees, by the geometry of the headings driven.
    """

    kind = "course_swing"
    LEAST_SAMPLES = 60
    JUDGED_EVERY = 20
    _WANTED_STD_RAD = math.radians(2.5)
    _SLOWEST_MPS = 0.2

    def __init__(self, velocity_std_mps: float = 0.15) -> None:
        super().__init__()
        self._velocity_std_mps = velocity_std_mps
        self._samples: list[tuple[float, float, float, float]] = []

    @property
    def instruction(self) -> str:
        """What to do now."""
        if self.state is RoutineState.READY:
            return "Done: enough headings were driven."
        headings = [compass for compass, *_ in self._samples]
        seen = {int((heading % _TURN_RAD) / _TURN_RAD * _SECTORS) for heading in headings}
        missing = [sector for sector in range(_SECTORS) if sector not in seen]
        degrees = ", ".join(str(30 * sector + 15) for sector in missing[:4])
        wish = f" Headings still to drive: about {degrees} degrees." if missing else " More of the same."
        return f"At the surface with GPS, drive at one speed on all headings.{wish}"

    def feed(
        self, compass_rad: float, speed_mps: float | None, course_rad: float | None, water_speed_mps: float = 1.0
    ) -> None:
        """Compass heading, GPS speed and course of the same instant.

        `water_speed_mps`: speed through the water in any unit (by the thruster model); 1 for a steady command. Under
        0.2 of it nothing is taken: the vehicle drifts.
        """
        if speed_mps is None or course_rad is None:
            return
        if (
            not math.isfinite(compass_rad + speed_mps + course_rad + water_speed_mps)
            or water_speed_mps < self._SLOWEST_MPS
        ):
            return
        north, east = speed_mps * math.cos(course_rad), speed_mps * math.sin(course_rad)
        self._samples.append((compass_rad, north, east, water_speed_mps))
        if len(self._samples) > _MOST_SAMPLES:
            self._samples = self._samples[::2]
        if self._is_due(len(self._samples)):
            solution, prior = self._solve()
            std = _std(solution, self._velocity_std_mps, self._independent(), prior)[:3]
            self._progress = min(1.0, self._WANTED_STD_RAD / float(std.max()))

    def finish(self, made_unix_s: float | None = None) -> CompassCalibration:
        """A, B and C. Raises CalibrationError where the headings do not suffice or nothing fits."""
        if len(self._samples) < self.LEAST_SAMPLES:
            raise CalibrationError(f"only {len(self._samples)} GPS fixes with speed: drive on")
        solution, prior = self._solve()
        residual_mps = _rms(solution.residuals)
        std = _std(solution, max(residual_mps, 0.05), self._independent(), prior)[:3]
        if float(std.max()) > self._WANTED_STD_RAD:
            raise CalibrationError(
                f"A, B, C are known to {math.degrees(float(std.max())):.0f} degrees only, 2.5 wanted: drive on, on all"
                " headings"
            )
        speed_mps = abs(float(solution.parameters[3])) * float(np.median([sample[3] for sample in self._samples]))
        residual = residual_mps / max(speed_mps, 1e-9)
        if speed_mps < self._SLOWEST_MPS:
            raise CalibrationError(f"the vehicle drove at {speed_mps:.2f} m/s only: drive faster than 0.2 m/s")
        if residual_mps > 3.0 * self._velocity_std_mps:
            raise CalibrationError(
                f"the velocities lie {residual_mps:.1f} m/s off the fit: keep one speed and wait for good GPS"
            )
        _check(solution, 0.0, solution.parameters[:3])
        made = Provenance(
            residual=math.degrees(residual),
            unit="deg",
            source=f"{len(self._samples)} GPS velocities on many headings",
            samples=len(self._samples),
            made_unix_s=made_unix_s,
        )
        a, b, c = (float(value) for value in solution.parameters[:3])
        return CompassCalibration(a, b, c, vector(std), made)

    def _solve(self) -> tuple[least_squares.Fit, NDArray[np.float64]]:
        """Unknowns A, B, C, speed per unit of water speed, current north and east."""
        compass, north, east, water = np.array(self._samples).T
        velocities = np.stack([north, east], axis=1)
        wide = math.radians(20.0)
        prior = np.diag([wide**-2, wide**-2, wide**-2, 0.0, 4.0, 4.0])

        def residuals_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
            heading = compass
            for _ in range(3):
                heading = compass - p[0] - p[1] * np.cos(heading) - p[2] * np.sin(heading)
            through = (p[3] * water)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
            residuals: NDArray[np.float64] = (velocities - through - p[4:6]).ravel()
            return residuals

        speed = float(np.linalg.norm(velocities - velocities.mean(axis=0), axis=1).mean() / water.mean())
        start = np.array([0.0, 0.0, 0.0, speed, *velocities.mean(axis=0)])
        return least_squares.fit(residuals_of, start, np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4]), prior), prior

    def _independent(self) -> float:
        """GPS errors of one second are those of the next: a third of the residuals counts."""
        return 2.0 * len(self._samples) / 3.0


def _check(solution: least_squares.Fit, residual: float, deviations: NDArray[np.float64]) -> None:
    largest = math.degrees(float(np.abs(deviations).max()))
    if not solution.converged or residual > _LARGEST_RESIDUAL_RAD:
        raise CalibrationError(
            f"{math.degrees(residual):.1f} degrees are left over, {math.degrees(_LARGEST_RESIDUAL_RAD):.0f} at most"
            " expected: calibrate gyro and magnetometer, keep away from iron, and turn slowly"
        )
    if largest > math.degrees(_LARGEST_DEVIATION_RAD):
        raise CalibrationError(f"a deviation of {largest:.0f} degrees: calibrate the magnetometer first")


def _std(
    solution: least_squares.Fit, residual: float, independent: float, prior: NDArray[np.float64]
) -> NDArray[np.float64]:
    """One sigma of the unknowns when only so many residuals are independent."""
    noise = max(residual, _LEAST_ERROR_RAD)
    data = solution.information - prior * solution.scale**2
    information = data * min(1.0, independent / len(solution.residuals)) / noise**2 + prior
    std: NDArray[np.float64] = np.sqrt(np.maximum(0.0, np.diag(np.linalg.pinv(information, hermitian=True))))
    return std


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _wrapped(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    wrapped: NDArray[np.float64] = np.remainder(angles + math.pi, _TURN_RAD) - math.pi
    return wrapped


def _mean_angle(angles: NDArray[np.float64]) -> float:
    return math.atan2(float(np.sin(angles).mean()), float(np.cos(angles).mean()))
