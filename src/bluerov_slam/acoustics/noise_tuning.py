"""Tunes a filter's noise: the settings of least cost on a grid, one at a time until none helps.

A cost is minus the log likelihood of the innovations where there is no truth (Schweppe 1965,
doi:10.1109/TIT.1965.1053737), or an error where there is. Grids instead of a descent: the likelihood of a filter with
slips has kinks, and a result on a grid is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from bluerov_slam.acoustics.slip_lattice import LatticeSettings

_LEAST_GAIN = 1e-4
MOST_ROUNDS = 4


def tune(
    cost: Callable[[LatticeSettings], float],
    start: LatticeSettings,
    grids: Mapping[str, Sequence[float]],
    rounds: int = MOST_ROUNDS,
) -> tuple[LatticeSettings, float]:
    """The settings found and their cost; `start` may lie beside the grids, what is moved lies on them."""
    best, least = start, cost(start)
    for _ in range(rounds):
        before = best
        for name, grid in grids.items():
            best, least = _along(cost, best, least, name, grid)
        if best == before:
            break
    return best, least


def _along(
    cost: Callable[[LatticeSettings], float], best: LatticeSettings, least: float, name: str, grid: Sequence[float]
) -> tuple[LatticeSettings, float]:
    here = min(range(len(grid)), key=lambda k: abs(grid[k] - getattr(best, name)))
    for step in (1, -1):
        k = here + step
        while 0 <= k < len(grid):
            changed = replace(best, **{name: grid[k]})
            found = cost(changed)
            if found >= least - _LEAST_GAIN * abs(least):
                break
            best, least, k = changed, found, k + step
        if k != here + step:
            break
    return best, least
