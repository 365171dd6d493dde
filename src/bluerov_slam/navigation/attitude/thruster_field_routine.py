"""The magnetic field of the thrusters' supply currents: hold the vehicle and run one thruster after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude.calibration import CalibrationError, Provenance, ThrusterFieldCalibration, vector
from bluerov_slam.navigation.attitude.routine import RoutineState

_STILL_RADPS = math.radians(3.0)
_EFFORT_RUNS = 0.1
_SAMPLES_PER_THRUSTER = 40
_SAMPLES_AT_REST = 40
_MOST_SAMPLES = 20_000
_LARGEST_STD = 0.05
_LARGEST_RESIDUAL = 0.1
_LARGEST_FIELD = 2.0
_LARGEST_OUTLIER_SHARE = 0.25
_OUTLIER_SIGMAS = 5.0
_HUBER = 1.345
# Median length of a three-dimensional Gaussian of one sigma per axis.
_MEDIAN_LENGTH = 1.538


class ThrusterFieldRoutine:
    """Fits a constant field per thruster and unit of effort; a slow drift of the held vehicle is fitted away."""

    kind = "thruster_field"

    def __init__(self, thrusters: int) -> None:
        self._thrusters = thrusters
        self._samples: list[tuple[float, ...]] = []
        self._ran = [0] * thrusters
        self._rest = 0
        self._moved = False

    @property
    def state(self) -> RoutineState:
        """READY when every thruster ran for a while, and all stood still for a while."""
        return RoutineState.RUNNING if self._missing() or self._rest < _SAMPLES_AT_REST else RoutineState.READY

    @property
    def progress(self) -> float:
        """Share of the samples that are wanted."""
        got = sum(min(count, _SAMPLES_PER_THRUSTER) for count in self._ran) + min(self._rest, _SAMPLES_AT_REST)
        return got / (_SAMPLES_PER_THRUSTER * self._thrusters + _SAMPLES_AT_REST)

    @property
    def instruction(self) -> str:
        """What to do now."""
        if self.state is RoutineState.READY:
            return "Done: every thruster ran."
        moved = "It turns: hold the vehicle firmly. " if self._moved else ""
        missing = ", ".join(str(number) for number in self._missing())
        todo = f"run each of these alone at half power for five seconds: {missing}" if missing else "stop all thrusters"
        return f"{moved}Hold the vehicle in the water and {todo}."

    def feed(
        self, at_s: float, field_frd: Sequence[float], effort: Sequence[float], angular_rate_radps: Sequence[float]
    ) -> None:
        """Calibrated field (`Calibration.magnetic_field`), effort of 0..1 per thruster, rate by the gyro."""
        numbers = (at_s, *field_frd, *effort)
        if len(effort) != self._thrusters or not all(map(math.isfinite, numbers)):
            return
        self._moved = not max(map(abs, angular_rate_radps)) <= _STILL_RADPS
        if self._moved or len(self._samples) >= _MOST_SAMPLES:
            return
        self._samples.append(numbers)
        running = [k for k, value in enumerate(effort) if value > _EFFORT_RUNS]
        for k in running:
            self._ran[k] += 1
        self._rest += not running

    def finish(self, made_unix_s: float | None = None) -> ThrusterFieldCalibration:
        """One field per thruster. Raises CalibrationError where one did not run, or never without another."""
        if self.state is not RoutineState.READY:
            raise CalibrationError(f"not finished: {self.instruction}")
        table = np.array(self._samples)
        at_s, field, effort = table[:, 0], table[:, 1:4], table[:, 4:]
        design = np.column_stack([np.ones(len(table)), (at_s - at_s.mean()) / max(1.0, float(np.ptp(at_s))), effort])
        solution, residuals, scale = _robust(design, field)
        inlier = np.linalg.norm(residuals, axis=1) <= _OUTLIER_SIGMAS * scale
        residual = float(np.sqrt(np.mean(residuals[inlier] ** 2)))
        # Samples of one second share their error: a tenth of them counts.
        information = design.T @ design / 10.0
        std = max(residual, 0.003) * np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)))[2:]
        if (
            np.linalg.matrix_rank(design, tol=1e-3 * math.sqrt(len(design))) < design.shape[1]
            or std.max() > _LARGEST_STD
        ):
            worst = int(np.argmax(std)) + 1
            raise CalibrationError(f"thruster {worst} never ran without the others: run each one alone")
        if (
            1.0 - inlier.mean() > _LARGEST_OUTLIER_SHARE
            or residual > _LARGEST_RESIDUAL
            or float(np.abs(solution[2:]).max()) > _LARGEST_FIELD
        ):
            raise CalibrationError(
                f"{100 * residual:.0f} % of the field are left over: hold the vehicle still and calibrate the"
                " magnetometer first"
            )
        made = Provenance(
            residual=100.0 * residual,
            unit="% of the field",
            source=f"{self._thrusters} thrusters, one by one, vehicle held",
            samples=len(table),
            made_unix_s=made_unix_s,
        )
        return ThrusterFieldCalibration(
            tuple(vector(row) for row in solution[2:]), tuple(float(value) for value in std), made
        )

    def _missing(self) -> list[int]:
        return [k + 1 for k, count in enumerate(self._ran) if count < _SAMPLES_PER_THRUSTER]


def _robust(
    design: NDArray[np.float64], field: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Least squares of three components with one Huber weight per sample; also residuals and their robust sigma."""
    weights = np.ones(len(design))
    solution, residuals, scale = np.zeros((design.shape[1], 3)), field, 0.0
    for _ in range(10):
        root = np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq(root * design, root * field, rcond=None)[0].astype(np.float64)
        residuals = field - design @ solution
        lengths = np.linalg.norm(residuals, axis=1)
        scale = max(float(np.median(lengths)) / _MEDIAN_LENGTH, 1e-9)
        weights = np.minimum(1.0, _HUBER * _MEDIAN_LENGTH * scale / np.maximum(lengths, 1e-12))
    return solution, residuals, scale
