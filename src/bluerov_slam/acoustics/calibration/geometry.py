"""Receiver positions, sound speed, mounting and constant delays of an array from its own pulses.

Weighted least squares about what is known beforehand: everything has a prior (a tape measure, a thermometer, a spirit
level), so that data which cannot tell two things apart leave them where the prior had them instead of anywhere. How
much the data told is the singular value decomposition of the Jacobian in units of timing noise and prior: a singular
value s shrinks its combination's standard deviation by 1 / sqrt(1 + s^2); below 1 the prior knows more than the data.

Two ways: with the true place of the source for every pulse (`calibrate_geometry`), and without any
(`self_calibrate`): then each pulse brings its own unknown direction and inverse range, which are eliminated, and only
what is the same for every rotation and size of the array is learnt; the observability says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.position import solve_source
from bluerov_slam.errors import ArrayGeometryError
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.rotation import exp_so3, left_jacobian

Array = NDArray[np.float64]

MOST_ITERATIONS = 40
STEP_TOLERANCE = 1e-7
"""In units of the priors' standard deviations."""

KEPT_PROBABILITY = 0.9999
"""A pulse whose residuals are less likely than this is left out: an echo, a slip."""


@dataclass(frozen=True, slots=True)
class GeometryPriors:
    """Standard deviations before any data; 0 holds a group fixed."""

    position_m: float = 2e-3
    sound_speed_share: float = 0.01
    mounting_rad: tuple[float, float, float] = (math.radians(3.0),) * 3
    offset_s: float = 0.0
    """Constant error of a receiver's delay against the reference's: a front end that is tuned otherwise."""


@dataclass(frozen=True, slots=True)
class Learned:
    """One quantity before and after. `share` of the prior's standard deviation that is left; 1: nothing was learnt."""

    name: str
    value: float
    prior_std: float
    std: float

    @property
    def share(self) -> float:
        """What is left of the uncertainty."""
        return self.std / self.prior_std if self.prior_std else 1.0


@dataclass(frozen=True, eq=False)
class GeometryCalibration:
    """What an array really is. `mounting_rad` turns the array's nominal axes into the real ones: a rotation vector.

    `singular_values` by size, in units of prior and noise; `weak` says in words which combinations the data leave
    open. `rms_residual_s` of the pulses used, `excluded` indices of the others.
    """

    array: ReceiverArray
    sound_speed_mps: float
    mounting_rad: Array
    offsets_s: Array
    covariance: Array
    learned: tuple[Learned, ...]
    singular_values: Array
    weak: tuple[str, ...]
    pulses: int
    excluded: tuple[int, ...]
    rms_residual_s: float
    nis: float
    dof: int
    converged: bool

    def corrected_delays_s(self, delays_s: ArrayLike) -> Array:
        """Delays (..., n-1) without the receivers' constant errors."""
        corrected: Array = np.asarray(delays_s, dtype=np.float64) - self.offsets_s
        return corrected


def calibrate_geometry(
    array: ReceiverArray,
    delays_s: ArrayLike,
    sources_m: ArrayLike,
    timing_std_s: float,
    sound_speed_mps: float,
    priors: GeometryPriors | None = None,
) -> GeometryCalibration:
    """From pulses whose source's place is known.

    Args:
        array: As it is drawn.
        delays_s: (f, n-1), `toa_0 - toa_i` of all receivers, skew of the samples already taken out.
        sources_m: (f, 3) true places in the array's nominal frame (attitude and mounting as assumed).
        timing_std_s: Of each arrival.
        sound_speed_mps: As a thermometer or the CTD has it.
    """
    problem = _Problem(array, delays_s, timing_std_s, sound_speed_mps, priors or GeometryPriors())
    sources = np.asarray(sources_m, dtype=np.float64)
    if sources.shape != (len(problem.delays), 3):
        raise ArrayGeometryError(f"{len(sources)} places of the source for {len(problem.delays)} pulses")
    return problem.solve(sources, free=False)


def self_calibrate(
    array: ReceiverArray,
    delays_s: ArrayLike,
    timing_std_s: float,
    sound_speed_mps: float,
    priors: GeometryPriors | None = None,
) -> GeometryCalibration:
    """From pulses of unknown origin. The mounting is never observable this way and stays as it is."""
    given = priors or GeometryPriors()
    problem = _Problem(array, delays_s, timing_std_s, sound_speed_mps, replace(given, mounting_rad=(0.0, 0.0, 0.0)))
    starts = np.array([problem.rough_source(delays) for delays in problem.delays])
    return problem.solve(starts, free=True)


class _Problem:
    def __init__(
        self,
        array: ReceiverArray,
        delays_s: ArrayLike,
        timing_std_s: float,
        sound_speed_mps: float,
        priors: GeometryPriors,
    ) -> None:
        self.array = array
        self.count = len(array)
        self.delays = np.atleast_2d(np.asarray(delays_s, dtype=np.float64))
        if self.delays.shape[1] != self.count - 1:
            raise ArrayGeometryError(f"{self.delays.shape[1]} delays for {self.count} receivers")
        self.sound_speed = sound_speed_mps
        covariance = timing_std_s**2 * (np.eye(self.count - 1) + 1.0)
        self.covariance = covariance
        self.whitener = np.linalg.inv(np.linalg.cholesky(covariance))
        stds = np.concatenate(
            (
                np.full(3 * self.count, priors.position_m),
                [priors.sound_speed_share],
                priors.mounting_rad,
                np.full(self.count - 1, priors.offset_s),
            )
        )
        self.prior_std = stds
        self.names = [
            *(f"receiver {index} {axis} (m)" for index in range(self.count) for axis in "xyz"),
            "sound speed (share)",
            *(f"mounting {axis} (rad)" for axis in ("roll", "pitch", "yaw")),
            *(f"delay of receiver {index} (s)" for index in range(1, self.count)),
        ]
        self.open = np.flatnonzero(stds > 0.0)

    def rough_source(self, delays: Array) -> Array:
        """A direction (or place) to begin with."""
        if not np.isfinite(delays).all():
            return np.full(3, np.nan)
        loose = self.covariance + (0.01 * float(np.abs(self.delays[np.isfinite(self.delays)]).max())) ** 2 * np.eye(
            self.count - 1
        )
        found = solve_source(self.array.positions_m, delays, loose, self.sound_speed)
        if found.position_m is not None:
            return found.position_m
        return 1000.0 * self.array_radius() * found.direction

    def array_radius(self) -> float:
        return float(np.linalg.norm(self.array.positions_m, axis=1).max())

    def solve(self, sources: Array, free: bool) -> GeometryCalibration:
        """Gauss-Newton with priors; pulses that fit no more than an echo are left out and it is done again."""
        whole = np.asarray(np.isfinite(self.delays).all(axis=1) & np.isfinite(sources).all(axis=1))
        used: NDArray[np.bool_] = whole
        if not used.any():
            raise ArrayGeometryError("no pulse with delays of all receivers")
        state, places, converged = self._fit(sources, used, free)
        for _ in range(5):
            residuals = self._residuals(state, places)
            white = residuals @ self.whitener.T
            squares = np.einsum("ij,ij->i", white, white)
            robust = max(1.0, float(np.median(squares[used])) / chi_square_quantile(0.5, self.count - 1))
            keep: NDArray[np.bool_] = whole & (
                squares <= robust * chi_square_quantile(KEPT_PROBABILITY, self.count - 1)
            )
            if (keep == used).all() or keep.sum() < max(3, 0.5 * whole.sum()):
                break
            used = keep
            state, places, converged = self._fit(sources, used, free)
        return self._report(state, places, used, free, converged)

    def _fit(self, sources: Array, used: NDArray[np.bool_], free: bool) -> tuple[Array, Array, bool]:
        state = np.zeros(len(self.prior_std))
        places = sources.copy()
        scale = self.prior_std[self.open]
        for _ in range(MOST_ITERATIONS):
            residuals, by_state, by_place = self._linear(state, places)
            rows = (residuals @ self.whitener.T)[used]
            columns = np.einsum("ab,fbp->fap", self.whitener, by_state)[used][:, :, self.open] * scale
            information = np.einsum("fap,faq->pq", columns, columns) + np.eye(len(scale))
            gradient = np.einsum("fap,fa->p", columns, rows) - state[self.open] / scale
            if free:
                own = np.einsum("ab,fbq->faq", self.whitener, by_place)[used]
                inner = np.einsum("faq,far->fqr", own, own) + self._place_prior(places[used])
                cross = np.einsum("fap,faq->fpq", columns, own)
                solved = np.linalg.solve(inner, np.swapaxes(cross, 1, 2))
                pull = np.einsum("faq,fa->fq", own, rows)
                information = information - np.einsum("fpq,fqr->pr", cross, solved)
                gradient = gradient - np.einsum("fqp,fq->p", solved, pull)
            step = np.linalg.solve(information, gradient)
            state[self.open] += scale * step
            if free:
                inner_step = np.linalg.solve(inner, (pull - np.einsum("fpq,p->fq", cross, step))[:, :, None])[:, :, 0]
                places[used] = _moved(places[used], inner_step)
            if float(np.abs(step).max()) < STEP_TOLERANCE:
                return state, places, True
        return state, places, False

    def _place_prior(self, places: Array) -> Array:
        """The source lies outside the array: weak knowledge of its inverse range that keeps the elimination regular."""
        radius = self.array_radius()
        information = np.zeros((len(places), 3, 3))
        information[:, 2, 2] = (radius / 0.25) ** 2
        return information

    def _residuals(self, state: Array, places: Array) -> Array:
        return self._linear(state, places)[0]

    def _linear(self, state: Array, places: Array) -> tuple[Array, Array, Array]:
        """Residuals (f, n-1), derivatives of the prediction by the state (f, n-1, p) and by the place (f, n-1, 3)."""
        count = self.count
        receivers = self.array.positions_m + state[: 3 * count].reshape(count, 3)
        speed = self.sound_speed * (1.0 + state[3 * count])
        error = state[3 * count + 1 : 3 * count + 4]
        offsets = state[3 * count + 4 :]
        turn = exp_so3(-error)
        turned = places @ turn.T
        ways = turned[:, None, :] - receivers
        lengths = np.sqrt((ways * ways).sum(axis=2))
        unit = ways / lengths[:, :, None]
        predicted = (lengths[:, :1] - lengths[:, 1:]) / speed
        by_turned = (unit[:, :1] - unit[:, 1:]) / speed
        by_state = np.zeros((len(places), count - 1, len(state)))
        by_state[:, :, :3] = -unit[:, :1] / speed
        for index in range(1, count):
            by_state[:, index - 1, 3 * index : 3 * index + 3] = unit[:, index] / speed
            by_state[:, index - 1, 3 * count + 3 + index] = 1.0
        by_state[:, :, 3 * count] = -predicted / (1.0 + state[3 * count])
        # d(turned) = skew(turned) J d(error), so each row r of by_turned becomes (r x turned) J.
        by_state[:, :, 3 * count + 1 : 3 * count + 4] = np.cross(by_turned, turned[:, None, :]) @ left_jacobian(-error)
        residuals = self.delays - offsets - predicted
        by_place = by_turned @ turn
        ranges = np.sqrt((places * places).sum(axis=1))
        # The place's own unknowns: two angles and the inverse range.
        basis = _bases(places / ranges[:, None])
        own = np.empty_like(by_place)
        own[:, :, :2] = np.einsum("fac,fcq->faq", by_place, basis) * ranges[:, None, None]
        own[:, :, 2] = -np.einsum("fac,fc->fa", by_place, places) * ranges[:, None]
        return residuals, by_state, own

    def _report(
        self, state: Array, places: Array, used: NDArray[np.bool_], free: bool, converged: bool
    ) -> GeometryCalibration:
        residuals, by_state, by_place = self._linear(state, places)
        scale = self.prior_std[self.open]
        columns = np.einsum("ab,fbp->fap", self.whitener, by_state)[used][:, :, self.open] * scale
        if free:
            own = np.einsum("ab,fbq->faq", self.whitener, by_place)[used]
            inner = np.einsum("faq,far->fqr", own, own) + self._place_prior(places[used])
            # What is left of each pulse's rows once its own unknowns have taken what they can.
            share = np.einsum("faq,fqr,fbr->fab", own, np.linalg.inv(inner), own)
            values, vectors = np.linalg.eigh(np.eye(self.count - 1) - share)
            root = np.einsum("fab,fb,fcb->fac", vectors, np.sqrt(np.maximum(values, 0.0)), vectors)
            columns = root @ columns
        _, singular, right = np.linalg.svd(columns.reshape(-1, len(scale)), full_matrices=True)
        padded = np.zeros(len(scale))
        padded[: len(singular)] = singular
        shrink = 1.0 / (1.0 + padded**2)
        scaled = right.T @ (shrink[:, None] * right)
        covariance = np.zeros((len(state), len(state)))
        covariance[np.ix_(self.open, self.open)] = scaled * np.outer(scale, scale)
        std = np.sqrt(covariance.diagonal())
        white = (residuals @ self.whitener.T)[used]
        moved = replace_positions(self.array, state[: 3 * self.count].reshape(self.count, 3))
        unknown = 3 * int(used.sum()) if free else 0
        return GeometryCalibration(
            moved,
            self.sound_speed * (1.0 + float(state[3 * self.count])),
            state[3 * self.count + 1 : 3 * self.count + 4].copy(),
            state[3 * self.count + 4 :].copy(),
            covariance,
            tuple(
                Learned(self.names[index], float(state[index]), float(self.prior_std[index]), float(std[index]))
                for index in self.open
            ),
            padded,
            self._weak(padded, right),
            int(used.sum()),
            tuple(np.flatnonzero(~used).tolist()),
            float(np.sqrt(np.mean(residuals[used] ** 2))),
            float((white * white).sum()),
            max(0, white.size - unknown - int((padded > 1.0).sum())),
            converged,
        )

    def _weak(self, singular: Array, right: Array) -> tuple[str, ...]:
        """Combinations of which the data know less than the prior, by their largest parts."""
        told = []
        for value, row in zip(singular, right, strict=True):
            if value >= 1.0:
                continue
            order = np.argsort(-np.abs(row))
            parts = [
                f"{self.names[self.open[index]]} {row[index]:+.2f}" for index in order[:4] if abs(row[index]) > 0.3
            ]
            told.append(f"singular value {value:.2g}: " + (", ".join(parts) or "all positions together"))
        return tuple(told)


def replace_positions(array: ReceiverArray, by_m: Array) -> ReceiverArray:
    """The array with its receivers elsewhere."""
    return ReceiverArray(array.positions_m + by_m, array.sample_skew_s, array.name)


def _moved(places: Array, steps: Array) -> Array:
    """Each place by two angles and a change of its inverse range."""
    ranges = np.sqrt((places * places).sum(axis=1))
    direction = places / ranges[:, None]
    direction = direction + np.einsum("fcq,fq->fc", _bases(direction), steps[:, :2])
    direction /= np.sqrt((direction * direction).sum(axis=1))[:, None]
    inverse = np.maximum(1.0 / ranges + steps[:, 2], 1e-6)
    moved: Array = direction / inverse[:, None]
    return moved


def _bases(directions: Array) -> Array:
    """Two unit vectors (f, 3, 2) across each direction (f, 3)."""
    helper = np.eye(3)[np.abs(directions).argmin(axis=1)]
    first = np.cross(directions, helper)
    first /= np.sqrt((first * first).sum(axis=1))[:, None]
    return np.stack((first, np.cross(directions, first)), axis=2)


def in_words(calibration: GeometryCalibration, names: Sequence[str] = ()) -> str:
    """A few lines for a person: what was learnt, what not."""
    lines = [
        f"{calibration.pulses} pulses, {len(calibration.excluded)} left out; "
        f"residuals {1e6 * calibration.rms_residual_s:.3f} us RMS"
    ]
    for each in calibration.learned:
        if names and not any(each.name.startswith(name) for name in names):
            continue
        lines.append(
            f"{each.name}: {each.value:+.4g} +- {each.std:.2g} (before: +- {each.prior_std:.2g}, "
            f"{100.0 * each.share:.0f} % left)"
        )
    lines += [f"not told by these data: {text}" for text in calibration.weak]
    return "\n".join(lines)
