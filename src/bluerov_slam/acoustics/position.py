"""Where the source is: weighted least squares (Levenberg-Marquardt) on time differences, with its covariance.

Unknowns are the direction u (two numbers) and the inverse range w = 1/|p|: with them a source far away is as well
conditioned as a near one, and "no range" is w = 0 with its own standard deviation instead of a divergence. With
s_i = |u - w m_i| the path differences, free of cancellation at any range, and their derivatives are

    D_i = |p - m_0| - |p - m_i| = (2 u.(m_i - m_0) + w (|m_0|^2 - |m_i|^2)) / (s_0 + s_i)
    dD_i/du = m_i/s_i - m_0/s_0 (across u),  dD_i/dw = (|m_0|^2 - |m_i|^2 - D_i (s_0' + s_i')) / (s_0 + s_i)

A depth is the distance along `down`, which is the world's: give receivers turned by the attitude into NED (or `down`
turned into the array's frame). On the thesis's bench the known axis is x: `down=(1, 0, 0)`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.acoustics.array import FLAT_SHARE
from bluerov_slam.navigation.chi_square import chi_square_quantile

Array = NDArray[np.float64]

GATE_PROBABILITY = 0.999
"""Delays that contradict one another more than one right fix in a thousand does are no fix."""

MIRROR_CHI2 = 9.0
"""Of a solution and its mirror the one that fits worse by this much (3 sigma) is excluded."""

LARGEST_RANGE_SHARE = 0.5
"""A range whose standard deviation is above this share of itself is not one: only the direction is given."""

INVERSE_RANGE_PRIOR = 0.25
"""Without depth and range: standard deviation of 1/range in units of 1/aperture. Sources lie outside the array."""

STEP_TOLERANCE = 1e-8
"""The search ends when a step turns the direction (rad) and changes the scaled inverse range by less."""

MOST_ITERATIONS = 60
IN_PLANE = "the transmitter lies in the plane of a flat array, where its direction cannot be told"
CLEARLY_STD, CLEARLY_OFF = 10.0, 0.2
"""A depth that is zero only by so many standard deviations, and a direction so far (sine) on the other side of it."""


@dataclass(frozen=True, slots=True)
class AcousticSolution:
    """A source relative to the array's origin, in the frame in which the receivers were given.

    `position_m` is None where only the direction is known; `reason` says in words why something is missing or not to be
    trusted (empty if all is good). `mirror` is the direction that fits as well, None if there is no such or it has been
    excluded. `residuals_s` are measured minus predicted delays; `nis` their (and the depth's, range's) squared
    normalised sum, `dof` on average. Unusable delays leave the direction NaN.
    """

    position_m: Array | None
    direction: Array
    direction_covariance: Array
    covariance_m2: Array | None
    residuals_s: Array
    nis: float
    dof: int
    iterations: int
    converged: bool
    reason: str
    mirror: Array | None = None

    @property
    def good(self) -> bool:
        """Whether nothing speaks against it: the direction can be used."""
        return self.converged and not self.reason


def solve_source(
    receivers_m: ArrayLike,
    delays_s: ArrayLike,
    covariance_s2: ArrayLike,
    sound_speed_mps: float,
    *,
    depth: tuple[float, float] | None = None,
    range_: tuple[float, float] | None = None,
    start: ArrayLike | None = None,
    down: ArrayLike = (0.0, 0.0, 1.0),
    front: ArrayLike = (1.0, 0.0, 0.0),
) -> AcousticSolution:
    """The source of delays `toa_reference - toa_i`, the reference being the first receiver.

    Args:
        receivers_m: (k, 3), k >= 3, reference first.
        delays_s: (k-1,) of the others.
        covariance_s2: (k-1, k-1); neighbouring delays share the reference's error.
        depth: Source's distance along `down` from the origin, and its standard deviation, of both depths together, m.
        range_: One-way range and its standard deviation, m, from a synchronised clock.
        start: Roughly where the source is; also says on which side of a flat array it lies.
        down: Unit vector of the depth's axis in the frame of the receivers.
        front: The side that a flat array listens to, where nothing else tells a source from its mirror image.
    """
    problem = _Problem.make(receivers_m, delays_s, covariance_s2, sound_speed_mps, depth, range_, down)
    fault = problem.fault()
    if fault:
        return problem.nothing(fault)
    sought = None if start is None else np.asarray(start, dtype=np.float64)
    found = _best(problem, sought, np.asarray(front, dtype=np.float64))
    if found is None:
        flat = problem.rank == 2 and np.linalg.norm(problem.inside()) > 0.95
        return problem.nothing(IN_PLANE if flat else "the search for a direction did not converge")
    state, mirror = found
    return _judge(problem, state, mirror, sought, np.asarray(front, dtype=np.float64))


@dataclass(slots=True)
class _State:
    direction: Array
    inverse_range: float
    cost: float  # chi-square of delays, depth and range, and of the prior
    information: Array  # (3, 3) about two angles and w
    basis: Array  # (3, 2) across the direction
    iterations: int
    converged: bool


@dataclass(slots=True)
class _Problem:
    receivers: Array  # (k, 3)
    squares: Array  # (k,) of their distance from the origin
    measured: Array  # (k-1,) path differences, m
    whitener: Array  # (k-1, k-1): whitener' whitener = inverse covariance of the path differences
    std_m: Array
    depth: tuple[float, float] | None
    range_: tuple[float, float] | None
    down: Array
    sound_speed: float
    aperture: float
    normal: Array
    rank: int

    @classmethod
    def make(
        cls,
        receivers_m: ArrayLike,
        delays_s: ArrayLike,
        covariance_s2: ArrayLike,
        sound_speed: float,
        depth: tuple[float, float] | None,
        range_: tuple[float, float] | None,
        down: ArrayLike,
    ) -> _Problem:
        receivers = np.asarray(receivers_m, dtype=np.float64)
        delays = np.asarray(delays_s, dtype=np.float64)
        covariance = np.asarray(covariance_s2, dtype=np.float64)
        count = len(receivers)
        if receivers.shape != (count, 3) or delays.shape != (count - 1,) or covariance.shape != (count - 1, count - 1):
            raise ValueError(
                f"{receivers.shape} receivers, {delays.shape} delays and {covariance.shape} covariance do not match"
            )
        if not sound_speed > 0.0:
            raise ValueError(f"sound speed {sound_speed} m/s, expected above 0")
        axis = np.asarray(down, dtype=np.float64)
        _, spread, axes = np.linalg.svd(receivers - receivers.mean(axis=0))
        whitener = np.linalg.inv(np.linalg.cholesky(covariance * sound_speed**2))
        return cls(
            receivers,
            np.einsum("ij,ij->i", receivers, receivers),
            delays * sound_speed,
            whitener,
            sound_speed * np.sqrt(covariance.diagonal()),
            depth,
            range_,
            axis / math.sqrt(float(axis @ axis)),
            sound_speed,
            float(np.sqrt(((receivers - receivers.mean(axis=0)) ** 2).sum(axis=1).max())),
            axes[2],
            int((spread > FLAT_SHARE * spread[0]).sum()),
        )

    def fault(self) -> str:
        """What makes these delays unusable before any search, in words."""
        if not np.isfinite(self.measured).all():
            return "a delay is not a number"
        if len(self.receivers) < 3:
            return f"{len(self.receivers)} receivers, 3 are needed for a direction"
        if self.rank < 2:
            return "the receivers lie on a line: they tell a cone of directions, not one"
        apart = np.sqrt(((self.receivers[1:] - self.receivers[0]) ** 2).sum(axis=1))
        excess = (np.abs(self.measured) - apart) / self.std_m
        worst = int(excess.argmax())
        if excess[worst] > 4.0:
            return (
                f"delay {worst + 1} is {1e6 * abs(self.measured[worst]) / self.sound_speed:.1f} us, "
                f"the array allows {1e6 * apart[worst] / self.sound_speed:.1f} us"
            )
        return ""

    def nothing(self, reason: str) -> AcousticSolution:
        """No fix, and why."""
        unknown = np.full(3, np.nan)
        return AcousticSolution(
            None,
            unknown,
            np.full((3, 3), np.nan),
            None,
            np.full(len(self.measured), np.nan),
            math.nan,
            0,
            0,
            False,
            reason,
        )

    def without_range(self) -> _Problem:
        """The same delays alone."""
        return _Problem(
            self.receivers,
            self.squares,
            self.measured,
            self.whitener,
            self.std_m,
            None,
            None,
            self.down,
            self.sound_speed,
            self.aperture,
            self.normal,
            self.rank,
        )

    def inside(self) -> Array:
        """Of a distant source's direction what lies in the array's plane; above one where delays are too long."""
        baselines = self.receivers[1:] - self.receivers[0]
        flat = self.whitener @ (baselines - np.outer(baselines @ self.normal, self.normal))
        found = np.linalg.lstsq(flat, self.whitener @ self.measured, rcond=1e-9)[0]
        return np.asarray(found - self.normal * float(found @ self.normal))

    @property
    def ranged(self) -> bool:
        return self.depth is not None or self.range_ is not None

    @property
    def measurements(self) -> int:
        return len(self.measured) + (self.depth is not None) + (self.range_ is not None)

    def predict(self, direction: Array, w: float) -> tuple[Array, Array, Array]:
        """Path differences (k-1,), their gradient across the direction (k-1, 3) and by w (k-1,)."""
        difference, s, along = self._differences(direction, w)
        scaled = self.receivers / s[:, None]
        slope = (w * self.squares - along) / s
        by_w = (self.squares[0] - self.squares[1:] - difference * (slope[0] + slope[1:])) / (s[0] + s[1:])
        return difference, scaled[1:] - scaled[0], by_w

    def linearise(self, direction: Array, w: float, basis: Array) -> tuple[Array, Array]:
        """Normalised residuals (measured minus predicted) and their Jacobian of the prediction (m, 3)."""
        difference, across, by_w = self.predict(direction, w)
        count = len(self.measured)
        jacobian = np.empty((count + self.extra, 3))
        block = np.empty((count, 3))
        block[:, :2] = across @ basis
        block[:, 2] = by_w
        jacobian[:count] = self.whitener @ block
        residuals = self._residuals(difference, direction, w)
        row = count
        if self.depth is not None:
            std = self.depth[1]
            jacobian[row, :2] = self.down @ basis / (w * std)
            jacobian[row, 2] = -float(direction @ self.down) / (w * w * std)
            row += 1
        if self.range_ is not None:
            jacobian[row] = (0.0, 0.0, -1.0 / (w * w * self.range_[1]))
        if not self.ranged:
            jacobian[row] = (0.0, 0.0, self.aperture / INVERSE_RANGE_PRIOR)
        return residuals, jacobian

    def cost(self, direction: Array, w: float) -> float:
        """The sum of squared normalised residuals; infinite inside the array and behind infinity of a ranged source."""
        if (self.ranged and w < 1e-7) or abs(w) * self.aperture > 20.0:
            return math.inf
        residuals = self._residuals(self._differences(direction, w)[0], direction, w)
        return float(residuals @ residuals)

    @property
    def extra(self) -> int:
        """Rows besides the delays: depth, range, or the prior in their place."""
        return (self.depth is not None) + (self.range_ is not None) if self.ranged else 1

    def _differences(self, direction: Array, w: float) -> tuple[Array, Array, Array]:
        """Path differences (k-1,), s (k,) and receivers along the direction (k,)."""
        along = self.receivers @ direction
        s = np.sqrt(1.0 - 2.0 * w * along + w * w * self.squares)
        numerator = 2.0 * (along[1:] - along[0]) + w * (self.squares[0] - self.squares[1:])
        return numerator / (s[0] + s[1:]), s, along

    def _residuals(self, difference: Array, direction: Array, w: float) -> Array:
        count = len(self.measured)
        residuals = np.empty(count + self.extra)
        residuals[:count] = self.whitener @ (self.measured - difference)
        row = count
        if self.depth is not None:
            residuals[row] = (self.depth[0] - float(direction @ self.down) / w) / self.depth[1]
            row += 1
        if self.range_ is not None:
            residuals[row] = (self.range_[0] - 1.0 / w) / self.range_[1]
        if not self.ranged:
            residuals[row] = -w * self.aperture / INVERSE_RANGE_PRIOR
        return residuals


def _starts(problem: _Problem, sought: Array | None) -> list[tuple[Array, float]]:
    """A direction of a distant source on each side of the array, and an inverse range for each."""
    inside = problem.inside()
    length = float(inside @ inside)
    if length > 0.98:
        inside *= math.sqrt(0.98 / length)
        length = 0.98
    starts = []
    for sign in (1.0, -1.0):
        direction = inside + sign * math.sqrt(1.0 - length) * problem.normal
        if sought is not None and float(direction @ sought) * math.sqrt(float(sought @ sought)) > 0.9 * float(
            sought @ sought
        ):
            starts.append((sought / math.sqrt(float(sought @ sought)), 1.0 / math.sqrt(float(sought @ sought))))
            continue
        starts.append((direction, _inverse_range(problem, direction)))
    return starts


def _inverse_range(problem: _Problem, direction: Array) -> float:
    nearest = 0.5 / problem.aperture
    if problem.range_ is not None:
        return min(1.0 / max(problem.range_[0], 1e-3), nearest)
    if problem.depth is None:
        return 0.0
    along = float(direction @ problem.down)
    if along * problem.depth[0] > 0.0:
        return min(max(along / problem.depth[0], 1e-5), nearest)
    return 0.1 * nearest


def _search(problem: _Problem, direction: Array, w: float) -> _State:
    """Levenberg-Marquardt: damping grows while a step makes things worse, and vanishes where steps are good."""
    damping = 1e-6
    scale = 1.0 / problem.aperture
    cost = problem.cost(direction, w)
    converged = False
    iteration = 0
    while iteration < MOST_ITERATIONS and not converged:
        iteration += 1
        basis = _across(direction)
        residuals, jacobian = problem.linearise(direction, w, basis)
        information = jacobian.T @ jacobian
        gradient = jacobian.T @ residuals
        while True:
            damped = information + np.diag(damping * information.diagonal())
            step = _solve3(damped, gradient)
            if step is None:
                damping = max(damping, 1e-9) * 10.0
                if damping > 1e12:
                    break
                continue
            turned = direction + basis @ step[:2]
            turned /= math.sqrt(float(turned @ turned))
            moved = w + float(step[2])
            after = problem.cost(turned, moved)
            small = abs(step[0]) + abs(step[1]) + abs(step[2]) / (scale if not problem.ranged else abs(w))
            if after <= cost or (small < STEP_TOLERANCE and after <= cost * (1.0 + 1e-9) + 1e-12):
                direction, w, cost = turned, moved, after
                damping *= 0.1
                converged = small < STEP_TOLERANCE
                break
            if small < STEP_TOLERANCE:
                converged = True
                break
            damping = max(damping, 1e-9) * 10.0
            if damping > 1e12:
                break
        if damping > 1e12:
            break
    basis = _across(direction)
    _, jacobian = problem.linearise(direction, w, basis)
    return _State(direction, w, cost, jacobian.T @ jacobian, basis, iteration, converged)


def _best(problem: _Problem, sought: Array | None, front: Array) -> tuple[_State, Array | None] | None:
    """The better of the solutions on both sides of the array; with both as good, the sought or the front one."""
    starts = _starts(problem, sought)
    # On the wrong side of the depth's origin by far there is nothing to search for.
    promising = [start for start in starts if not _hopeless(problem, start[0])]
    states = [_search(problem, *start) for start in promising or starts]
    states = [state for state in states if math.isfinite(state.cost) and state.converged]
    if not states:
        return None
    states.sort(key=lambda state: state.cost)
    best = states[0]
    if len(states) == 1 or states[1].cost - best.cost > MIRROR_CHI2:
        return best, None
    other = states[1]
    if float(best.direction @ other.direction) > 1.0 - 1e-9:
        return best, None
    wanted = front if sought is None else sought
    if float(other.direction @ wanted) > float(best.direction @ wanted):
        best, other = other, best
    return best, other.direction


def _hopeless(problem: _Problem, direction: Array) -> bool:
    """Whether a depth lies clearly on the other side of the array than a direction."""
    if problem.depth is None:
        return False
    value, std = problem.depth
    return abs(value) > CLEARLY_STD * std and float(direction @ problem.down) * math.copysign(1.0, value) < -CLEARLY_OFF


def _judge(
    problem: _Problem, state: _State, mirror: Array | None, sought: Array | None, front: Array
) -> AcousticSolution:
    """Covariances, and whether range and fit can be believed."""
    direction, w = state.direction, state.inverse_range
    difference, _, _ = problem.predict(direction, w)
    residuals = problem.measured - difference
    covariance = _inverse3(state.information)
    if covariance is None:
        return problem.nothing("the geometry leaves the direction open")
    prior = 0.0 if problem.ranged else (w * problem.aperture / INVERSE_RANGE_PRIOR) ** 2
    nis = state.cost - prior
    seen = problem.ranged or math.sqrt(covariance[2, 2]) < 0.5 * INVERSE_RANGE_PRIOR / problem.aperture
    dof = max(0, problem.measurements - (3 if seen else 2))
    across = state.basis @ covariance[:2, :2] @ state.basis.T
    position, spread, reason = None, None, ""
    if nis > chi_square_quantile(GATE_PROBABILITY, max(dof, 1)):
        if problem.ranged:
            alone = _best(problem.without_range(), sought, front)
            if alone is not None:
                bare = _judge(problem.without_range(), *alone, sought, front)
                if not bare.reason:
                    what = "range" if problem.depth is None else "depth" if problem.range_ is None else "depth or range"
                    return AcousticSolution(
                        None,
                        bare.direction,
                        bare.direction_covariance,
                        None,
                        bare.residuals_s,
                        nis,
                        dof,
                        state.iterations,
                        True,
                        f"the {what} contradicts the angles",
                        bare.mirror,
                    )
        reason = (
            f"the delays do not fit one source (normalised squared residual {nis:.1f} for {dof} degrees of freedom)"
        )
    elif w > 0.0 and math.sqrt(covariance[2, 2]) < LARGEST_RANGE_SHARE * w:
        position = direction / w
        by_state = np.column_stack((state.basis / w, -direction / (w * w)))
        spread = by_state @ covariance @ by_state.T
    elif problem.ranged:
        reason = "range unknown: the depth says too little about it at this elevation"
    return AcousticSolution(
        position,
        direction,
        across,
        spread,
        residuals / problem.sound_speed,
        nis,
        dof,
        state.iterations,
        state.converged,
        reason,
        mirror,
    )


def _across(direction: Array) -> Array:
    """Two unit vectors (3, 2) perpendicular to a unit vector."""
    x, y, z = direction.tolist()
    if abs(x) < 0.7:
        length = math.sqrt(y * y + z * z)
        first = (0.0, z / length, -y / length)
    else:
        length = math.sqrt(x * x + y * y)
        first = (y / length, -x / length, 0.0)
    a, b, c = first
    return np.array(((a, y * c - z * b), (b, z * a - x * c), (c, x * b - y * a)))


def _solve3(matrix: Array, right: Array) -> Array | None:
    try:
        solution = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return solution if math.isfinite(float(solution.sum())) else None


def _inverse3(matrix: Array) -> Array | None:
    try:
        scale = 1.0 / np.sqrt(matrix.diagonal())
        inverse = np.asarray(np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return inverse if np.isfinite(inverse).all() and (inverse.diagonal() > 0.0).all() else None
