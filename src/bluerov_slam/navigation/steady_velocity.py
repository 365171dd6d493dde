"""The steady part of a vehicle model's velocity: what its scale may be learned from.

The filter learns the model's scale s from (1 + s) u = water velocity, where u is the model's velocity, which has errors
of its own. Were the Jacobian u itself, u's errors would multiply with themselves: within one leg the true speed hardly
changes and the current explains its mean, so that what varies in u is mostly error, and the best explanation of error
that moves nothing is a scale of zero (regression dilution: errors of 3 cm/s made s -0.3 within half an hour, with a
stated error of 0.02). What really tells of the scale lasts: another course, another speed. So the Jacobian is taken at
a mean of the last seconds, before the present value, that follows a change of speed at once and small errors hardly,
and the less the more it is noise itself.

The same holds for a DVL's scale and mounting: at the estimated velocity, whose errors are in the residual as well, the
scale drifts by -(variance of scale) (variance of velocity) / S with every value, -0.01 in ten minutes (stated: 0.003).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEAN_S = 10.0
"""Long against a vehicle's lag and a pilot's corrections, short against a leg."""

ERROR_LASTS_S = 2.0
"""How long one error of the model stays the same: a swing of the heading, a wave."""

CHANGE_MPS = 0.15
"""A smaller change of speed may be followed late: with a scale off by 10 % that is 1.5 cm/s for some seconds."""

CHANGE_STDS = 3.0
"""Nor is a change what the usual errors do."""


class SteadyVelocity:
    """Surge and sway without their short errors."""

    def __init__(self) -> None:
        self._at_s = -math.inf
        self._values = 0
        self._mean: Array = np.zeros(2)
        self._variance: Array = np.zeros(2)
        self._far: Array = np.zeros(2)

    def before(self, at_s: float, velocity_frd_mps: Array) -> Array:
        """The steady surge and sway (2,) until now; then takes in the model's newest. Starts anew after a long gap."""
        fresh = np.array(velocity_frd_mps[:2], dtype=np.float64)
        elapsed_s = at_s - self._at_s
        self._at_s = at_s
        if not 0.0 <= elapsed_s < MEAN_S:
            self._values, self._mean, self._variance, self._far = 1, fresh, np.zeros(2), np.zeros(2)
            return fresh.copy()
        limit = np.maximum(CHANGE_MPS, CHANGE_STDS * np.sqrt(self._variance))
        off = fresh - self._mean
        # Far off on the same side twice running: one such value is an error more often than a change.
        far = np.where(np.abs(off) > limit, off, 0.0)
        changed = far * self._far > 0.0
        self._far = far
        steady = np.where(changed, fresh, self._shrunk())
        self._values += 1
        gain = max(-math.expm1(-elapsed_s / MEAN_S), 1.0 / self._values)
        self._mean = np.where(changed, fresh, self._mean + gain * off)
        # A change counts as a large error, too, or heavy errors would always pass for changes.
        self._variance = (1.0 - gain) * (self._variance + gain * np.minimum(off * off, limit * limit))
        return steady

    def _shrunk(self) -> Array:
        """The mean times the share of its square that is not noise."""
        square = self._mean * self._mean
        noise = self._variance * min(1.0, ERROR_LASTS_S / MEAN_S)
        share = np.divide(square - noise, square, out=np.zeros(2), where=square > noise)
        steady: Array = share * self._mean
        return steady
