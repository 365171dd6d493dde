"""Errors of an estimated path against the true one. Nothing is aligned unless a name says so.

Paths are float64 (n, 2), north and east in metres, both at the same instants.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SEGMENTS_M = (10.0, 50.0, 100.0)


def path_length_m(path_ne_m: NDArray[np.float64]) -> float:
    """Length of the path."""
    return float(np.hypot(*np.diff(path_ne_m, axis=0).T).sum())


def ate_m(estimate_ne_m: NDArray[np.float64], truth_ne_m: NDArray[np.float64]) -> float:
    """Absolute trajectory error: root mean square distance, not aligned."""
    return float(math.sqrt(np.mean(np.sum((estimate_ne_m - truth_ne_m) ** 2, axis=1))))


def end_error_m(estimate_ne_m: NDArray[np.float64], truth_ne_m: NDArray[np.float64]) -> float:
    """Distance between the last points."""
    return float(math.hypot(*(estimate_ne_m[-1] - truth_ne_m[-1])))


def end_error_percent(estimate_ne_m: NDArray[np.float64], truth_ne_m: NDArray[np.float64]) -> float:
    """The same in per cent of the true path's length."""
    return 100.0 * end_error_m(estimate_ne_m, truth_ne_m) / path_length_m(truth_ne_m)


def aligned_ate_m(estimate_ne_m: NDArray[np.float64], truth_ne_m: NDArray[np.float64]) -> float:
    """What is left of the error after the best rotation and shift: the shape of the path, not its place.

    Source: Umeyama (1991), doi:10.1109/34.88573, in the plane and without scale.
    """
    estimate = estimate_ne_m - estimate_ne_m.mean(axis=0)
    truth = truth_ne_m - truth_ne_m.mean(axis=0)
    turn = math.atan2(
        float(np.sum(estimate[:, 0] * truth[:, 1] - estimate[:, 1] * truth[:, 0])), float(np.sum(estimate * truth))
    )
    return ate_m(estimate @ _turned(np.array([turn]))[0].T, truth)


def relative_error_m(
    estimate_ne_m: NDArray[np.float64],
    truth_ne_m: NDArray[np.float64],
    heading_error_rad: NDArray[np.float64],
    segment_m: float,
) -> float | None:
    """Relative pose error: root mean square error of the displacement over every true segment of this length.

    Each displacement is seen from the vehicle at the segment's start, so that an old heading error is not charged again
    (`heading_error_rad`: estimated minus true, (n,)). None where the path is shorter.
    """
    travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(truth_ne_m, axis=0).T))))
    ends = np.searchsorted(travelled, travelled + segment_m)
    starts = np.flatnonzero(ends < len(travelled))
    if len(starts) == 0:
        return None
    ends = ends[starts]
    turn = _turned(-heading_error_rad[starts])
    moved = np.einsum("kij,kj->ki", turn, estimate_ne_m[ends] - estimate_ne_m[starts])
    return float(math.sqrt(np.mean(np.sum((moved - (truth_ne_m[ends] - truth_ne_m[starts])) ** 2, axis=1))))


def rubber_band(
    at_s: NDArray[np.float64],
    path_ne_m: NDArray[np.float64],
    fixes_at_s: NDArray[np.float64],
    fixes_ne_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The path pulled onto fixes: the misfit at each is spread linearly in time to the next.

    Before the first fix and after the last one their misfits hold.
    """
    seen = np.column_stack([np.interp(fixes_at_s, at_s, path_ne_m[:, axis]) for axis in range(2)])
    misfit = fixes_ne_m - seen
    pull = np.column_stack([np.interp(at_s, fixes_at_s, misfit[:, axis]) for axis in range(2)])
    return np.asarray(path_ne_m + pull)


def dead_reckoned(
    at_s: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    velocity_fr_mps: NDArray[np.float64],
    start_ne_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Path from velocity forward and to starboard (n, 2) and heading (n,), by the trapezoid rule."""
    turn = _turned(heading_rad)
    velocity = np.einsum("kij,kj->ki", turn, velocity_fr_mps)
    steps = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(at_s)[:, None]
    return np.asarray(start_ne_m + np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0))))


def _turned(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (n, 2, 2) from north towards east."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    rotations: NDArray[np.float64] = np.stack((np.stack((cos, -sin), -1), np.stack((sin, cos), -1)), -2)
    return rotations
