"""The best that any estimator could do: Cramer-Rao bounds of a track's horizontal position.

The problem is linearised about the track and reduced to two dimensions at a fixed step, by default of 1 s. Unknown are
the positions, the current (a random walk per axis with a node every 20 s, linear in between), the scale of the velocity
model along and across the vehicle, the compass deviation A + B cos(heading) + C sin(heading) and its slow wander;
measured are the position increments through the water (or over ground, with a DVL), position fixes and directions to a
beacon. Noise is exactly as modelled and there are no outliers, so a bound is a floor: an error below it over many runs
means that truth leaked into the estimate or that the model is not what was run.

How the prose of the study that the targets come from is read (its table is in docs/evaluation.md and is reproduced by
the tests): a current's standard deviation is per axis; a "total" deviation d makes A, B and C each d / sqrt(3); the
side-slip scale is a velocity across the bow in proportion to the forward speed, half as uncertain as the scale; noise
of the velocity is per axis; a DVL replaces the current and the side-slip; the beacon gives range and bearing from two
angles of equal noise and a known depth, and its bearing shares the compass error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.linear_study import LinearStudy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

CURRENT_NODE_S = 20.0


@dataclass(frozen=True, slots=True)
class Track:
    """Where the vehicle is and how it moves through the water, every `step_s`.

    `position_ne_m`: (n + 1, 2). `heading_rad`, `forward_mps` and `sideways_mps` (through the water) of each step: (n,).
    """

    step_s: float
    position_ne_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    forward_mps: NDArray[np.float64]
    sideways_mps: NDArray[np.float64]

    @property
    def steps(self) -> int:
        """Number of increments; there is one position more."""
        return len(self.heading_rad)

    @property
    def distance_m(self) -> float:
        """Length of the path."""
        return float(np.hypot(*np.diff(self.position_ne_m, axis=0).T).sum())


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What is not known of the vehicle, the water and the compass, standard deviations.

    `odometry_mps_rt_s`: white noise of the velocity, m/s per root second and axis. `slip_share`: of the speed scale's
    uncertainty, that of a side-slip in proportion to the forward speed. `sway_share`: the same of a scale of its own
    for the sideways velocity, None where one scale holds for both. `mounting_rad`: the velocity's axes against the
    compass's.
    """

    current_mps: float
    current_walk_mps_rt_s: float
    speed_scale: float
    deviation_rad: float
    wander_rad: float
    wander_time_s: float = 300.0
    odometry_mps_rt_s: float = 0.05
    slip_share: float = 0.5
    sway_share: float | None = None
    mounting_rad: float = 0.0

    def with_dvl(self, noise_mps_rt_s: float = 0.01, scale: float = 0.003) -> Uncertainty:
        """The same compass with a velocity over ground: no current, no side-slip."""
        return replace(
            self,
            current_mps=0.0,
            current_walk_mps_rt_s=0.0,
            speed_scale=scale,
            odometry_mps_rt_s=noise_mps_rt_s,
            slip_share=0.0,
            sway_share=None,
        )


HARD = Uncertainty(0.2, 0.001, 0.10, math.radians(3.0), math.radians(1.0))
CALM = Uncertainty(0.05, 0.0005, 0.05, math.radians(2.0), math.radians(0.7))


@dataclass(frozen=True, slots=True)
class Fixes:
    """Position fixes at the given steps: a white part per axis and a part that wanders with `correlation_s`."""

    at_step: Sequence[int]
    white_m: float
    wander_m: float = 0.0
    correlation_s: float = 60.0


@dataclass(frozen=True, slots=True)
class Beacon:
    """Directions to a beacon `below_m` under the vehicle, heard every `every_steps`."""

    position_ne_m: tuple[float, float]
    below_m: float
    direction_rad: float
    every_steps: int


@dataclass(frozen=True, slots=True)
class Gyro:
    """A rate gyro about the vertical: white noise and a bias that walks. The compass then has white noise, too."""

    noise_rad_rt_s: float
    bias_radps: float
    bias_walk_radps_rt_s: float
    compass_noise_rad: float


@dataclass(frozen=True, slots=True)
class Bound:
    """Covariance of the horizontal position at some epochs: `covariance_m2` (2 k, 2 k), all north before all east."""

    at_step: NDArray[np.int64]
    covariance_m2: NDArray[np.float64]

    def _variance(self) -> NDArray[np.float64]:
        north, east = np.split(np.diag(self.covariance_m2), 2)
        total: NDArray[np.float64] = north + east
        return total

    @property
    def ate_m(self) -> float:
        """Root mean square of the horizontal error over the epochs."""
        return float(math.sqrt(self._variance().mean()))

    @property
    def end_m(self) -> float:
        """Root mean square of the horizontal error at the last epoch."""
        return float(math.sqrt(self._variance()[-1]))

    @property
    def ate_dof(self) -> float:
        """Degrees of freedom of a chi-square as wide as the mean square error over the epochs (Satterthwaite, 1946)."""
        return float(np.trace(self.covariance_m2) ** 2 / np.sum(self.covariance_m2**2))

    @property
    def end_dof(self) -> float:
        """The same for the last epoch: 2 where the error ellipse is a circle, 1 where it is a line."""
        end = self.end_covariance_m2()
        return float(np.trace(end) ** 2 / np.sum(end**2))

    def end_covariance_m2(self) -> NDArray[np.float64]:
        """(2, 2) at the last epoch."""
        last = len(self.at_step) - 1
        return self.covariance_m2[np.ix_([last, 2 * last + 1], [last, 2 * last + 1])]


def lawnmower(
    legs: int = 5, leg_m: float = 180.0, spacing_m: float = 20.0, speed_mps: float = 0.5, step_s: float = 1.0
) -> Track:
    """Legs to the north and back, stepping east, turning at once."""
    leg, side = round(leg_m / speed_mps / step_s), round(spacing_m / speed_mps / step_s)
    headings: list[float] = []
    for number in range(legs):
        headings += [0.0 if number % 2 == 0 else math.pi] * leg
        headings += [math.pi / 2.0] * (side if number < legs - 1 else 0)
    heading = np.array(headings)
    steps = speed_mps * step_s * np.column_stack((np.cos(heading), np.sin(heading)))
    position = np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return Track(step_s, position, heading, np.full(len(heading), speed_mps), np.zeros(len(heading)))


def bound(
    track: Track,
    uncertainty: Uncertainty,
    fixes: Fixes,
    beacon: Beacon | None = None,
    gyro: Gyro | None = None,
    epochs: NDArray[np.int64] | None = None,
) -> Bound:
    """What the measurements allow at the given epochs (every tenth step and the last), all of them known: smoothed.

    The last epoch has nothing after it, so there it is also the bound of a causal estimate; for others `causal_bound`.
    """
    study = LinearStudy()
    position = [study.unknown(track.steps + 1) for _ in range(2)]
    heading_error = _heading_error(study, track, uncertainty, gyro)
    _odometry(study, track, uncertainty, position, heading_error)
    _fixes(study, track, fixes, position)
    if beacon is not None:
        _beacon(study, track, beacon, position, heading_error)
    if epochs is None:
        epochs = np.unique(np.append(np.arange(0, track.steps + 1, 10), track.steps))
    return Bound(epochs, study.covariance(np.concatenate([axis[epochs] for axis in position])))


def causal_bound(
    track: Track, uncertainty: Uncertainty, fixes: Fixes, epochs: Sequence[int], gyro: Gyro | None = None
) -> NDArray[np.float64]:
    """Horizontal RMS bound (k,) at each epoch from what was measured until then."""

    def at(epoch: int) -> float:
        only = np.array([epoch])
        return bound(_until(track, epoch), uncertainty, _before(fixes, epoch), gyro=gyro, epochs=only).end_m

    return np.array([at(epoch) for epoch in epochs])


def _heading_error(
    study: LinearStudy, track: Track, uncertainty: Uncertainty, gyro: Gyro | None
) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """The heading's error in each step as terms of a row.

    Without a gyro the compass is all there is: the error is the deviation. With one the headings are unknowns of their
    own, tied to each other by the gyro and to the compass by its noise.
    """
    part = uncertainty.deviation_rad / math.sqrt(3.0)
    one = np.ones(track.steps)
    wander = study.unknown(track.steps)
    study.gauss_markov(wander, uncertainty.wander_rad, math.exp(-track.step_s / uncertainty.wander_time_s))
    deviation = [
        (study.unknown(1, part), one),
        (study.unknown(1, part), np.cos(track.heading_rad)),
        (study.unknown(1, part), np.sin(track.heading_rad)),
        (wander, one),
    ]
    if gyro is None:
        return deviation
    heading = study.unknown(track.steps)
    bias = study.unknown(track.steps)
    study.measure(gyro.bias_radps, (bias[:1], 1.0))
    study.random_walk(bias, gyro.bias_walk_radps_rt_s * math.sqrt(track.step_s))
    study.measure(
        gyro.noise_rad_rt_s * math.sqrt(track.step_s),
        (heading[1:], 1.0),
        (heading[:-1], -1.0),
        (bias[1:], -track.step_s),
    )
    study.measure(gyro.compass_noise_rad, (heading, -1.0), *deviation)
    return [(heading, one)]


def _odometry(
    study: LinearStudy,
    track: Track,
    uncertainty: Uncertainty,
    position: list[NDArray[np.int64]],
    heading_error: list[tuple[NDArray[np.int64], NDArray[np.float64]]],
) -> None:
    """Each increment is the water-relative velocity turned by the heading plus the current, each with its error."""
    dt = track.step_s
    cos, sin = np.cos(track.heading_rad), np.sin(track.heading_rad)
    forward, sideways = track.forward_mps, track.sideways_mps
    velocity = (forward * cos - sideways * sin, forward * sin + sideways * cos)
    turned = (-velocity[1], velocity[0])  # what the velocity changes by when the heading turns by one radian
    along, across = (forward * cos, forward * sin), (-sideways * sin, sideways * cos)
    shared: list[tuple[NDArray[np.int64], tuple[NDArray[np.float64], NDArray[np.float64]]]] = []
    scale = study.unknown(1, uncertainty.speed_scale)
    if uncertainty.sway_share is None:
        shared.append((scale, velocity))
    else:
        shared += [(scale, along), (study.unknown(1, uncertainty.speed_scale * uncertainty.sway_share), across)]
    if uncertainty.slip_share:
        slip = study.unknown(1, uncertainty.speed_scale * uncertainty.slip_share)
        shared.append((slip, (-forward * sin, forward * cos)))
    if uncertainty.mounting_rad:
        shared.append((study.unknown(1, uncertainty.mounting_rad), turned))
    for axis in range(2):
        terms = [(position[axis][1:], np.ones(track.steps)), (position[axis][:-1], -np.ones(track.steps))]
        terms += [(columns, -dt * values[axis]) for columns, values in shared]
        terms += [(columns, -dt * turned[axis] * values) for columns, values in heading_error]
        if uncertainty.current_mps:
            terms += _current(study, track, uncertainty)
        study.measure(uncertainty.odometry_mps_rt_s * math.sqrt(dt), *terms)


def _current(
    study: LinearStudy, track: Track, uncertainty: Uncertainty
) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """One axis of the current: nodes, and the share of the two nearest in each step."""
    place = np.asarray((np.arange(track.steps) + 0.5) * track.step_s / CURRENT_NODE_S, dtype=np.float64)
    before = place.astype(np.int64)
    share = place - before.astype(np.float64)
    nodes: NDArray[np.int64] = study.unknown(int(before[-1]) + 2)
    study.measure(uncertainty.current_mps, (nodes[:1], 1.0))
    study.random_walk(nodes, uncertainty.current_walk_mps_rt_s * math.sqrt(CURRENT_NODE_S))
    return [
        (nodes[before], np.asarray(-track.step_s * (1.0 - share))),
        (nodes[before + 1], np.asarray(-track.step_s * share)),
    ]


def _fixes(study: LinearStudy, track: Track, fixes: Fixes, position: list[NDArray[np.int64]]) -> None:
    at = np.asarray(fixes.at_step, dtype=np.int64)
    for axis in position:
        if not fixes.wander_m:
            study.measure(fixes.white_m, (axis[at], 1.0))
            continue
        wander = study.unknown(len(at))
        study.gauss_markov(wander, fixes.wander_m, np.exp(-np.diff(at) * track.step_s / fixes.correlation_s))
        study.measure(fixes.white_m, (axis[at], 1.0), (wander, 1.0))


def _beacon(
    study: LinearStudy,
    track: Track,
    beacon: Beacon,
    position: list[NDArray[np.int64]],
    heading_error: list[tuple[NDArray[np.int64], NDArray[np.float64]]],
) -> None:
    """Two angles of equal noise: along the horizontal range they are weaker the flatter the ray."""
    heard = np.arange(0, track.steps, beacon.every_steps)
    offset = track.position_ne_m[heard] - np.asarray(beacon.position_ne_m)
    range_m = np.hypot(*offset.T)
    along = np.where(range_m[:, None] > 1e-9, offset / np.maximum(range_m, 1e-9)[:, None], (1.0, 0.0))
    slant = np.hypot(range_m, beacon.below_m)
    north, east = position[0][heard], position[1][heard]
    study.measure(beacon.direction_rad * slant**2 / beacon.below_m, (north, along[:, 0]), (east, along[:, 1]))
    compass = [
        (columns if len(columns) == 1 else columns[heard], -range_m * values[heard])
        for columns, values in heading_error
    ]
    study.measure(beacon.direction_rad * slant, (north, -along[:, 1]), (east, along[:, 0]), *compass)


def _until(track: Track, step: int) -> Track:
    return Track(
        track.step_s,
        track.position_ne_m[: step + 1],
        track.heading_rad[:step],
        track.forward_mps[:step],
        track.sideways_mps[:step],
    )


def _before(fixes: Fixes, step: int) -> Fixes:
    return replace(fixes, at_step=[at for at in fixes.at_step if at <= step])
