"""Magnetometer: turn the vehicle about all its axes; the Earth's field has the same length in every attitude.

Iron that turns with the vehicle shifts (hard) and squeezes (soft) the sphere of readings into an ellipsoid. Found is
the symmetric matrix that makes it a sphere again; a rotation on top of it cannot be seen from the field alone and ends
up in the compass deviation. Source of the ellipsoid fit: Renaudin, Afzal, Lachapelle (2010), doi:10.1155/2010/967245.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude import least_squares
from bluerov_slam.navigation.attitude.calibration import (
    CalibrationError,
    MagnetometerCalibration,
    Provenance,
    matrix,
    vector,
)
from bluerov_slam.navigation.attitude.routine import InertialSample, JudgedRoutine, RoutineState

# The sphere of directions in 54 cells: the six faces of a cube, three by three each.
CELLS = 54
CELLS_WANTED = 30
_SAMPLES_PER_CELL = 20
_MOST_SAMPLES = 6000
# One sigma of the offset in its worst direction, in units of the field: 2 % are 1 to 3 degrees of heading by the dip.
_LARGEST_OFFSET_STD = 0.02
_SMALLEST_NOISE = 0.01
_LARGEST_RESIDUAL = 0.06
_LARGEST_OUTLIER_SHARE = 0.25
_LARGEST_SQUEEZE = 2.5
_OUTLIER_SIGMAS = 4.0
# Soft iron of a vehicle squeezes by some percent: what the readings do not tell is taken to be within these.
_PRIOR = np.diag([0.0, 0.0, 0.0] + [1.0 / std**2 for std in (0.15, 0.08, 0.08, 0.15, 0.08, 0.15)])
_AXES = ("nose", "starboard side", "underside")


class MagnetometerRoutine(JudgedRoutine):
    """Collects readings evenly over all directions, so that no attitude held for long outweighs the others.

    Progress is the lesser of the share of directions seen and of how well the offset is known.
    """

    kind = "magnetometer"
    LEAST_SAMPLES = 100
    JUDGED_EVERY = 100

    def __init__(self) -> None:
        super().__init__()
        self._samples: list[tuple[float, float, float]] = []
        self._worst_axis: int | None = None
        self._repeated = 0

    @property
    def instruction(self) -> str:
        """What to do now."""
        if self.state is RoutineState.READY:
            return "Done: enough directions were seen. More make it better."
        if self._repeated > 200:
            return "The magnetometer's values do not change: check the sensor, and turn the vehicle."
        missing = ""
        if self._worst_axis is not None:
            missing = f" Point its {_AXES[self._worst_axis]} up, down and all around, too."
        return f"Far from iron, turn the vehicle slowly about all its axes.{missing}"

    def feed(self, sample: InertialSample) -> None:
        """Take one sample; repetitions of the same reading count once."""
        field = sample.magnetic_field_raw
        if field is None or not math.isfinite(sum(field)):
            return
        reading = (float(field[0]), float(field[1]), float(field[2]))
        if self._samples and reading == self._samples[-1]:
            self._repeated += 1
            return
        self._repeated = 0
        self._samples.append(reading)
        if self._is_due(len(self._samples)):
            self._evaluate()

    def finish(self, made_unix_s: float | None = None) -> MagnetometerCalibration:
        """Offset and matrix. Raises CalibrationError where directions are missing or no ellipsoid fits."""
        if len(self._samples) < self.LEAST_SAMPLES:
            raise CalibrationError(f"only {len(self._samples)} readings: turn the vehicle about all its axes")
        readings = np.array(self._samples)
        radius = float(np.ptp(readings, axis=0).max()) / 2.0
        if radius <= 0.0:
            raise CalibrationError("the magnetometer's readings never change: check the sensor")
        centre = _centre_of_box(readings)
        scaled = (readings - centre) / radius
        scaled = scaled[_thinned(_cells_of(scaled))]
        solution = _ellipsoid(scaled, _PRIOR)
        inlier = np.abs(solution.residuals) <= _OUTLIER_SIGMAS * max(solution.scale, 0.25 * _SMALLEST_NOISE)
        if 1.0 - inlier.mean() > _LARGEST_OUTLIER_SHARE:
            raise CalibrationError(
                f"{100 * (1 - inlier.mean()):.0f} % of the readings fit no ellipsoid: go away from iron and running"
                " thrusters, and start again"
            )
        scaled = scaled[inlier]
        solution = _ellipsoid(scaled, _PRIOR)
        offset, squeeze = solution.parameters[:3], _symmetric(solution.parameters[3:])
        residual = float(np.sqrt(np.mean((np.linalg.norm((scaled - offset) @ squeeze, axis=1) - 1.0) ** 2)))
        _check(scaled, offset, squeeze, residual)
        if not solution.converged:
            raise CalibrationError("no ellipsoid fits the readings: go away from iron, and start again")
        made = Provenance(
            residual=100.0 * residual,
            unit="% of the field",
            source=f"{len(np.unique(_cells_of(scaled - offset)))} of {CELLS} directions",
            samples=len(scaled),
            made_unix_s=made_unix_s,
        )
        return MagnetometerCalibration(
            offset_raw=vector(centre + radius * offset),
            matrix=matrix(squeeze / radius),
            raw_norm=radius / float(np.cbrt(np.linalg.det(squeeze))),
            made=made,
        )

    def _evaluate(self) -> None:
        """How far it is, from the best sphere alone: cheap enough to be done while samples come in."""
        readings = np.array(self._samples)
        cells = _cells_of(readings - _centre_of_box(readings))
        kept = _thinned(cells)
        if len(self._samples) > _MOST_SAMPLES:
            self._samples = [self._samples[k] for k in kept]
        radius = float(np.ptp(readings, axis=0).max()) / 2.0
        if radius <= 0.0:
            return
        points = readings[kept] / radius
        centre, size = _sphere(points)
        seen = len(np.unique(_cells_of(points - centre)))
        std, self._worst_axis = _worst_offset_std(points, centre, np.eye(3) / size, _SMALLEST_NOISE)
        self._progress = min(1.0, seen / CELLS_WANTED, _LARGEST_OFFSET_STD / std)


def _check(
    points: NDArray[np.float64], offset: NDArray[np.float64], squeeze: NDArray[np.float64], residual: float
) -> None:
    """Raises CalibrationError for what would make a compass worse than none."""
    if residual > _LARGEST_RESIDUAL:
        raise CalibrationError(
            f"the readings lie {100 * residual:.0f} % off any ellipsoid, {100 * _LARGEST_RESIDUAL:.0f} % at most"
            " expected: go away from iron and running thrusters, and start again"
        )
    std, axis = _worst_offset_std(points, offset, squeeze, max(residual, _SMALLEST_NOISE))
    if std > _LARGEST_OFFSET_STD:
        raise CalibrationError(
            f"too few directions: the offset is known to {100 * std:.0f} % of the field only, 2 % wanted;"
            f" point its {_AXES[axis]} up, down and all around, too"
        )
    stretches = np.linalg.eigvalsh(squeeze)
    if stretches[0] <= 0.0 or stretches[2] / stretches[0] > _LARGEST_SQUEEZE:
        raise CalibrationError(
            "the field is squeezed more than iron on a vehicle does: move the sensor away from iron, and start again"
        )


def _centre_of_box(readings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Middle between the 2nd and 98th percentile: a first guess that a few wild readings do not move."""
    low, high = np.percentile(readings, [2.0, 98.0], axis=0)
    middle: NDArray[np.float64] = 0.5 * (low + high)
    return middle


def _cells_of(vectors: NDArray[np.float64]) -> NDArray[np.intp]:
    """Cell number of each direction: cube face, then three by three on it."""
    axis = np.argmax(np.abs(vectors), axis=1)
    rows = np.arange(len(vectors))
    largest = vectors[rows, axis]
    safe = np.where(largest == 0.0, 1.0, np.abs(largest))
    others = [np.clip(((vectors[rows, (axis + k) % 3] / safe + 1.0) * 1.5).astype(np.intp), 0, 2) for k in (1, 2)]
    cells: NDArray[np.intp] = (2 * axis + (largest > 0.0)) * 9 + 3 * others[0] + others[1]
    return cells


def _thinned(cells: NDArray[np.intp]) -> NDArray[np.intp]:
    """Indices of at most so many samples of each cell, spread over the time it was seen."""
    kept = []
    for cell in np.unique(cells):
        members = np.flatnonzero(cells == cell)
        few = np.linspace(0, len(members) - 1, min(len(members), _SAMPLES_PER_CELL)).astype(np.intp)
        kept.append(members[few])
    return np.sort(np.concatenate(kept))


def _sphere(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Centre and radius of the robust best sphere."""

    def residuals_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
        distances: NDArray[np.float64] = np.linalg.norm(points - p[:3], axis=1) - p[3]
        return distances

    start = np.append(_centre_of_box(points), 1.0)
    solution = least_squares.fit(residuals_of, start, np.full(4, 1e-4), np.diag([1e-3] * 4))
    return solution.parameters[:3], float(abs(solution.parameters[3]))


def _ellipsoid(points: NDArray[np.float64], prior: NDArray[np.float64]) -> least_squares.Fit:
    """|matrix (point - offset)| = 1, from the best sphere on, robust against single wild readings.

    The residual is the distance from the ellipsoid in the units of the points: |m| - 1 alone would reward a large
    ellipsoid far away, on which every noise looks small.
    """

    def residuals_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
        squeeze = _symmetric(p[3:])
        mapped = (points - p[:3]) @ squeeze
        lengths = np.maximum(np.linalg.norm(mapped, axis=1), 1e-9)
        slopes = np.maximum(np.linalg.norm(mapped @ squeeze, axis=1) / lengths, 1e-9)
        distances: NDArray[np.float64] = (lengths - 1.0) / slopes
        return distances

    offset, radius = _sphere(points)
    start = np.concatenate([offset, np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]) / radius])
    return least_squares.fit(residuals_of, start, np.full(9, 1e-4), prior * radius**2)


def _symmetric(upper: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c, d, e, f = upper
    symmetric: NDArray[np.float64] = np.array([[a, b, c], [b, d, e], [c, e, f]])
    return symmetric


def _worst_offset_std(
    points: NDArray[np.float64], offset: NDArray[np.float64], squeeze: NDArray[np.float64], noise: float
) -> tuple[float, int]:
    """One sigma of the offset in its worst direction, in units of the field, and the body axis nearest to it.

    Readings of one cell share their error: what counts is the number of cells.
    """
    from_centre = points - offset
    mapped = from_centre @ squeeze
    unit = mapped / np.maximum(np.linalg.norm(mapped, axis=1, keepdims=True), 1e-9)
    outer = unit[:, :, None] * from_centre[:, None, :]
    rows, columns = np.triu_indices(3)
    by_matrix = outer[:, rows, columns] + np.where(rows == columns, 0.0, outer[:, columns, rows])
    jacobian = np.concatenate([-unit @ squeeze, by_matrix], axis=1)
    share = len(np.unique(_cells_of(from_centre))) / len(points)
    scale = float(np.cbrt(abs(np.linalg.det(squeeze))))
    information = share * jacobian.T @ jacobian / noise**2 + _PRIOR / scale**2
    covariance = np.linalg.pinv(information, hermitian=True)
    variances, axes = np.linalg.eigh(squeeze @ covariance[:3, :3] @ squeeze.T)
    return math.sqrt(max(0.0, float(variances[-1]))), int(np.argmax(np.abs(axes[:, -1])))
