"""Fixed-interval smoothing: what all measurements of a recorded run, later ones included, say about every instant.

The result is that of Rauch, Tung and Striebel (1965), got in the form of Bryson and Frazier (1963; Bierman 1973, "Fixed
interval smoothing with discrete measurements"): a vector l and a matrix L run backwards through what the filter did,
and at a stored estimate x with covariance P

    smoothed error = P l        smoothed covariance = P - P L P

No covariance is inverted, so states that are known almost perfectly, or not excited at all, do no harm; and a
covariance is stored only where a result is wanted. All of it is in the error state about the filter's own estimates:
where the filter corrected its estimate the error was expressed anew about the corrected one, and so is l. At the end
the smoothed error moves the stored estimate, and its covariance is expressed about the moved one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.state import ATTITUDE, NavEstimate, turn_of_correction

Array = NDArray[np.float64]

KEEP_EVERY_S = 0.25
"""A result every quarter of a second: at 2 m/s half a metre of track; 100 MB of covariances per hour."""


@dataclass(slots=True)
class PredictionStep:
    """A prediction and, where a result is wanted, the state it ended in. The very first step has no transition."""

    top: Array | None
    decay: Array | None
    estimate: NavEstimate | None
    covariance: Array | None


@dataclass(frozen=True, slots=True)
class UpdateStep:
    """A measurement that was used: H, K, inverse of S, residual, and `turn_of_correction`."""

    jacobian: Array
    gain: Array
    inverse: Array
    residual: Array
    turn: Array


@dataclass(frozen=True, slots=True)
class ResetStep:
    """A block that was forgotten."""

    place: slice


@dataclass(frozen=True, slots=True)
class MixedStep:
    """A block's error that got a share of another's."""

    place: slice
    other: slice
    share: Array


Step = PredictionStep | UpdateStep | ResetStep | MixedStep


@dataclass(frozen=True, slots=True)
class SmoothedState:
    """Estimate and covariance (n, n) of its error given the whole run."""

    at_s: float
    estimate: NavEstimate
    covariance: Array


class StepRecorder:
    """The filter's `recorder`: keeps what `smooth` needs, estimates at least `keep_every_s` apart and the last one."""

    def __init__(self, keep_every_s: float = KEEP_EVERY_S) -> None:
        self.steps: list[Step] = []
        self._keep_every_s = keep_every_s
        self._last_kept_s = -np.inf
        self._newest: PredictionStep | None = None

    def predicted(self, estimate: NavEstimate, covariance: Array, top: Array | None, decay: Array | None) -> None:
        """Keep a prediction; drop the state of the one before unless its time had come."""
        newest = self._newest
        if newest is not None and newest.estimate is not None:
            # A hair less: twenty steps of 0.05 s are a second also when their sum is not.
            if newest.estimate.at_s - self._last_kept_s > self._keep_every_s * (1.0 - 1e-6):
                self._last_kept_s = newest.estimate.at_s
            else:
                newest.estimate = newest.covariance = None
        self._newest = PredictionStep(top, decay, estimate.copy(), covariance.copy())
        self.steps.append(self._newest)

    def updated(self, jacobian: Array, gain: Array, inverse: Array, residual: Array, turn: Array) -> None:
        """Keep a correction."""
        self.steps.append(UpdateStep(jacobian, gain, inverse, residual, turn))

    def block_reset(self, place: slice) -> None:
        """Keep a reset."""
        self.steps.append(ResetStep(place))

    def errors_mixed(self, place: slice, other: slice, share: Array) -> None:
        """Keep what became of the errors."""
        self.steps.append(MixedStep(place, other, share))

    def mark(self) -> tuple[int, float, PredictionStep | None, NavEstimate | None, Array | None]:
        """Where `rewind` can go back to."""
        newest = self._newest
        if newest is None:
            return len(self.steps), self._last_kept_s, None, None, None
        return len(self.steps), self._last_kept_s, newest, newest.estimate, newest.covariance

    def rewind(self, mark: tuple[int, float, PredictionStep | None, NavEstimate | None, Array | None]) -> None:
        """Forget all that was recorded since `mark`."""
        count, self._last_kept_s, self._newest, estimate, covariance = mark
        del self.steps[count:]
        if self._newest is not None:
            self._newest.estimate, self._newest.covariance = estimate, covariance


def smooth(steps: Sequence[Step]) -> list[SmoothedState]:
    """Smoothed states, in order of time, of every step that kept its estimate."""
    size = next((step.estimate.layout.size for step in steps if isinstance(step, PredictionStep) and step.estimate), 0)
    vector, matrix = np.zeros(size), np.zeros((size, size))
    states: list[SmoothedState] = []
    for step in reversed(steps):
        if isinstance(step, PredictionStep):
            if step.estimate is not None and step.covariance is not None:
                states.append(_smoothed(step.estimate, step.covariance, vector, matrix))
            if step.top is not None and step.decay is not None:
                vector, matrix = _before_prediction(step.top, step.decay, vector, matrix)
        elif isinstance(step, UpdateStep):
            vector, matrix = _before_update(step, vector, matrix)
        elif isinstance(step, MixedStep):
            vector[step.other] += step.share.T @ vector[step.place]
            matrix[step.other, :] += step.share.T @ matrix[step.place, :]
            matrix[:, step.other] += matrix[:, step.place] @ step.share
        else:
            vector[step.place] = 0.0
            matrix[step.place, :] = 0.0
            matrix[:, step.place] = 0.0
    states.reverse()
    return states


def _before_prediction(top: Array, decay: Array, vector: Array, matrix: Array) -> tuple[Array, Array]:
    """F' l and F' L F for a transition F with full top rows and a diagonal below."""
    moving, span = top.shape
    earlier = np.empty_like(vector)
    earlier[:moving] = 0.0
    earlier[moving:] = decay * vector[moving:]
    earlier[:span] += top.T @ vector[:moving]
    right = matrix.copy()
    right[:, moving:] *= decay
    right[:, :moving] = 0.0
    right[:, :span] += matrix[:, :moving] @ top
    both = right.copy()
    both[moving:] *= decay[:, None]
    both[:moving] = 0.0
    both[:span] += top.T @ right[:moving]
    return earlier, 0.5 * (both + both.T)


def _before_update(step: UpdateStep, vector: Array, matrix: Array) -> tuple[Array, Array]:
    """A' l + H' S^-1 r and A' L A + H' S^-1 H with A = (1 + turn E) (1 - K H), E picking the attitude's error."""
    jacobian, gain = step.jacobian, step.gain
    vector[ATTITUDE] += step.turn.T @ vector
    matrix[ATTITUDE] += step.turn.T @ matrix
    matrix[:, ATTITUDE] += matrix @ step.turn
    vector = vector + jacobian.T @ (step.inverse @ step.residual - gain.T @ vector)
    carried = matrix @ gain
    half = (carried - 0.5 * jacobian.T @ (gain.T @ carried + step.inverse)) @ jacobian
    return vector, matrix - half - half.T


def _smoothed(estimate: NavEstimate, covariance: Array, vector: Array, matrix: Array) -> SmoothedState:
    error = covariance @ vector
    smoothed = covariance - covariance @ matrix @ covariance
    along = covariance[:, 8] * (error[8] / covariance[8, 8])
    turn = turn_of_correction(estimate.layout, error, along)
    moved = estimate.copy()
    moved.add_error(error)
    smoothed += turn @ smoothed[ATTITUDE]
    smoothed += smoothed[:, ATTITUDE] @ turn.T
    return SmoothedState(moved.at_s, moved, 0.5 * (smoothed + smoothed.T))
