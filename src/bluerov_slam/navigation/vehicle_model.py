"""From thruster commands and battery voltage to the vehicle's velocity through the water.

Three steps, each a few numbers: a T200's thrust from its pulse width and voltage, the layout that adds the thrusters
up, and the hull's drag. The result is velocity through WATER; the current is the estimator's state, not ours.

Not modelled, and therefore in the stated error and in the estimator's thrust scale: thrust lost when water already
flows into the thruster, the tether, wash of one thruster on another, fouling, damaged blades.

Sources: Blue Robotics' public T200 performance data (September 2019, 10 to 20 V, bollard pull); the motor factors of
ArduSub's VECTORED and VECTORED_6DOF frames; drag of von Benzon et al. (2022), doi:10.3390/jmse10121898.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PWM_STOP_US = 1500.0
PWM_HALF_RANGE_US = 400.0
NOMINAL_VOLTAGE_V = 16.0
_PWM_POSSIBLE_US = (800.0, 2200.0)
_VOLTAGE_POSSIBLE_V = (6.0, 26.0)
_HALF = math.sqrt(0.5)


@dataclass(frozen=True, slots=True)
class ThrustCurve:
    """Thrust of one thruster: T = T_max(V) p(x), x = (pulse beyond the dead band) / (full pulse beyond the dead band).

    T_max(V) = a0 + a1 (V - 16) + a2 (V - 16)^2 in newton, p(x) = p1 x + p2 x^2 + (1 - p1 - p2) x^3, each for forward
    and reverse.
    """

    forward_max_n: tuple[float, float, float]
    reverse_max_n: tuple[float, float, float]
    forward_shape: tuple[float, float]
    reverse_shape: tuple[float, float]
    dead_band_us: float

    def thrust_n(self, pulse_us: float, voltage_v: float) -> float:
        """Thrust at a pulse counted from the stop (-400..400 us; beyond it the thruster gives no more)."""
        x = self.throttle(pulse_us)
        if x == 0.0:
            return 0.0
        forward = pulse_us > 0.0
        a0, a1, a2 = self.forward_max_n if forward else self.reverse_max_n
        p1, p2 = self.forward_shape if forward else self.reverse_shape
        excess_v = voltage_v - NOMINAL_VOLTAGE_V
        most_n = max(0.0, a0 + excess_v * (a1 + excess_v * a2))
        thrust_n = most_n * x * (p1 + x * (p2 + x * (1.0 - p1 - p2)))
        return thrust_n if forward else -thrust_n

    def throttle(self, pulse_us: float) -> float:
        """How far beyond the dead band, 0..1."""
        beyond_us = abs(pulse_us) - self.dead_band_us
        return min(1.0, max(0.0, beyond_us / (PWM_HALF_RANGE_US - self.dead_band_us)))


T200 = ThrustCurve(
    forward_max_n=(51.65, 3.680, -0.0286),
    reverse_max_n=(39.95, 2.605, -0.0589),
    forward_shape=(0.331, 1.171),
    reverse_shape=(0.364, 1.075),
    dead_band_us=28.0,
)
"""Fitted to points of the public data: within 0.9 N at 16 V, 1.2 N at 12 V; full thrust within 0.3 N at 12 to 20 V."""


@dataclass(frozen=True, slots=True)
class Thruster:
    """One thruster: where a positive demand pushes (FRD, unit length) and the autopilot's MOT_n_DIRECTION, 1 or -1."""

    axis_frd: tuple[float, float, float]
    direction: int = 1


@dataclass(frozen=True, slots=True)
class ThrusterLayout:
    """Thrusters in the order of the servo channels, beginning with channel 1."""

    name: str
    thrusters: tuple[Thruster, ...]

    def with_directions(self, directions: Sequence[int]) -> ThrusterLayout:
        """The same layout with the autopilot's MOT_n_DIRECTION parameters (1 or -1 each)."""
        if len(directions) < len(self.thrusters) or any(value not in (1, -1) for value in directions):
            raise ValueError(f"{len(self.thrusters)} directions of 1 or -1 are needed, not {tuple(directions)}")
        turned = (
            replace(thruster, direction=int(value)) for thruster, value in zip(self.thrusters, directions, strict=False)
        )
        return replace(self, thrusters=tuple(turned))


_VECTORED = (
    Thruster((-_HALF, _HALF, 0.0)),
    Thruster((-_HALF, -_HALF, 0.0)),
    Thruster((_HALF, _HALF, 0.0)),
    Thruster((_HALF, -_HALF, 0.0)),
)
_VERTICAL = Thruster((0.0, 0.0, 1.0))
BLUEROV2 = ThrusterLayout("BlueROV2", _VECTORED + 2 * (_VERTICAL,))
BLUEROV2_HEAVY = ThrusterLayout("BlueROV2 Heavy", _VECTORED + 4 * (_VERTICAL,))


@dataclass(frozen=True, slots=True)
class Hull:
    """What resists: drag = linear * u + quadratic * u |u| along each body axis, and the mass that the water adds."""

    mass_kg: float = 13.5
    added_mass_kg: tuple[float, float, float] = (6.4, 7.1, 18.7)
    linear_drag_npmps: tuple[float, float, float] = (13.7, 0.0, 33.0)
    quadratic_drag_npm2ps2: tuple[float, float, float] = (141.0, 217.0, 190.0)


@dataclass(frozen=True, slots=True)
class ThrustModelError:
    """One-sigma errors of the model, stated with each velocity.

    `relative_force` beside the thrust scale that the estimator holds as a state; `force_n` per axis: dead band, tether,
    trim; `velocity_mps`: waves and eddies; `voltage_v`: when no voltage is known and the nominal one is taken.
    """

    relative_force: float = 0.10
    force_n: tuple[float, float, float] = (1.0, 1.5, 4.0)
    velocity_mps: float = 0.03
    voltage_v: float = 1.5


class WaterVelocity(NamedTuple):
    """Velocity through the water, body FRD, with its one-sigma error per axis; both float64 (3,)."""

    velocity_frd_mps: NDArray[np.float64]
    std_mps: NDArray[np.float64]


class ThrustModel:
    """Force and steady velocity for a command; remembers nothing."""

    def __init__(
        self,
        layout: ThrusterLayout = BLUEROV2,
        hull: Hull = Hull(),
        curve: ThrustCurve = T200,
        error: ThrustModelError = ThrustModelError(),
    ) -> None:
        self.layout = layout
        self.hull = hull
        self.curve = curve
        self.error = error

    def force_frd(self, pwm_us: Sequence[float], voltage_v: float | None) -> NDArray[np.float64] | None:
        """Sum of all thrusters, newton, (3,). None where a channel has no pulse (0) or makes no sense."""
        pulses_us = self._pulses(pwm_us)
        voltage_v = NOMINAL_VOLTAGE_V if voltage_v is None else voltage_v
        low_v, high_v = _VOLTAGE_POSSIBLE_V
        if pulses_us is None or not low_v <= voltage_v <= high_v:
            return None
        force_n = [0.0, 0.0, 0.0]
        for thruster, pulse_us in zip(self.layout.thrusters, pulses_us, strict=True):
            thrust_n = self.curve.thrust_n(pulse_us, voltage_v)
            if thrust_n:
                for axis in range(3):
                    force_n[axis] += thrust_n * thruster.axis_frd[axis]
        return np.array(force_n)

    def force_std_n(self, force_frd_n: NDArray[np.float64], voltage_v: float | None) -> NDArray[np.float64]:
        """One-sigma error of a force, newton, (3,)."""
        relative = self.error.relative_force
        if voltage_v is None:  # thrust goes about as V^1.16
            relative = math.hypot(relative, 1.16 * self.error.voltage_v / NOMINAL_VOLTAGE_V)
        return np.hypot(relative * np.abs(force_frd_n), self.error.force_n)

    def water_velocity_frd(self, pwm_us: Sequence[float], voltage_v: float | None) -> WaterVelocity | None:
        """The velocity at which drag balances thrust, as if the command had been held for seconds.

        `voltage_v` None: the nominal battery, with a wider error. None where the force is unknown.
        """
        force_n = self.force_frd(pwm_us, voltage_v)
        if force_n is None:
            return None
        return WaterVelocity(self.steady_velocity(force_n), self.velocity_std(force_n, voltage_v))

    def steady_velocity(self, force_frd_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solves linear u + quadratic u |u| = force per axis, (3,)."""
        hull = self.hull
        return np.array(
            [
                speed_under(float(force), hull.linear_drag_npmps[axis], hull.quadratic_drag_npm2ps2[axis])
                for axis, force in enumerate(force_frd_n)
            ]
        )

    def velocity_std(self, force_frd_n: NDArray[np.float64], voltage_v: float | None) -> NDArray[np.float64]:
        """What the force's error does to the steady velocity, (3,). Secants, because the slope is infinite at rest."""
        force_std_n = self.force_std_n(force_frd_n, voltage_v)
        middle = self.steady_velocity(force_frd_n)
        above = self.steady_velocity(force_frd_n + force_std_n) - middle
        below = middle - self.steady_velocity(force_frd_n - force_std_n)
        return np.hypot(np.maximum(above, below), self.error.velocity_mps)

    def effort(self, pwm_us: Sequence[float]) -> NDArray[np.float64] | None:
        """Share of its full current that each thruster draws, about 0..1, (n,): what disturbs a magnetometer."""
        pulses_us = self._pulses(pwm_us)
        return None if pulses_us is None else np.array([self.curve.throttle(pulse_us) ** 2 for pulse_us in pulses_us])

    def _pulses(self, pwm_us: Sequence[float]) -> list[float] | None:
        """Pulses about the stop, signed by the demand; None unless every channel has a possible one."""
        thrusters = self.layout.thrusters
        low_us, high_us = _PWM_POSSIBLE_US
        if len(pwm_us) < len(thrusters) or not all(low_us <= pwm <= high_us for pwm in pwm_us[: len(thrusters)]):
            return None
        return [
            thruster.direction * (float(pwm) - PWM_STOP_US) for thruster, pwm in zip(thrusters, pwm_us, strict=False)
        ]


class MovingVehicle:
    """The velocity as it builds up and dies away: mass and added mass, drag, and thrusters that take time to spin up.

    Backward Euler with the quadratic solved exactly: stable at any interval, exact at rest and at steady speed.
    """

    def __init__(self, model: ThrustModel, spin_up_s: float = 0.15) -> None:
        self.model = model
        self.spin_up_s = spin_up_s
        self._masses_kg = [model.hull.mass_kg + added for added in model.hull.added_mass_kg]
        self.reset()

    def reset(self, velocity_frd_mps: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Begin again at a velocity, with the thrusters at rest."""
        self._velocity_mps = [float(value) for value in velocity_frd_mps]
        self._force_n = np.zeros(3)

    def update(
        self,
        pwm_us: Sequence[float],
        voltage_v: float | None,
        interval_s: float,
        angular_rate_frd_radps: Sequence[float] | None = None,
    ) -> WaterVelocity | None:
        """One interval under a command; None, and the state stays, where the command or the interval is no use.

        With the angular rate the momentum turns with the body (at 20 deg/s and 0.5 m/s it slips 0.13 m/s sideways).
        """
        commanded_n = self.model.force_frd(pwm_us, voltage_v)
        if commanded_n is None or not 0.0 < interval_s < math.inf:
            return None
        self._force_n = self._force_n + (commanded_n - self._force_n) * -math.expm1(-interval_s / self.spin_up_s)
        hull, before, mass = self.model.hull, self._velocity_mps, self._masses_kg
        turning_n = (0.0, 0.0, 0.0) if angular_rate_frd_radps is None else self._turning_n(angular_rate_frd_radps)
        for axis in range(3):
            inertia = mass[axis] / interval_s
            self._velocity_mps[axis] = speed_under(
                float(self._force_n[axis]) + turning_n[axis] + inertia * before[axis],
                hull.linear_drag_npmps[axis] + inertia,
                hull.quadratic_drag_npm2ps2[axis],
            )
        return WaterVelocity(np.array(self._velocity_mps), self.model.velocity_std(self._force_n, voltage_v))

    def _turning_n(self, rate: Sequence[float]) -> tuple[float, float, float]:
        """Coriolis forces on mass and added mass (Fossen 2011, with a diagonal mass matrix)."""
        p, q, r = rate
        u, v, w = (mass * speed for mass, speed in zip(self._masses_kg, self._velocity_mps, strict=True))
        return v * r - w * q, w * p - u * r, u * q - v * p


def scale_jacobian(velocity_frd_mps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivative of the true water velocity by the thrust scale (surge, sway), (3, 2): true = (1 + scale) modelled."""
    jacobian = np.zeros((3, 2))
    jacobian[0, 0] = velocity_frd_mps[0]
    jacobian[1, 1] = velocity_frd_mps[1]
    return jacobian


def speed_under(force_n: float, linear: float, quadratic: float) -> float:
    """The speed u with linear u + quadratic u |u| = force."""
    if force_n == 0.0:
        return 0.0
    # 2 F / (l + sqrt(l^2 + 4 q |F|)) is the same root without the difference of near numbers, and holds for q = 0.
    return 2.0 * force_n / (linear + math.sqrt(linear * linear + 4.0 * quadratic * abs(force_n)))
