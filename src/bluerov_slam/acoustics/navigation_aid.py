"""Time differences of a known transmitter as a tightly coupled measurement of the navigation filter.

With b the transmitter minus the vehicle in NED, l the array's lever arm, R_m its mounting and e the directions' lasting
error (blocks `isbl_mounting` plus `isbl_wander`, rotation vectors in the body's axes), the source in the array's frame
and its delays are

    q = R_m' Exp(-e) (R' b - l),   delay_i = (|q - m_0| - |q - m_i|) / ((1 + sound_speed_scale) c)

Three kinds of error are kept apart. Timing noise is the reading's own covariance. What every receiver shares although
timing is perfect (scattering, refraction, an array that bends) turns the direction of one pulse: `direction_std_rad`.
And a pulse may not have come straight at all: an echo from anywhere has the density of the whole sphere. The odds of
these, given what the filter expected, inflate the noise of a doubtful pulse; delays one carrier period off are tried in
the same way, and where none stands out the pulse is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ArrayMounting
from bluerov_slam.navigation.ekf import Innovation
from bluerov_slam.navigation.rotation import exp_so3, left_jacobian, skew
from bluerov_slam.navigation.state import ATTITUDE, POSITION, NavEstimate, StateLayout

Array = NDArray[np.float64]

MOUNTING = "isbl_mounting"
"""Extra block (3, rad): how the array's axes are turned against its nominal mounting."""

WANDER = "isbl_wander"
"""Extra block (3, rad): what turns all directions for minutes, as rays that bend and echoes that overlap do."""

BEACON = "isbl_beacon"
"""Extra block (3, m NED): by how much the transmitter is elsewhere than stated."""

NEAREST_SHARE = 2.0
"""A source nearer to the array's centre than twice the array's radius is a wrong geometry, not a measurement."""


@dataclass(frozen=True, slots=True)
class AidOptions:
    """What is not known of a pulse besides its timing."""

    direction_std_rad: float = math.radians(3.0)
    """3.2 deg against differential GPS in water with five hydrophones (piUSBL)."""
    outlier_share: float = 0.05
    """Pulses that came by way of an echo alone."""
    surest_slip: float = 0.9
    """A carrier cell has to be this probable among the possible ones."""


class Pose(NamedTuple):
    """Where a vehicle was, and how it lay."""

    position_ned_m: Array
    rotation_ned_frd: Array


@dataclass(slots=True)
class Verdict:
    """What became of one pulse in the filter; written each time the measurement is evaluated."""

    direct_probability: float = math.nan
    """That the pulse came straight, as far as it was weighed against the prediction."""
    hypothesis: int = 0
    """0: the delays as measured; above: an alternative one or more carrier periods off; -1: left out as ambiguous."""
    hypothesis_probability: float = 1.0


@dataclass(frozen=True, slots=True)
class AcousticDelays:
    """One pulse: `toa_reference - toa_i` of the receivers after the first, which is the reference.

    `covariance_of` gives the filter's covariance at the moment of evaluation (the filter's own attribute); without it
    no hypotheses are weighed. `about` is a better pose of that instant, from a smoother that has run before:
    predictions and derivatives are taken there, and what the estimate differs by counts to first order.
    `beacon_covariance_m2` (3, 3) counts where the layout has no block for the transmitter's place. `bend_rad`: by how
    much refraction turns the arriving ray downward from the straight line, and how unsure that is: layers leave the
    azimuth alone.
    """

    at_s: float
    receivers_m: Array  # (k, 3), array frame, reference first
    delays_s: Array  # (k-1,)
    covariance_s2: Array  # (k-1, k-1)
    sound_speed_mps: float
    beacon_ned_m: Array
    mounting: ArrayMounting
    beacon_covariance_m2: Array | None = None
    alternatives: Sequence[tuple[Array, float]] = ()
    options: AidOptions = AidOptions()
    covariance_of: Callable[[], Array] | None = None
    about: Pose | None = None
    bend_rad: float = 0.0
    bend_std_rad: float = 0.0
    verdict: Verdict = field(default_factory=Verdict)
    sensor: str = "acoustics"

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """Measured minus predicted delays; None for an ambiguous pulse and inside the transmitter's near field."""
        seen = self._seen(estimate, layout)
        if seen is None:
            return None
        # A unit vector turned by noise ends short of its tangent plane by half the angle's square: on average the
        # variance of one axis, and as uncertain. Good timing would take that for a direction of its own.
        short = self.options.direction_std_rad**2
        seen = seen._replace(predicted_s=(1.0 - short) * seen.predicted_s, jacobian=(1.0 - short) * seen.jacobian)
        noise = self.covariance_s2 + short * (seen.by_direction @ seen.by_direction.T)
        noise = noise + short * short * np.outer(seen.predicted_s, seen.predicted_s)
        noise = noise + self.bend_std_rad**2 * np.outer(seen.by_bend, seen.by_bend)
        if self.beacon_covariance_m2 is not None and BEACON not in layout:
            by_beacon = -seen.jacobian[:, POSITION]
            noise = noise + by_beacon @ self.beacon_covariance_m2 @ by_beacon.T
        residual = self.delays_s - seen.predicted_s
        if self.covariance_of is None:
            return Innovation(residual, seen.jacobian, noise)
        spread = seen.jacobian @ self.covariance_of() @ seen.jacobian.T + noise
        return self._weighed(seen, residual, noise, spread)

    def _seen(self, estimate: NavEstimate, layout: StateLayout) -> _Seen | None:
        """Predicted delays and their derivatives by the states and by the direction."""
        if self.about is None:
            return self._seen_from(estimate, layout)
        better = estimate.copy()
        better.values[POSITION] = self.about.position_ned_m
        better.rotation_ned_frd = np.array(self.about.rotation_ned_frd, dtype=np.float64)
        seen = self._seen_from(better, layout)
        if seen is None:
            return None
        error = estimate.difference(better)
        error[ATTITUDE.stop :] = 0.0
        return seen._replace(predicted_s=seen.predicted_s + seen.jacobian @ error)

    def _seen_from(self, estimate: NavEstimate, layout: StateLayout) -> _Seen | None:
        toward_ned = np.asarray(self.beacon_ned_m, dtype=np.float64) - estimate.position_ned_m
        if BEACON in layout:
            toward_ned = toward_ned + estimate.block(BEACON)
        toward_ned, by_straight = _bent(toward_ned, self.bend_rad)
        rotation_frd_ned = estimate.rotation_ned_frd.T
        toward_frd = rotation_frd_ned @ toward_ned - self.mounting.lever_arm_frd_m
        turn = np.eye(3)
        error = np.zeros(3)
        turns = [name for name in (MOUNTING, WANDER) if name in layout]
        for name in turns:
            error = error + estimate.block(name)
        if turns:
            turn = exp_so3(-error)
        turned = turn @ toward_frd
        to_array = self.mounting.rotation_frd_array.T
        source = to_array @ turned
        ways = source - self.receivers_m
        lengths = np.sqrt(np.einsum("ij,ij->i", ways, ways))
        radius = math.sqrt(float((self.receivers_m * self.receivers_m).sum(axis=1).max()))
        if float(source @ source) < (NEAREST_SHARE * radius) ** 2:
            return None
        scale = 1.0
        if "sound_speed_scale" in layout:
            scale += float(estimate.block("sound_speed_scale")[0])
        per_speed = 1.0 / (scale * self.sound_speed_mps)
        toward = ways / lengths[:, None]
        by_source = (toward[0] - toward[1:]) * per_speed
        predicted = (lengths[0] - lengths[1:]) * per_speed

        jacobian = np.zeros((len(predicted), layout.size))
        by_turned = by_source @ to_array
        by_frd = by_turned @ turn
        by_place = by_frd @ rotation_frd_ned @ by_straight
        jacobian[:, POSITION] = -by_place
        jacobian[:, ATTITUDE] = by_frd @ rotation_frd_ned @ skew(toward_ned)
        for name in turns:
            jacobian[:, layout[name]] = by_turned @ skew(turned) @ left_jacobian(-error)
        if BEACON in layout:
            jacobian[:, layout[BEACON]] = by_place
        if "sound_speed_scale" in layout:
            jacobian[:, layout["sound_speed_scale"].start] = -predicted / scale
        by_bend = by_frd @ rotation_frd_ned @ _downward(toward_ned)
        across = _across(source / math.sqrt(float(source @ source)))
        return _Seen(predicted, jacobian, math.sqrt(float(source @ source)) * by_source @ across, by_bend)

    def _weighed(self, seen: _Seen, residual: Array, noise: Array, spread: Array) -> Innovation | None:
        """The most probable carrier cell, with the noise of a pulse that may not have come straight."""
        options, verdict = self.options, self.verdict
        left = 1.0 - sum(probability for _, probability in self.alternatives)
        cells = [(residual, max(left, 1e-6))]
        cells += [(np.asarray(delays) - seen.predicted_s, probability) for delays, probability in self.alternatives]
        try:
            straight = np.array([_log_normal(cell, spread) + math.log(max(odds, 1e-300)) for cell, odds in cells])
            echo = np.array([_log_echo(cell, self.covariance_s2, seen.by_direction) for cell, _ in cells])
        except np.linalg.LinAlgError:
            return Innovation(residual, seen.jacobian, noise)
        best = int(straight.argmax())
        share = float(np.exp(straight[best] - np.logaddexp.reduce(straight)))
        verdict.hypothesis, verdict.hypothesis_probability = best, share
        if share < options.surest_slip:
            verdict.hypothesis = -1
            return None
        against = math.log(options.outlier_share / (1.0 - options.outlier_share)) + echo[best]
        direct = 1.0 / (1.0 + math.exp(min(against - float(np.logaddexp.reduce(straight)), 700.0)))
        verdict.direct_probability = direct
        # A pulse less likely straight than not goes to the filter's gate as it is, to be refused and counted.
        inflated = noise / direct if direct > 0.5 else noise
        return Innovation(cells[best][0], seen.jacobian, inflated)


class _Seen(NamedTuple):
    predicted_s: Array
    jacobian: Array  # (k-1, n)
    by_direction: Array  # (k-1, 2), seconds per radian
    by_bend: Array  # (k-1,), the same for a turn downward in the vertical plane


def _log_normal(residual: Array, covariance: Array) -> float:
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, residual)
    return -0.5 * (float(white @ white) + len(residual) * math.log(math.tau)) - float(np.log(factor.diagonal()).sum())


def _log_echo(residual: Array, timing_s2: Array, by_direction: Array) -> float:
    """Log density of delays whose direction is any: 1 / (4 pi) over the sphere, timing noise across it.

    The integral over the direction d of N(r - J d; T) / (4 pi), with the sphere taken as flat around the prediction.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(timing_s2))
    white, columns = inverse @ residual, inverse @ by_direction
    information = columns.T @ columns
    turned = columns.T @ white
    left = float(white @ white) - float(turned @ np.linalg.solve(information, turned))
    return (
        -0.5 * (left + (len(residual) - 2) * math.log(math.tau))
        + float(np.log(inverse.diagonal()).sum())
        - 0.5 * math.log(float(np.linalg.det(information)))
        - math.log(4.0 * math.pi)
    )


def _bent(toward_ned: Array, bend_rad: float) -> tuple[Array, Array]:
    """The vector turned downward in its vertical plane, and its derivative by the straight one."""
    level = math.hypot(float(toward_ned[0]), float(toward_ned[1]))
    if bend_rad == 0.0 or level < 1e-9:
        return toward_ned, np.eye(3)
    along = np.array((toward_ned[0] / level, toward_ned[1] / level, 0.0))
    beside = np.array((-along[1], along[0], 0.0))
    vertical = np.array((0.0, 0.0, 1.0))
    cosine, sine = math.cos(bend_rad), math.sin(bend_rad)
    turned_along, turned_down = cosine * along + sine * vertical, cosine * vertical - sine * along
    down = float(toward_ned[2])
    shrink = cosine - sine * down / level
    derivative = np.outer(turned_along, along) + np.outer(turned_down, vertical) + shrink * np.outer(beside, beside)
    return level * turned_along + down * turned_down, derivative


def _downward(toward_ned: Array) -> Array:
    """How the vector moves when it is turned downward in its vertical plane, per radian."""
    level = math.hypot(float(toward_ned[0]), float(toward_ned[1]))
    if level < 1e-9:
        return np.zeros(3)
    down = float(toward_ned[2])
    return np.array((-down * toward_ned[0] / level, -down * toward_ned[1] / level, level))


def _across(direction: Array) -> Array:
    """Two unit vectors (3, 2) perpendicular to a unit vector."""
    helper = np.eye(3)[int(np.abs(direction).argmin())]
    first = helper - direction * float(direction @ helper)
    first /= math.sqrt(float(first @ first))
    x, y, z = direction.tolist()
    a, b, c = first.tolist()
    return np.column_stack((first, (y * c - z * b, z * a - x * c, x * b - y * a)))
