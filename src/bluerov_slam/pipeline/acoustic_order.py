"""Receivers exchanged on opposite corners: their delays are those of a mirrored source, and only turning tells.

Such an exchange is a plane wave as good as the true one. But the direction that it gives turns with the vehicle, the
other way, instead of standing still in the world.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.array import FLAT_SHARE
from bluerov_slam.acoustics.receiver_faults import LEAST_SWAP_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.acoustics.array import ReceiverArray

    Array = NDArray[np.float64]
    Pairs = tuple[tuple[int, int], ...]

WATCHED: Final = 24
FEWEST: Final = 8
# In a direction's cosines: 0.3 is 17 degrees.
LEAST_OFF: Final = 0.3
GAIN: Final = 2.5
ALIKE: Final = 0.1
LEAST_MISFIT_M: Final = 1500.0 * LEAST_SWAP_S


class OrderWatch:
    """`hear` pulses that all receivers heard and whose attitude is known."""

    def __init__(self, array: ReceiverArray) -> None:
        self._count = len(array)
        left, values, right = np.linalg.svd(array.positions_m - array.positions_m.mean(axis=0), full_matrices=False)
        kept = values > FLAT_SHARE * values[0]
        self._span = right[kept]  # (r, 3)
        self._solve = (right[kept].T / values[kept]) @ left[:, kept].T  # (3, n): -c arrivals to a direction
        basis = np.column_stack((np.full(self._count, self._count**-0.5), left[:, kept]))
        self._across = np.eye(self._count) - basis @ basis.T
        self._heard: deque[tuple[Array, Array]] = deque(maxlen=WATCHED)
        self._found: Pairs = ()

    def hear(self, ranges_m: Array, rotation_ned_array: Array) -> Pairs:
        """Take arrivals (n,) times the sound speed; which two receivers seem exchanged by now, one pair or the other.

        Found while turning, it stands on a straight way, which tells nothing, until turning contradicts it.
        """
        self._heard.append((ranges_m - ranges_m.mean(), rotation_ned_array))
        if len(self._heard) < FEWEST:
            return self._found
        ranges = np.stack([each for each, _ in self._heard])
        given = self._off(ranges)
        if self._found and self._off(_exchanged(ranges, *self._found[0])) > max(LEAST_OFF, GAIN * given):
            self._found = ()
        if given >= LEAST_OFF:
            found = []
            for pair in combinations(range(self._count), 2):
                swapped = _exchanged(ranges, *pair)
                if np.median(np.sqrt(np.mean((swapped @ self._across) ** 2, axis=1))) < LEAST_MISFIT_M:
                    found.append((self._off(swapped), pair))
            best = min(found, default=(math.inf, (0, 0)))[0]
            if GAIN * best < given:
                self._found = tuple(pair for off, pair in found if off < 2.0 * best + ALIKE)
        return self._found

    def _off(self, ranges_m: Array) -> float:
        """How far directions are from any one place in the world (as cosines)."""
        seen = -(ranges_m @ self._solve.T) @ self._span.T  # (k, r)
        rows = np.stack([self._span @ rotation.T for _, rotation in self._heard])  # from NED to the span (k, r, 3)
        still = np.linalg.lstsq(rows.reshape(-1, 3), seen.reshape(-1), rcond=1e-3)[0]
        # The middle pulse, not the mean: echoes come among them.
        return float(np.median(np.sqrt(np.sum((seen - rows @ still) ** 2, axis=1))))


def _exchanged(ranges_m: Array, first: int, second: int) -> Array:
    swapped = ranges_m.copy()
    swapped[:, [first, second]] = ranges_m[:, [second, first]]
    return swapped
