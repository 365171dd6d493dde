"""What really happened: rows of truth on a grid, and the smooth motion between them.

Between two rows position, velocity and attitude follow cubics that fit values and derivatives at both ends; the
acceleration and angular rate given are the derivatives of those, so that they integrate to the same motion exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import BugError
from bluerov_slam.simulation import flight as columns

FloatArray = NDArray[np.float64]

_CHUNK_STEPS = 100


@dataclass(frozen=True, slots=True)
class Motion:
    """The vehicle at many instants: NED over ground, FRD; first axis = time."""

    times_s: FloatArray
    position_ned_m: FloatArray
    velocity_ned_mps: FloatArray
    acceleration_ned_mps2: FloatArray
    rotation_ned_frd: FloatArray
    angular_rate_frd_radps: FloatArray
    amperes: FloatArray
    surface_m: FloatArray


class TruthRows:
    """All rows of a dive, or those so far: then `more(n)` gives the next n, and those older than `keep_s` go."""

    def __init__(
        self,
        rows: FloatArray,
        start_s: float,
        step_s: float,
        more: Callable[[int], FloatArray] | None = None,
        keep_s: float = math.inf,
    ) -> None:
        self.start_s = start_s
        self.step_s = step_s
        self._more = more
        self._keep_steps = None if keep_s == math.inf else int(keep_s / step_s)
        self._rows = rows
        self._first = 0  # number of the first row that is kept

    @property
    def known_until_s(self) -> float:
        """Nothing later was computed yet."""
        return self.start_s + (self._first + len(self._rows) - 1) * self.step_s

    def reach(self, at_s: float) -> None:
        """Make sure that this instant lies between two rows."""
        if at_s < self.known_until_s:
            return
        if self._more is None:
            raise BugError(f"the truth ends at {self.known_until_s:.1f} s, asked for {at_s:.1f} s")
        fresh = [self._rows]
        missing = int((at_s - self.known_until_s) / self.step_s) + 2
        while missing > 0:
            fresh.append(self._more(_CHUNK_STEPS))
            missing -= _CHUNK_STEPS
        rows = np.concatenate(fresh)
        if self._keep_steps is not None and len(rows) > 2 * self._keep_steps:
            drop = len(rows) - self._keep_steps
            rows = rows[drop:].copy()
            self._first += drop
        self._rows = rows

    def place(self, at_s: float) -> tuple[FloatArray, FloatArray, float]:
        """The rows before and after an instant, and where between them it lies (0..1), not before the start."""
        self.reach(at_s)
        steps = max(0.0, (at_s - self.start_s) / self.step_s)
        index = int(steps)
        row = index - self._first
        if row < 0:
            raise BugError(f"the truth of {at_s} s has been forgotten")
        return self._rows[row], self._rows[row + 1], steps - index

    def rows_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `place`, for many instants."""
        if len(times_s):
            self.reach(float(times_s.max()))
        steps = np.maximum(0.0, (times_s - self.start_s) / self.step_s)
        index = steps.astype(np.intp)
        rows = index - self._first
        if len(rows) and int(rows.min()) < 0:
            raise BugError(f"the truth of {times_s.min()} s has been forgotten")
        return self._rows[rows], self._rows[rows + 1], steps - index

    def motion(self, times_s: FloatArray) -> Motion:
        """Position to angular rate at these instants."""
        before, after, share = self.rows_at(times_s)
        h, s = self.step_s, share[:, None]
        velocity, acceleration = _cubic(
            before[:, columns.VELOCITY],
            after[:, columns.VELOCITY],
            before[:, columns.ACCELERATION],
            after[:, columns.ACCELERATION],
            s,
            h,
        )
        position, _ = _cubic(
            before[:, columns.POSITION],
            after[:, columns.POSITION],
            before[:, columns.VELOCITY],
            after[:, columns.VELOCITY],
            s,
            h,
        )
        start, turn = _matrices(before[:, columns.QUATERNION]), _turn(before, after)
        rate_0, rate_1 = before[:, columns.RATE], after[:, columns.RATE]
        # The rotation vector since `before` changes by omega + 1/2 turn x omega to first order of the turn.
        angle, change = _cubic(np.zeros_like(turn), turn, rate_0, rate_1 + 0.5 * np.cross(turn, rate_1), s, h)
        rate = change - 0.5 * np.cross(angle, change)
        return Motion(
            times_s,
            position,
            velocity,
            acceleration,
            start @ _exp(angle),
            rate,
            before[:, columns.AMPERES] * (1.0 - share) + after[:, columns.AMPERES] * share,
            before[:, columns.SURFACE] * (1.0 - share) + after[:, columns.SURFACE] * share,
        )

    def linear(self, at_s: float, wanted: slice | int) -> FloatArray:
        """Columns that need no better than a straight line between rows."""
        before, after, share = self.place(at_s)
        values: FloatArray = before[wanted] * (1.0 - share) + after[wanted] * share
        return values


def _cubic(
    x0: FloatArray, x1: FloatArray, d0: FloatArray, d1: FloatArray, s: FloatArray, h: float
) -> tuple[FloatArray, FloatArray]:
    """Hermite's cubic and its derivative."""
    s2, s3 = s * s, s * s * s
    value = (2 * s3 - 3 * s2 + 1) * x0 + (3 * s2 - 2 * s3) * x1 + h * ((s3 - 2 * s2 + s) * d0 + (s3 - s2) * d1)
    slope = (6 * s2 - 6 * s) * (x0 - x1) / h + (3 * s2 - 4 * s + 1) * d0 + (3 * s2 - 2 * s) * d1
    return value, slope


def _turn(before: FloatArray, after: FloatArray) -> FloatArray:
    """Rotation vector from each attitude to the next, in the body frame."""
    a, b = before[:, columns.QUATERNION], after[:, columns.QUATERNION]
    scalar = np.sum(a * b, axis=1)
    vector = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    vector = vector * np.where(scalar < 0.0, -1.0, 1.0)[:, None]
    size = np.linalg.norm(vector, axis=1)
    half = np.arctan2(size, np.abs(scalar))
    scale = np.where(size > 1.0e-12, 2.0 * half / np.maximum(size, 1.0e-12), 2.0)
    result: FloatArray = vector * scale[:, None]
    return result


def _matrices(quaternions: FloatArray) -> FloatArray:
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _exp(vectors: FloatArray) -> FloatArray:
    """Rotation matrices of rotation vectors."""
    angle = np.linalg.norm(vectors, axis=1)
    half = 0.5 * angle
    scale = np.where(angle > 1.0e-12, np.sin(half) / np.maximum(angle, 1.0e-12), 0.5)
    return _matrices(np.column_stack((np.cos(half), vectors * scale[:, None])))
