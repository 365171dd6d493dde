"""Receivers in another order than in the settings, told by how their directions stand in the world.

Exchanging opposite corners of a square mirrors or turns the direction: a plane wave as good as the true one, so the
delays of one pulse cannot tell. But attitude is known: a transmitter stands still in the world while the vehicle
turns, and its mirror image turns with the vehicle, the other way. Where the vehicle's place is known, so is the
direction.

Every order of the receivers is held against the last pulses, by the squared normalised error that the best transmitter
leaves: one far away (or near where the navigator expects it) that moves slowly across, by the vehicle's own way.

What no attitude ever tells of a flat array: a turn of half a circle about its normal (both pairs of opposite corners
exchanged) is a transmitter on the other side. So an exchange of one diagonal and that of the other look alike, and a
turn about the normal alone hides turns by a quarter, too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.array import FLAT_SHARE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bluerov_slam.acoustics.array import ReceiverArray
    from bluerov_slam.pipeline.acoustic_callers import Expected

    Array = NDArray[np.float64]

WATCHED: Final = 24
FEWEST: Final = 8
# With more receivers only exchanges of two are looked at: 6! orders would take too long.
MOST_IN_ANY_ORDER: Final = 5
# [choice] of one direction, as cosines: 3 deg of the water, and as much for mounting and what wanders.
DIRECTION_STD: Final = 0.07
# [choice] what a plane wave leaves: places, timing, and the curvature of a source a few metres away.
MISFIT_STD_M: Final = 0.01
MOST_MISFIT: Final = 9.0
# [choice] across the line of sight, per second: 0.5 m/s at 20 m; by the navigator's own error where its way is known.
DRIFT_PER_S: Final = 0.025
KNOWN_DRIFT_PER_S: Final = 0.005
# Errors beyond count less and less: a pulse in ten comes by an echo.
TOLERATED: Final = 6.0
STEPS: Final = 4
# [tuned on seeds 0..99] how much better another order must explain the pulses, and how well.
GAIN: Final = 40.0
ALIKE: Final = 8.0
WORST: Final = 5.0
# Two wrong plugs are an exchange; more of them at once are rarer.
RARER: Final = 12.0
# By the navigator's place the given order must be off by more than any navigator that is a little too sure: 17 deg.
LEAST_OFF: Final = 0.3
EXCHANGED: Final = "receivers {} seem exchanged"
ELSEWHERE: Final = "the sound does not come from where the transmitter should be, but would with receivers {} exchanged"


@dataclass(frozen=True, eq=False)
class _Pulse:
    at_s: float
    ranges_m: Array
    rotation_ned_array: Array
    expected: Expected | None


class OrderWatch:
    """`hear` pulses that all receivers heard and whose attitude is known."""

    def __init__(self, array: ReceiverArray) -> None:
        count = len(array)
        self._orders = np.array(_orders(count))  # the given one first
        moved = (self._orders != np.arange(count)).sum(axis=1)
        self._rarity = np.where(moved > 2, RARER, 0.0)
        left, values, right = np.linalg.svd(array.positions_m - array.positions_m.mean(axis=0), full_matrices=False)
        kept = values > FLAT_SHARE * values[0]
        self._span = right[kept]  # (r, 3)
        self._solve = (left[:, kept] / -values[kept]).T  # (r, n): arrivals times c to cosines along the span
        basis = np.column_stack((np.full(count, count**-0.5), left[:, kept]))
        self._across = np.eye(count) - basis @ basis.T
        self._heard: deque[_Pulse] = deque(maxlen=WATCHED)
        self._found: Sequence[int] = ()
        self._words = ""

    def hear(self, at_s: float, ranges_m: Array, rotation_ned_array: Array, expected: Expected | None) -> str:
        """Take arrivals (n,) times the sound speed; in words, which receivers seem exchanged by now, empty for none.

        Found once, it stands on a straight way, which tells nothing, until the given order explains the pulses better.
        """
        self._heard.append(_Pulse(at_s, ranges_m - ranges_m.mean(), rotation_ned_array, expected))
        if len(self._heard) < FEWEST:
            return self._words
        found, words = self._judge(known=False), EXCHANGED
        if all(pulse.expected is not None for pulse in self._heard):
            by_place = self._judge(known=True)
            if not found:
                found, words = by_place, ELSEWHERE
            elif both := [each for each in found if each in by_place]:
                found = both  # the place tells one diagonal from the other
        if found:
            self._found = found
            self._words = words.format(" or ".join(sorted(_named(self._orders[each].tolist()) for each in found)))
        elif self._found and self._is_contradicted():
            self._found, self._words = (), ""
        return self._words

    def _judge(self, known: bool) -> list[int]:
        """Orders that explain the pulses much better than the given one, the likeliest first."""
        cost = self._costs(known) + self._rarity
        best = int(np.argmin(cost))
        if cost[0] - cost[best] < GAIN or cost[best] - self._rarity[best] > WORST * len(self._heard):
            return []
        return [each for each in np.argsort(cost, kind="stable").tolist() if cost[each] < cost[best] + ALIKE]

    def _is_contradicted(self) -> bool:
        cost = self._costs(known=False)
        return bool(cost[0] < cost[list(self._found)].min() - ALIKE)

    def _costs(self, known: bool) -> Array:
        """Of every order: squared normalised errors of all pulses, large ones counted by their logarithm."""
        pulses = list(self._heard)
        ranges = np.stack([pulse.ranges_m for pulse in pulses])[:, self._orders]  # (k, h, n)
        misfit = np.sum((ranges @ self._across) ** 2, axis=2).T / MISFIT_STD_M**2  # (h, k)
        # What is no plane wave in most pulses needs no direction: of a square's 24 orders 8 are left.
        waves = np.median(misfit, axis=1) < MOST_MISFIT
        waves[0] = True
        misfit = misfit[waves]
        seen = np.moveaxis(ranges[:, waves] @ self._solve.T, 0, 1)  # (h, k, r)
        rows = np.stack([self._span @ pulse.rotation_ned_array.T for pulse in pulses])  # from NED to the span (k, r, 3)
        times_s = np.array([pulse.at_s for pulse in pulses], dtype=np.float64)
        times_s -= times_s.mean()
        first_std, drift = 1.0, DRIFT_PER_S
        if known:
            told = [pulse.expected for pulse in pulses if pulse.expected is not None]
            seen = seen - np.stack([row @ each.direction_ned for row, each in zip(rows, told, strict=True)])
            if np.median(np.linalg.norm(seen[0], axis=1)) < LEAST_OFF:
                return np.zeros(len(self._orders))
            first_std, drift = max(each.std_rad for each in told), KNOWN_DRIFT_PER_S
        both = np.concatenate((rows, rows * times_s[:, None, None]), axis=2) / DIRECTION_STD  # (k, r, 6)
        target = seen / DIRECTION_STD
        prior = np.repeat((first_std**-2.0, drift**-2.0), 3)
        weight = np.ones(misfit.shape)
        for _ in range(STEPS):
            normal = np.einsum("hk,kri,krj->hij", weight, both, both) + np.diag(prior)
            right = np.einsum("hk,kri,hkr->hi", weight, both, target)
            found = np.linalg.solve(normal, right[..., None])[..., 0]  # (h, 6)
            left = np.sum((target - np.einsum("kri,hi->hkr", both, found)) ** 2, axis=2) + misfit
            weight = 1.0 / (1.0 + left / TOLERATED)
        cost = np.full(len(waves), np.inf)
        cost[waves] = TOLERATED * np.sum(np.log1p(left / TOLERATED), axis=1) + found**2 @ prior
        return cost


def _orders(count: int) -> list[tuple[int, ...]]:
    """Who may stand at each receiver's place: the receivers as given, then every other order."""
    given = tuple(range(count))
    if count <= MOST_IN_ANY_ORDER:
        return sorted(permutations(given), key=lambda order: order != given)
    orders = [given]
    for first, second in combinations(given, 2):
        order = list(given)
        order[first], order[second] = second, first
        orders.append(tuple(order))
    return orders


def _named(order: list[int]) -> str:
    """The receivers that go round in this order, as words: exchanges of two, and longer rings."""
    left, rings = set(range(len(order))), []
    while left:
        ring = [min(left)]
        while (after := order[ring[-1]]) != ring[0]:
            ring.append(after)
        left -= set(ring)
        if len(ring) > 1:
            rings.append(" and ".join((", ".join(map(str, ring[:-1])), str(ring[-1]))))
    return ", ".join(rings)
