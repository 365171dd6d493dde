"""Whether stated errors are true: normalised squared errors and the bands they should lie in.

NIS, the normalised innovation squared, needs no truth: residual' S^-1 residual of a measurement follows a chi-square
distribution with as many degrees of freedom as it has components. NEES, the same of the estimate's error, needs it.
Sums over independent values follow a chi-square distribution, too, which gives the band of a mean. Values of one run
are correlated where the errors they share are slow; a band is then too narrow, never too wide.

Source: Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to Tracking and Navigation, 5.4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.ekf import UpdateResult

Array = NDArray[np.float64]

BAND_PROBABILITY = 0.95
WINDOW_VALUES = 200


def band(dof: float, probability: float = BAND_PROBABILITY) -> tuple[float, float]:
    """Bounds that a chi-square variable of `dof` degrees of freedom leaves equally rarely on either side."""
    tail = 0.5 * (1.0 - probability)
    return chi_square_quantile(tail, dof), chi_square_quantile(1.0 - tail, dof)


def normalised_squared_error(error: Array, covariance: Array) -> float:
    """e' P^-1 e; NaN where the covariance is not positive definite."""
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return float("nan")
    whitened = np.linalg.solve(factor, error)
    return float(whitened @ whitened)


def share_inside(values: Iterable[float], dof: float, probability: float = BAND_PROBABILITY) -> float:
    """Share of single values inside their band; NaN without values."""
    low, high = band(dof, probability)
    inside = [low <= value <= high for value in values]
    return sum(inside) / len(inside) if inside else float("nan")


class NisWindow:
    """The newest tested values of one sensor, those refused by the gate included."""

    def __init__(self, most: int = WINDOW_VALUES) -> None:
        self._values: deque[tuple[float, int]] = deque(maxlen=most)
        self._nis = 0.0
        self._dof = 0

    def add(self, result: UpdateResult) -> None:
        """Take in one more; the oldest leaves a full window."""
        if len(self._values) == self._values.maxlen:
            nis, dof = self._values[0]
            self._nis -= nis
            self._dof -= dof
        self._values.append((result.nis, result.dof))
        self._nis += result.nis
        self._dof += result.dof

    @property
    def count(self) -> int:
        """How many values there are."""
        return len(self._values)

    @property
    def ratio(self) -> float | None:
        """Mean NIS per degree of freedom: about 1 when the stated errors are right; None without values."""
        return max(0.0, self._nis) / self._dof if self._dof else None

    @property
    def band(self) -> tuple[float, float] | None:
        """Where `ratio` should lie, were the values independent of each other; None without values."""
        if not self._dof:
            return None
        low, high = band(self._dof)
        return low / self._dof, high / self._dof

    @property
    def median_ratio(self) -> float | None:
        """Median NIS per its expected median: what `ratio` would be without a few outliers; None without values."""
        if not self._values:
            return None
        return float(np.median([nis / chi_square_quantile(0.5, dof) for nis, dof in self._values]))

    def clear(self) -> None:
        """Begin again, as after a change of the sensor's noise."""
        self._values.clear()
        self._nis, self._dof = 0.0, 0


class NisStatistics:
    """A window per sensor."""

    def __init__(self, most: int = WINDOW_VALUES) -> None:
        self._most = most
        self.windows: dict[str, NisWindow] = {}

    def add(self, result: UpdateResult) -> None:
        """Put a result in its sensor's window."""
        self.windows.setdefault(result.sensor, NisWindow(self._most)).add(result)
