"""Pattern search for the source: the thesis's solver, kept as a baseline, and one without its defects.

As published (Algorithm 1 and the listing of section 3.9.2): the receivers are already turned by the attitude, the
search starts at (depth, 0, 0) with a step of 2 m and no direction, and minimises the sum of squared differences between
measured and predicted delays, which is in s^2 (the text calls it m^2). Its defects are part of it: the first two
evaluations are spent on the start itself; the step is halved every time a direction is chosen, also the first time,
so that no step of 2 m is ever made; and a residual below 1e-13 s^2 ends the search 0.5 mm off at 2.6 m with perfect
input. The published 3-D variant writes six residuals into an array of four and does not compile; `hooke_jeeves_3d` is
the same algorithm with room for six.

`hooke_jeeves_corrected` explores first, halves the step only where exploring did not help, tries the pattern move of
the original paper and ends on the step alone.

Sources: J. Frabosilio, MS thesis, Cal Poly (2024); Hooke and Jeeves (1961), doi:10.1145/321062.321069.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Point = list[float]

THESIS_STEP_M = 2.0
THESIS_FACTOR = 2.0
THESIS_ITERATIONS = 1000
THESIS_RESIDUAL_S2 = 1e-13
THESIS_LEAST_STEP_M = 1e-6
START_RESIDUAL_S2 = 1e9


@dataclass(frozen=True, slots=True)
class PatternSearch:
    """Where a search ended, and what it took."""

    position_m: Array
    residual_s2: float
    iterations: int
    evaluations: int
    step_m: float


def hooke_jeeves_2d(
    receivers_m: ArrayLike,
    delays_s: ArrayLike,
    sound_speed_mps: float,
    depth_m: float,
    *,
    most_iterations: int = THESIS_ITERATIONS,
    least_residual_s2: float = THESIS_RESIDUAL_S2,
    least_step_m: float = THESIS_LEAST_STEP_M,
    factor: float = THESIS_FACTOR,
) -> PatternSearch:
    """As published: the source's y and z at the known x. Receivers (k, 3), reference first; delays (k-1,)."""
    return _published(
        _Residual(receivers_m, delays_s, sound_speed_mps),
        (1, 2),
        depth_m,
        (most_iterations, least_residual_s2, least_step_m, factor),
    )


def hooke_jeeves_3d(
    receivers_m: ArrayLike,
    delays_s: ArrayLike,
    sound_speed_mps: float,
    depth_m: float,
    *,
    most_iterations: int = THESIS_ITERATIONS,
    least_residual_s2: float = THESIS_RESIDUAL_S2,
    least_step_m: float = THESIS_LEAST_STEP_M,
    factor: float = THESIS_FACTOR,
) -> PatternSearch:
    """As intended: the same from the same start, with x free as well."""
    return _published(
        _Residual(receivers_m, delays_s, sound_speed_mps),
        (0, 1, 2),
        depth_m,
        (most_iterations, least_residual_s2, least_step_m, factor),
    )


def hooke_jeeves_corrected(
    receivers_m: ArrayLike,
    delays_s: ArrayLike,
    sound_speed_mps: float,
    depth_m: float,
    *,
    axes: tuple[int, ...] = (1, 2),
    start_m: ArrayLike | None = None,
    step_m: float = 1.0,
    least_step_m: float = THESIS_LEAST_STEP_M,
    most_evaluations: int = 20_000,
) -> PatternSearch:
    """Hooke and Jeeves's own search over some axes, from (depth, 0, 0) or a start of one's own."""
    residual = _Residual(receivers_m, delays_s, sound_speed_mps)
    base: Point = [depth_m, 0.0, 0.0] if start_m is None else [float(value) for value in np.asarray(start_m)]
    least = residual(base)
    step = step_m
    iterations = 0
    while step >= least_step_m and residual.evaluations < most_evaluations:
        iterations += 1
        place, value = _explore(residual, base, least, axes, step)
        if value >= least:
            step *= 0.5
            continue
        while value < least:
            # The pattern: go on as far as the last success went, and explore around there.
            ahead = [2.0 * new - old for new, old in zip(place, base, strict=True)]
            base, least = place, value
            place, value = _explore(residual, ahead, residual(ahead), axes, step)
    return PatternSearch(np.array(base), least, iterations, residual.evaluations, step)


class _Residual:
    """Sum of squared delay errors at a point, in plain floats: for four receivers faster than array operations."""

    def __init__(self, receivers_m: ArrayLike, delays_s: ArrayLike, sound_speed_mps: float) -> None:
        self._receivers = [tuple(row) for row in np.asarray(receivers_m, dtype=np.float64).tolist()]
        self._delays = np.asarray(delays_s, dtype=np.float64).tolist()
        if len(self._delays) != len(self._receivers) - 1:
            raise ValueError(f"{len(self._delays)} delays for {len(self._receivers)} receivers")
        self._per_speed = 1.0 / sound_speed_mps
        self.evaluations = 0

    def __call__(self, point: Point) -> float:
        self.evaluations += 1
        x, y, z = point
        arrivals = [
            math.sqrt((x - a) * (x - a) + (y - b) * (y - b) + (z - c) * (z - c)) * self._per_speed
            for a, b, c in self._receivers
        ]
        first = arrivals[0]
        total = 0.0
        for arrival, delay in zip(arrivals[1:], self._delays, strict=True):
            error = delay - (first - arrival)
            total += error * error
        return total


def _published(
    residual_at: Callable[[Point], float],
    axes: tuple[int, ...],
    depth_m: float,
    stops: tuple[int, float, float, float],
) -> PatternSearch:
    """Algorithm 1, line by line."""
    most_iterations, least_residual, least_step, factor = stops
    position: Point = [depth_m, 0.0, 0.0]
    direction: Point = [0.0, 0.0, 0.0]
    residual, step = START_RESIDUAL_S2, THESIS_STEP_M
    choose = False
    iterations = evaluations = 0
    while iterations < most_iterations and residual > least_residual and step > least_step:
        if choose:
            step /= factor
            tried: list[tuple[float, Point]] = []
            for axis in axes:
                for sign in (-1.0, 1.0):
                    unit = [0.0, 0.0, 0.0]
                    unit[axis] = sign
                    tried.append((residual_at(_moved(position, unit, step)), unit))
            evaluations += len(tried)
            best, toward = min(tried, key=lambda pair: pair[0])
            if best < residual:
                residual, direction = best, toward
                position = _moved(position, direction, step)
                choose = False
        else:
            ahead = _moved(position, direction, step)
            value = residual_at(ahead)
            evaluations += 1
            if value < residual:
                residual, position = value, ahead
            else:
                choose = True
        iterations += 1
    return PatternSearch(np.array(position), residual, iterations, evaluations, step)


def _moved(position: Point, direction: Point, step: float) -> Point:
    return [value + unit * step for value, unit in zip(position, direction, strict=True)]


def _explore(
    residual: _Residual, around: Point, value: float, axes: tuple[int, ...], step: float
) -> tuple[Point, float]:
    """The best of a step to each side along one axis after the other."""
    place, least = list(around), value
    for axis in axes:
        kept = place[axis]
        for side in (kept + step, kept - step):
            place[axis] = side
            tried = residual(place)
            if tried < least:
                least = tried
                break
            place[axis] = kept
    return place, least
