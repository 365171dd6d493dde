"""What a handful of seeds says: intervals by resampling, chi-square bands and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.chi_square import chi_square_quantile

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

_RESAMPLES = 2000
BAND = (0.025, 0.975)


@dataclass(frozen=True, slots=True)
class Interval:
    """A statistic with the 95 % interval that resampling the seeds gives."""

    value: float
    low: float
    high: float


def bootstrap(
    values: Sequence[float] | NDArray[np.float64],
    statistic: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> Interval:
    """Median of independent values and its percentile interval.

    `values` (n,) or (n, k); another `statistic` takes them as (..., n) or (..., n, k) and gives (...). The resampling
    is always the same: equal values give equal intervals. Source: Efron and Tibshirani (1993), ch. 13.
    """
    taken = statistic or (lambda rows: np.median(rows, axis=-1))
    numbers = np.asarray(values, dtype=float)
    chosen = np.random.default_rng(0).integers(0, len(numbers), (_RESAMPLES, len(numbers)))
    low, high = np.quantile(taken(numbers[chosen]), BAND)
    return Interval(float(taken(numbers[None])[0]), float(low), float(high))


def ratio_of_rms(pairs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square of the first over that of the second of each pair: (..., n, 2) -> (...)."""
    squares = np.mean(pairs**2, axis=-2)
    return np.asarray(np.sqrt(squares[..., 0] / squares[..., 1]))


def ratio_of_sums(pairs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of the first over the sum of the second of each pair: (..., n, 2) -> (...)."""
    sums = np.sum(pairs, axis=-2)
    return np.asarray(sums[..., 0] / sums[..., 1])


def root_mean_square(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Along the last axis."""
    return np.asarray(np.sqrt(np.mean(rows**2, axis=-1)))


def nees(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalised estimation error squared of each epoch: errors (n, k), covariances (n, k, k)."""
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.asarray(np.einsum("nk,nk->n", errors, solved))


def share_in_band(squared: NDArray[np.float64], dof: int) -> float:
    """Share of the epochs whose NEES lies inside the two-sided 95 % chi-square band."""
    low, high = (chi_square_quantile(each, float(dof)) for each in BAND)
    return float(np.mean((squared >= low) & (squared <= high)))


def mean_band(dof: int, runs: int) -> tuple[float, float]:
    """Band of the mean NEES / dof over independent runs."""
    low, high = (chi_square_quantile(each, float(dof * runs)) / (dof * runs) for each in BAND)
    return low, high


def lowest_credible_ratio(total_dof: float) -> float:
    """2.5 % limit of an RMS error over its bound: an RMS of true, linear, Gaussian errors is hardly ever lower.

    `total_dof`: effective degrees of freedom of the sum of squares over all seeds.
    """
    return math.sqrt(chi_square_quantile(BAND[0], total_dof) / total_dof)


def total_dof(mean_squares: Sequence[float], dofs: Sequence[float]) -> float:
    """Effective degrees of freedom of a sum of independent squares with these means and degrees of freedom.

    Source: Satterthwaite (1946), doi:10.2307/3002019.
    """
    return sum(mean_squares) ** 2 / sum(mean**2 / dof for mean, dof in zip(mean_squares, dofs, strict=True))
