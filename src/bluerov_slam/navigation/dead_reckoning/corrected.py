"""Dead reckoning between rests, done right: gravity-free acceleration, a test for rest, real times, an error bound.

The specific force is turned into NED and gravity added; the rest is integrated by trapezoids. When the sensor is found
still, its velocity is known to be zero: what was integrated instead is drift, grown from the beginning of the move to
the instant of rest. Taking a line off removes a constant acceleration error (bias, tilt) exactly.

Still means two things at once: the samples of a window do not differ by more than noise, and their mean acceleration is
what it was at the last rest. The first alone would stop a smooth move at the top of its acceleration, which enters the
force's length by its square only.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from bluerov_slam.navigation.attitude.filter import usable
from bluerov_slam.navigation.attitude.quaternion import Quaternion, Vector, rotate
from bluerov_slam.navigation.dead_reckoning.stationary import StationaryDetector

_LONG_CALM_S = 1.0


@dataclass(frozen=True, slots=True)
class InertialErrors:
    """One-sigma figures that make the stated error.

    `bias_mps2`: constant error of the gravity-free acceleration, 0.3 degrees of tilt being 0.05 m/s2.
    `wander_mps2`: how far it changes during a move, as the attitude filter follows. `scale`: of the accelerometer.
    `rest_change_mps2`: what may differ between two rests, twice the bias of a new attitude.
    """

    noise_mps_per_sqrt_s: float = 0.002
    bias_mps2: float = 0.05
    wander_mps2: float = 0.03
    scale: float = 0.01
    rest_change_mps2: float = 0.1


class DeadReckoned(NamedTuple):
    """Where the sensor is by dead reckoning, NED, since the beginning; `std_m` per axis, in this move only.

    `still`: at rest now.
    """

    position_ned_m: Vector
    velocity_ned_mps: Vector
    std_m: float
    still: bool


class _Moment(NamedTuple):
    at_s: float
    velocity: Vector
    position: Vector


class CorrectedDeadReckoning:
    """Begin at rest. The attitude comes from a filter, which has taken the same sample before."""

    def __init__(
        self,
        detector: StationaryDetector | None = None,
        errors: InertialErrors = InertialErrors(),
        gravity_mps2: float = 9.80665,
    ) -> None:
        self._detector = detector or StationaryDetector(gravity_mps2=gravity_mps2)
        self._errors = errors
        self._gravity = gravity_mps2
        self._at_s = 0.0
        self._position: Vector = (0.0, 0.0, 0.0)
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._acceleration: Vector | None = None
        self._rest = _Moment(0.0, self._velocity, self._position)
        self._recent: deque[_Moment] = deque(maxlen=self._detector.window_samples)
        self._variance_m2 = 0.0
        self._resting = True
        self._rest_acceleration: Vector | None = None
        self._accelerations: deque[Vector] = deque(maxlen=self._detector.window_samples)
        self._calm_s = 0.0

    def update(
        self,
        angular_rate_frd_radps: Sequence[float],
        specific_force_frd_mps2: Sequence[float],
        quaternion_ned_frd: Quaternion,
        interval_s: float,
    ) -> DeadReckoned:
        """One sample, taken `interval_s` after the one before. What is not finite changes nothing."""
        fx, fy, fz = specific_force_frd_mps2
        if not (usable(angular_rate_frd_radps, interval_s) and math.isfinite(fx + fy + fz)):
            return self._result()
        self._at_s += interval_s
        north, east, down = rotate(quaternion_ned_frd, (fx, fy, fz))
        self._accelerations.append((north, east, down + self._gravity))
        still = self._still(self._detector.update(angular_rate_frd_radps, specific_force_frd_mps2), interval_s)
        # What is measured at rest instead of zero is taken off: a first estimate of the constant error.
        bx, by, bz = self._rest_acceleration or (0.0, 0.0, 0.0)
        now = (north - bx, east - by, down + self._gravity - bz)
        before = self._acceleration or now
        self._acceleration = now
        half = 0.5 * interval_s
        velocity, position = self._velocity, self._position
        moved: Vector = (
            velocity[0] + (before[0] + now[0]) * half,
            velocity[1] + (before[1] + now[1]) * half,
            velocity[2] + (before[2] + now[2]) * half,
        )
        self._position = (
            position[0] + (velocity[0] + moved[0]) * half,
            position[1] + (velocity[1] + moved[1]) * half,
            position[2] + (velocity[2] + moved[2]) * half,
        )
        self._velocity = moved
        self._recent.append(_Moment(self._at_s, self._velocity, self._position))
        if still:
            self._stop()
        self._resting = still
        return self._result()

    def _still(self, calm: bool, interval_s: float) -> bool:
        """Calm, and accelerating as little as at the last rest; after a second of calm in any case."""
        self._calm_s = self._calm_s + interval_s if calm else 0.0
        if not calm or self._rest_acceleration is None:
            return calm
        change = math.dist(self._mean_acceleration(), self._rest_acceleration)
        return change < self._errors.rest_change_mps2 or self._calm_s >= _LONG_CALM_S

    def _mean_acceleration(self) -> Vector:
        count = len(self._accelerations)
        x, y, z = (sum(axis) / count for axis in zip(*self._accelerations, strict=True))
        return x, y, z

    def _stop(self) -> None:
        """Rest since the beginning of the detector's window: the velocity there was drift."""
        stopped = self._recent[0]
        duration_s = max(0.0, stopped.at_s - self._rest.at_s)
        half = 0.5 * duration_s
        x, y, z = (p - v * half for p, v in zip(stopped.position, stopped.velocity, strict=True))
        moved_m = math.dist((x, y, z), self._rest.position)
        self._variance_m2 += self._removed_variance_m2(duration_s, moved_m)
        self._position, self._velocity = (x, y, z), (0.0, 0.0, 0.0)
        self._rest = _Moment(self._at_s, self._velocity, self._position)
        self._recent.clear()
        self._recent.append(self._rest)
        self._rest_acceleration = self._mean_acceleration()

    def _removed_variance_m2(self, duration_s: float, moved_m: float) -> float:
        """After the line was taken off: white noise leaves T^3 / 12, a steadily changing error T^2 / 12."""
        errors = self._errors
        noise = errors.noise_mps_per_sqrt_s**2 * duration_s**3 / 12.0
        return noise + (errors.wander_mps2 * duration_s**2 / 12.0) ** 2 + (errors.scale * moved_m) ** 2

    def _result(self) -> DeadReckoned:
        variance = self._variance_m2
        if not self._resting:
            errors, moving_s = self._errors, self._at_s - self._rest.at_s
            variance += errors.noise_mps_per_sqrt_s**2 * moving_s**3 / 3.0 + (errors.bias_mps2 * moving_s**2 / 2.0) ** 2
        return DeadReckoned(self._position, self._velocity, math.sqrt(variance), self._resting)
