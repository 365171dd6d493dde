"""Dead reckoning exactly as in the iSBL thesis (J. Frabosilio, Cal Poly 2024, section 4.5): a baseline, not for use.

Its defects, kept on purpose:
- motion is seen in the length of the specific force alone, 0.04 g off one g: a lateral acceleration has to reach
  0.28 g, because it enters the length by its square, and slow moves are not seen at all;
- below the threshold the velocity is kept, not integrated: the weak ends of every push are lost;
- rectangles instead of trapezoids;
- the drift is taken off with 208 Hz however long the samples really were;
- the drift line runs to the last sample above the threshold, not to when the motion ended;
- everything is forgotten at each acoustic fix (`take`), also in the middle of a move, and a counter that wraps at
  10,000 samples is set back by another interrupt than the one that counts;
- no uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from bluerov_slam.navigation.attitude.quaternion import Quaternion, Vector, multiply, normalised, rotate

THRESHOLD_G = 0.04
CALM_SAMPLES = 20
ASSUMED_RATE_HZ = 208.0
COUNTER_WRAP = 10_000
_GRAVITY_MPS2 = 9.81


class ThesisDeadReckoning:
    """Displacement in the test frame: NED turned by the start yaw, so that x points where the session began."""

    def __init__(self, start_yaw_rad: float = 0.0) -> None:
        self._to_test_frame: Quaternion = (math.cos(0.5 * start_yaw_rad), 0.0, 0.0, math.sin(0.5 * start_yaw_rad))
        self._moving = False
        self._calm_samples = 0
        self._counter = self._last_calm = 0
        self._velocity, self._calm_velocity, self._displacement = [0.0] * 3, [0.0] * 3, [0.0] * 3

    @property
    def displacement_m(self) -> Vector:
        """Since the last `take`."""
        x, y, z = self._displacement
        return x, y, z

    @property
    def velocity_mps(self) -> Vector:
        """As it is kept, drift and all."""
        x, y, z = self._velocity
        return x, y, z

    def update(
        self, specific_force_frd_mps2: Sequence[float], quaternion_ned_frd: Quaternion, interval_s: float
    ) -> Vector:
        """One sample, right after the attitude filter took it; returns the displacement."""
        fx, fy, fz = (value / _GRAVITY_MPS2 for value in specific_force_frd_mps2)
        excess_g = abs(math.sqrt(fx * fx + fy * fy + fz * fz) - 1.0)
        velocity, displacement = self._velocity, self._displacement
        if excess_g > THRESHOLD_G:
            ax, ay, az = rotate(normalised(multiply(self._to_test_frame, quaternion_ned_frd)), (fx, fy, fz))
            for axis, acceleration_g in enumerate((ax, ay, az + 1.0)):
                velocity[axis] += acceleration_g * interval_s * _GRAVITY_MPS2
            self._calm_samples = 0
            self._moving = True
        else:
            self._calm_samples += 1
            if self._calm_samples >= CALM_SAMPLES and self._moving:
                self._remove_drift()
            elif not self._moving:
                self._last_calm = self._counter
                self._calm_velocity = velocity.copy()
        for axis in range(3):
            displacement[axis] += velocity[axis] * interval_s
        self._counter = self._counter + 1 if self._counter < COUNTER_WRAP - 1 else 0
        return self.displacement_m

    def take(self) -> Vector:
        """The displacement since the last fix; velocity, counters and displacement begin again."""
        taken = self.displacement_m
        self._forget()
        return taken

    def _remove_drift(self) -> None:
        """The triangle while it moved and the rectangle while it was calm, under a velocity that should be zero."""
        counted = self._counter - self._last_calm
        samples = (counted if counted > 0 else counted + COUNTER_WRAP) + 1 - self._calm_samples
        for axis in range(3):
            drift = self._velocity[axis] - self._calm_velocity[axis]
            self._displacement[axis] -= drift * (samples / 2.0 + self._calm_samples) / ASSUMED_RATE_HZ
            self._velocity[axis] -= drift
        self._moving = False

    def _forget(self) -> None:
        self._velocity, self._calm_velocity, self._displacement = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self._counter = self._last_calm = 0
