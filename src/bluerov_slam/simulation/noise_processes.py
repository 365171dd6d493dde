"""Slowly varying random quantities: known at any virtual time, whoever asks first, in whatever order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BLOCK_STEPS = 512


class GaussMarkov:
    """Independent first-order Gauss-Markov processes with one time constant, on a grid that grows as it is asked for.

    Each starts from its stationary distribution, unless `first` says where. Between grid points values are linear.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        std: Sequence[float],
        time_constant_s: float,
        step_s: float = 1.0,
        first: Sequence[float] | None = None,
    ) -> None:
        self._rng = rng
        self._std = np.array(std, np.float64)
        self._keep = math.exp(-step_s / time_constant_s)
        self._step_s = step_s
        start = self._std * rng.standard_normal(len(self._std)) if first is None else np.array(first, np.float64)
        self._values = start[None, :]

    def at(self, at_s: float) -> FloatArray:
        """The values at one time; before 0 those of 0."""
        place = max(0.0, at_s / self._step_s)
        index = int(place)
        self._reach(index + 1)
        share = place - index
        values: FloatArray = self._values[index] * (1.0 - share) + self._values[index + 1] * share
        return values

    def slope(self, at_s: float) -> FloatArray:
        """Per second, at one time."""
        index = int(max(0.0, at_s / self._step_s))
        self._reach(index + 1)
        slope: FloatArray = (self._values[index + 1] - self._values[index]) / self._step_s
        return slope

    def many(self, times_s: FloatArray) -> FloatArray:
        """The values at many times: (n, processes)."""
        place = np.maximum(0.0, times_s / self._step_s)
        index = place.astype(np.intp)
        if len(index):
            self._reach(int(index.max()) + 1)
        share = (place - index)[:, None]
        values: FloatArray = self._values[index] * (1.0 - share) + self._values[index + 1] * share
        return values

    def _reach(self, index: int) -> None:
        while index >= len(self._values):
            fresh = self._rng.standard_normal((_BLOCK_STEPS, len(self._std)))
            fresh *= self._std * math.sqrt(1.0 - self._keep**2)
            last = self._values[-1]
            for step in fresh:
                last = last * self._keep + step
                step[:] = last
            self._values = np.concatenate((self._values, fresh))


def random_walk_time_constant_s(std: float, walk_per_root_s: float) -> float:
    """Time constant of the Gauss-Markov process with this spread that over short spans walks like this."""
    return 2.0 * std**2 / walk_per_root_s**2
