"""The two Kalman filters as the thesis's receiver ran them: on acoustic fixes (iSBL), with dead reckoning (iSBL-SF).

Constant velocity in three axes. All matrices are multiples of the unit matrix, so the axes do not know of each other
and share one covariance [[p00, p01], [p01, p11]] of position and velocity. What its author wrote is kept with its
faults: Q is added per fix whatever time has passed, everything starts from zero with a covariance far below that of a
fix, and a displacement is taken for the velocity times the time. `slip_lattice` is the corrected filter.

Source: thesis chapter 5; only the ratios of Q, R and P matter. Metres and seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

Triple = tuple[float, float, float]

Q_POSITION, Q_VELOCITY = 0.1, 10.0
R_FIX, R_DISPLACEMENT = 1000.0, 10000.0
P_START = 10.0
ZERO: Triple = (0.0, 0.0, 0.0)

_STEADY_STEPS = 200


@dataclass(frozen=True, slots=True)
class Covariance:
    """Of one axis, as every axis has it."""

    p00: float = P_START
    p01: float = 0.0
    p11: float = P_START

    def predicted(self, dt_s: float) -> Covariance:
        """F P F' + Q; Q knows no time."""
        return Covariance(
            self.p00 + 2.0 * dt_s * self.p01 + dt_s**2 * self.p11 + Q_POSITION,
            self.p01 + dt_s * self.p11,
            self.p11 + Q_VELOCITY,
        )


@dataclass(frozen=True, slots=True)
class Gain:
    """Of a fix and of a displacement on position (`p_`) and velocity (`v_`), and the covariance after both."""

    p_fix: float
    v_fix: float
    p_displacement: float
    v_displacement: float
    after: Covariance


@dataclass(frozen=True, slots=True)
class ThesisState:
    """Where the receiver believes to be. The default is how it starts."""

    position_m: Triple = ZERO
    velocity_mps: Triple = ZERO
    covariance: Covariance = Covariance()


def gain_of_fix(prior: Covariance) -> Gain:
    """K = P H' / (P + R) with H = [1, 0]."""
    s = prior.p00 + R_FIX
    k0, k1 = prior.p00 / s, prior.p01 / s
    after = Covariance((1.0 - k0) * prior.p00, (1.0 - k0) * prior.p01, prior.p11 - k1 * prior.p01)
    return Gain(k0, k1, 0.0, 0.0, after)


def gain_of_fix_and_displacement(prior: Covariance, dt_s: float) -> Gain:
    """K = P H' S^-1 with H = diag(1, dt)."""
    a, b, d = prior.p00, prior.p01 * dt_s, prior.p11 * dt_s**2
    s00, s11 = a + R_FIX, d + R_DISPLACEMENT
    determinant = s00 * s11 - b * b
    velocity_row = (prior.p01, prior.p11 * dt_s)
    k00, k01 = (a * s11 - b * b) / determinant, (b * s00 - a * b) / determinant
    k10 = (velocity_row[0] * s11 - velocity_row[1] * b) / determinant
    k11 = (velocity_row[1] * s00 - velocity_row[0] * b) / determinant
    after = Covariance(
        prior.p00 - k00 * a - k01 * b,
        prior.p01 - k00 * prior.p01 - k01 * prior.p11 * dt_s,
        prior.p11 - k10 * prior.p01 - k11 * prior.p11 * dt_s,
    )
    return Gain(k00, k10, k01, k11, after)


def step(state: ThesisState, fix_m: Triple, dt_s: float) -> ThesisState:
    """The acoustic filter's next state (iSBL)."""
    gain = gain_of_fix(state.covariance.predicted(dt_s))
    return _corrected(state, gain, fix_m, ZERO, dt_s)


def step_fused(state: ThesisState, fix_m: Triple, displacement_m: Triple, dt_s: float) -> ThesisState:
    """The combined filter's next state (iSBL-SF); the displacement is that since the previous fix."""
    gain = gain_of_fix_and_displacement(state.covariance.predicted(dt_s), dt_s)
    return _corrected(state, gain, fix_m, displacement_m, dt_s)


def steady_covariance(dt_s: float, *, fused: bool) -> Covariance:
    """After a fix, once many have come at the same interval."""
    covariance = Covariance()
    for _ in range(_STEADY_STEPS):
        prior = covariance.predicted(dt_s)
        covariance = (gain_of_fix_and_displacement(prior, dt_s) if fused else gain_of_fix(prior)).after
    return covariance


def _corrected(state: ThesisState, gain: Gain, fix_m: Triple, displacement_m: Triple, dt_s: float) -> ThesisState:
    position, velocity = [], []
    for x, v, z, moved in zip(state.position_m, state.velocity_mps, fix_m, displacement_m, strict=True):
        prior = x + dt_s * v
        innovation, moved_more = z - prior, moved - dt_s * v
        position.append(prior + gain.p_fix * innovation + gain.p_displacement * moved_more)
        velocity.append(v + gain.v_fix * innovation + gain.v_displacement * moved_more)
    return ThesisState((position[0], position[1], position[2]), (velocity[0], velocity[1], velocity[2]), gain.after)
