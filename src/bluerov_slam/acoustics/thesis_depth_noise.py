"""The noise the thesis's receiver put on the x it was told, in place of a depth sensor: always the same sequence.

A 32-bit linear congruential generator (1664525 s + 1013904223, seed 1) gives uniform numbers, the polar method of Box
and Muller pairs of normal ones, the second of a pair kept for the next call. x becomes x told less noise. The text says
5 mm; the logs say 0.5 mm, and none at all in tests 1 and 4.
"""

from __future__ import annotations

import math

import numpy as np

from bluerov_slam.acoustics.thesis_log import Floats

_MULTIPLIER, _INCREMENT, _MODULUS, _SEED = 1664525, 1013904223, 2**32, 1

_MOST_SKIPPED = 600
_FIRST_ROWS = 60
_GAP_COST, _MOST_COST = 12.0, 16.0
"""In squared standard deviations: a gap must save more than a few bad rows; a row cannot be worse than unexplained."""


def normal_sequence(count: int) -> Floats:
    """The first numbers of the receiver's generator, standard deviation one."""
    state = _SEED
    found: list[float] = []
    while len(found) < count:
        pair = []
        for _ in range(2):
            state = (_MULTIPLIER * state + _INCREMENT) % _MODULUS
            pair.append(2.0 * state / _MODULUS - 1.0)
        square = pair[0] ** 2 + pair[1] ** 2
        if 0.0 < square < 1.0:
            scale = math.sqrt(-2.0 * math.log(square) / square)
            found += [pair[0] * scale, pair[1] * scale]
    return np.array(found[:count])


def aligned(noise_mm: Floats, sequence: Floats) -> tuple[Floats, float]:
    """The numbers behind a log's noise (x told less x used, n rows), and their correlation with it.

    Every row has a number behind that of the row before; numbers between were drawn for fixes that were not logged, and
    each such gap must be worth its price. Found by dynamic programming.
    """
    scaled = noise_mm / np.std(noise_mm)
    begin = _begin(scaled, sequence)
    used = sequence[begin : begin + len(scaled) + _MOST_SKIPPED]
    came_from = np.zeros((len(scaled), len(used)), dtype=np.int64)
    columns = np.arange(len(used))
    cost = np.minimum((scaled[0] - used) ** 2, _MOST_COST)
    for i in range(1, len(scaled)):
        follows = np.concatenate([[np.inf], cost[:-1]])
        least = np.minimum.accumulate(cost)
        where = np.maximum.accumulate(np.where(cost == least, columns, 0))
        jumps = np.concatenate([[np.inf], least[:-1]]) + _GAP_COST
        came_from[i] = np.where(follows <= jumps, columns - 1, np.concatenate([[0], where[:-1]]))
        cost = np.minimum(follows, jumps) + np.minimum((scaled[i] - used) ** 2, _MOST_COST)
    column = int(np.argmin(cost))
    chosen = np.empty(len(scaled))
    for i in range(len(scaled) - 1, -1, -1):
        chosen[i] = used[column]
        column = int(came_from[i, column])
    return chosen, float(np.corrcoef(chosen, noise_mm)[0, 1])


def _begin(scaled: Floats, sequence: Floats) -> int:
    """Where the log begins in the sequence: at its start only if the receiver was started for it."""
    first = scaled[:_FIRST_ROWS]
    windows = np.lib.stride_tricks.sliding_window_view(sequence, len(first))
    fit = np.abs(windows - first)
    # The median bears a gap among the first rows, if it comes late; what was skipped before is found by the search.
    return int(np.argmin(np.median(fit, axis=1)))
