"""Accelerometer: hold the vehicle on each of its six faces; gravity has the same length on all of them.

The fit asks only for that length, so the faces need not be level. Source of the method: Frosio, Pedersini, Borghese
(2009), Autocalibration of MEMS accelerometers, doi:10.1109/TIM.2008.2006137.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude import least_squares
from bluerov_slam.navigation.attitude.calibration import (
    AccelerometerCalibration,
    CalibrationError,
    Provenance,
    matrix,
    vector,
)
from bluerov_slam.navigation.attitude.routine import InertialSample, RoutineState, StillWindows, Window, angle_rad

STANDARD_GRAVITY_MPS2 = 9.80665
FACES = {
    (2, -1): "upright",
    (2, 1): "upside down",
    (0, 1): "nose up",
    (0, -1): "nose down",
    (1, -1): "starboard side down",
    (1, 1): "port side down",
}
SECONDS_PER_FACE = 3
_MOST_WINDOWS_PER_POSE = 12
_FACE_COSINE = math.cos(math.radians(30.0))
_SAME_POSE_RAD = math.radians(8.0)
_POSES_FOR_MISALIGNMENT = 12
_LARGEST_OFFSET_MPS2 = 1.0
_LARGEST_SCALE_ERROR = 0.1
_LARGEST_RESIDUAL_MPS2 = 0.1


class AccelerometerRoutine:
    """Collects still poses; offset and scale need the six faces, misalignment six tilted poses beside them."""

    kind = "accelerometer"

    def __init__(self, gravity_mps2: float = STANDARD_GRAVITY_MPS2, solve_misalignment: bool = False) -> None:
        self._gravity_mps2 = gravity_mps2
        self._misalignment = solve_misalignment
        self._cutter = StillWindows()
        self._poses: list[list[Window]] = []
        self._last: Window | None = None

    @property
    def state(self) -> RoutineState:
        """READY when every face was held for three seconds."""
        return RoutineState.READY if not self.missing and not self._poses_missing() else RoutineState.RUNNING

    @property
    def progress(self) -> float:
        """Share of the faces (and of the tilted poses) that were held."""
        wanted = 12 if self._misalignment else 6
        return (wanted - len(self.missing) - self._poses_missing()) / wanted

    @property
    def missing(self) -> list[str]:
        """Faces that are still to be held, in words."""
        held = {face_of(_mean_force(pose)) for pose in self._complete()}
        return [name for face, name in FACES.items() if face not in held]

    @property
    def instruction(self) -> str:
        """Which face is held now and which are missing."""
        if self.state is RoutineState.READY:
            return "Done: all faces were held."
        todo = f"Missing: {', '.join(self.missing)}." if self.missing else ""
        if not self.missing:
            todo = f"Hold it tilted, between two faces, {self._poses_missing()} times more, each time differently."
        if self._last is None:
            return f"Hold the vehicle still on one face after the other. {todo}"
        if self._last.still is None:
            return f"The sensor's values do not change at all: check the sensor. {todo}"
        if not self._last.still:
            return f"It moves: hold it still. {todo}"
        face = face_of(self._last.force_mps2)
        return f"Held now: {FACES[face] if face else 'between two faces'}. {todo}"

    def feed(self, sample: InertialSample) -> None:
        """Take one sample."""
        window = self._cutter.feed(sample)
        if window is None:
            return
        self._last = window
        if not window.still or float(np.linalg.norm(window.force_mps2)) < 0.5 * self._gravity_mps2:
            return
        for pose in self._poses:
            if angle_rad(_mean_force(pose), window.force_mps2) < _SAME_POSE_RAD:
                if len(pose) < _MOST_WINDOWS_PER_POSE:
                    pose.append(window)
                return
        self._poses.append([window])

    def finish(self, made_unix_s: float | None = None) -> AccelerometerCalibration:
        """Offset and scale. Raises CalibrationError where faces are missing or what was measured cannot be right."""
        if self.missing:
            raise CalibrationError(f"not held for {SECONDS_PER_FACE} s: {', '.join(self.missing)}; hold these, too")
        if self._poses_missing():
            raise CalibrationError(
                f"misalignment needs {self._poses_missing()} more tilted poses: hold it between two faces, each time"
                " differently"
            )
        poses = self._complete()
        means = np.array([_mean_force(pose) for pose in poses])
        offset, scaling, converged = _solve(means, self._gravity_mps2, self._misalignment)
        corrected = [np.linalg.norm(scaling @ (w.force_mps2 - offset)) for pose in poses for w in pose]
        residual = float(np.sqrt(np.mean((np.array(corrected) - self._gravity_mps2) ** 2)))
        self._check(offset, scaling, residual, converged)
        made = Provenance(
            residual=residual,
            unit="m/s2",
            source=f"{len(poses)} poses on 6 faces{', with misalignment' if self._misalignment else ''}",
            samples=sum(window.samples for pose in poses for window in pose),
            made_unix_s=made_unix_s,
        )
        return AccelerometerCalibration(vector(offset), matrix(scaling), made)

    def _complete(self) -> list[list[Window]]:
        return [pose for pose in self._poses if len(pose) >= SECONDS_PER_FACE]

    def _poses_missing(self) -> int:
        if not self._misalignment:
            return 0
        return max(0, _POSES_FOR_MISALIGNMENT - 6 - max(0, len(self._complete()) - (6 - len(self.missing))))

    @staticmethod
    def _check(offset: NDArray[np.float64], scaling: NDArray[np.float64], residual: float, converged: bool) -> None:
        scales = np.abs(np.diag(scaling) - 1.0)
        if not converged or not np.isfinite(scaling).all():
            raise CalibrationError("no offset and scale fit what was measured: start again and hold each face still")
        if float(np.abs(offset).max()) > _LARGEST_OFFSET_MPS2 or float(scales.max()) > _LARGEST_SCALE_ERROR:
            raise CalibrationError(
                f"offset {np.abs(offset).max():.2f} m/s2 and scale error {100 * scales.max():.0f} % are more than a"
                " sound accelerometer has: start again; if it stays, the sensor is defective"
            )
        if residual > _LARGEST_RESIDUAL_MPS2:
            raise CalibrationError(
                f"{residual:.2f} m/s2 are left over, {_LARGEST_RESIDUAL_MPS2} at most expected: start again and hold"
                " each face still"
            )


def face_of(force_mps2: NDArray[np.float64]) -> tuple[int, int] | None:
    """(axis, sign) of the axis that points within 30 degrees of up or down; None between two faces."""
    axis = int(np.argmax(np.abs(force_mps2)))
    length = float(np.linalg.norm(force_mps2))
    if length == 0.0 or abs(float(force_mps2[axis])) < _FACE_COSINE * length:
        return None
    return axis, 1 if force_mps2[axis] > 0.0 else -1


def _mean_force(pose: list[Window]) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = np.mean([window.force_mps2 for window in pose], axis=0)
    return mean


def _solve(
    means: NDArray[np.float64], gravity_mps2: float, misalignment: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]:
    """Offset and upper triangular matrix with |matrix (mean - offset)| = g for every pose."""

    def matrix_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
        scaling = np.diag(1.0 + p[3:6])
        if misalignment:
            scaling[0, 1], scaling[0, 2], scaling[1, 2] = p[6:9]
        return scaling

    def residuals_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
        lengths: NDArray[np.float64] = np.linalg.norm((means - p[:3]) @ matrix_of(p).T, axis=1)
        return lengths - gravity_mps2

    unknowns = 9 if misalignment else 6
    steps = np.array([1e-3] * 3 + [1e-4] * (unknowns - 3))
    # As many equations as unknowns: a trace of a prior keeps the damping from deciding.
    prior = np.diag([1e-12] * unknowns)
    solution = least_squares.fit(residuals_of, np.zeros(unknowns), steps, prior)
    return solution.parameters[:3], matrix_of(solution.parameters), solution.converged
