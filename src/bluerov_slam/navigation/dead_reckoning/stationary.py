"""Whether an inertial sensor stands still: the generalised likelihood ratio of a window of samples.

I. Skog, P. Handel, J.-O. Nilsson, J. Rantakokko, Zero-velocity detection: an algorithm evaluation (2010),
doi:10.1109/TBME.2010.2060723 (the detector called SHOE): how far the forces of a window are from one constant vector of
gravity's length, and the rates from zero, both in units of their noise. It sees lateral motion as well as vertical.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_LEAST_FORCE_STD_MPS2 = 0.002
_LEAST_RATE_STD_RADPS = 0.0003


class StationaryDetector:
    """`statistic` is the mean square per degree of freedom: 1 at rest where the noises given are right; still below
    `limit`, which lies five sigma above at 30 samples.

    The noises must be the sensor's own (`from_rest` measures them): the defaults are an LSM6DSOX's at 208 Hz. Motion at
    constant velocity without any ripple cannot be told from rest by anyone.
    """

    def __init__(
        self,
        window_samples: int = 30,
        force_std_mps2: float = 0.01,
        rate_std_radps: float = 0.0015,
        gravity_mps2: float = 9.80665,
        limit: float = 1.6,
    ) -> None:
        self.window_samples = window_samples
        self._force_std = force_std_mps2
        self._rate_std = rate_std_radps
        self._gravity = gravity_mps2
        self._limit = limit
        self._forces: deque[Sequence[float]] = deque(maxlen=window_samples)
        self._rates: deque[Sequence[float]] = deque(maxlen=window_samples)
        self.statistic: float | None = None

    @classmethod
    def from_rest(
        cls, rates_radps: NDArray[np.float64], forces_mps2: NDArray[np.float64], window_samples: int = 30
    ) -> StationaryDetector:
        """A detector with the noises of samples (n, 3) at rest, gyro bias taken off."""
        force_std = math.sqrt(float(forces_mps2.var(axis=0, ddof=1).mean()))
        rate_std = math.sqrt(float((rates_radps**2).mean()))
        return cls(window_samples, max(force_std, _LEAST_FORCE_STD_MPS2), max(rate_std, _LEAST_RATE_STD_RADPS))

    def update(self, angular_rate_frd_radps: Sequence[float], specific_force_frd_mps2: Sequence[float]) -> bool:
        """Whether the last window was still; False until a window is full."""
        self._forces.append(specific_force_frd_mps2)
        self._rates.append(angular_rate_frd_radps)
        if len(self._forces) < self.window_samples:
            return False
        forces, rates = np.array(self._forces), np.array(self._rates)
        mean = forces.mean(axis=0)
        length = float(np.linalg.norm(mean))
        if length == 0.0:
            self.statistic = None
            return False
        # An accelerometer's own scale and bias change the length by some hundredths: that much is no motion.
        off_length = max(0.0, abs(length - self._gravity) - 0.15)
        scatter = float(((forces - mean) ** 2).sum()) / (len(forces) - 1) + off_length**2
        turning = float((rates**2).sum()) / len(rates)
        self.statistic = (scatter / self._force_std**2 + turning / self._rate_std**2) / 6.0
        return self.statistic < self._limit
