"""Thrusters of a BlueROV2: where they push, from PWM and battery voltage to force and back, and the battery.

Thrust of a T200 as the maker publishes it: 5.25 kgf ahead and 4.10 kgf astern at 16 V and full throttle, nothing within
about 36 us of 1500 us, between linear and square in the throttle. Mixing and signs are those of ArduSub's frames
"vectored" (six) and "vectored 6DOF" (eight).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

NEUTRAL_US = 1500
_DEADBAND_US = 36.0
_SPAN_US = 364.0
_LINEAR_SHARE = 0.6
_AHEAD_N, _ASTERN_N = 5.25 * 9.80665, 4.10 * 9.80665
_NOMINAL_V = 16.0
_VOLTAGE_POWER = 1.2
_FULL_CURRENT_A = 24.0
_CURRENT_POWER = 1.5
_HALF_ROOT = math.sqrt(0.5)

Force = tuple[float, float, float, float, float, float]
"""Surge, sway, heave in N and roll, pitch, yaw moments in N m, body FRD."""


@dataclass(frozen=True, slots=True)
class ThrusterFrame:
    """What one newton of each thruster does to the body, and the share of each axis it is asked to carry."""

    name: str
    effect: tuple[Force, ...]
    share: tuple[Force, ...]

    @property
    def count(self) -> int:
        """Thrusters on outputs 1 to n."""
        return len(self.effect)

    @property
    def controls_pitch(self) -> bool:
        """Only the frame with four vertical thrusters does."""
        return any(row[4] for row in self.share)


def _frame(name: str, vertical: tuple[tuple[float, float], ...]) -> ThrusterFrame:
    """`vertical`: where each vertical thruster sits, starboard and ahead of the middle, in m."""
    yaw_arm_m = 0.1888  # of the four vectored thrusters at 45 degrees, 0.156 m ahead and 0.111 m aside of the middle
    line_height_m = 0.002  # of the thrust line below the centre of drag, with usual ballast
    effect: list[Force] = []
    for ahead, aside, turn in ((-1, 1, 1), (-1, -1, -1), (1, 1, -1), (1, -1, 1)):
        surge, sway = ahead * _HALF_ROOT, aside * _HALF_ROOT
        effect.append((surge, sway, 0.0, -sway * line_height_m, surge * line_height_m, turn * yaw_arm_m))
    # ArduSub's mixer gives throttle up the factor -1: a positive output of a vertical thruster pushes down.
    effect += [(0.0, 0.0, 1.0, aside, -ahead, 0.0) for aside, ahead in vertical]
    share: list[Force] = []
    for number, row in enumerate(effect):
        members, allowed = (effect[:4], (0, 1, 5)) if number < 4 else (effect[4:], (2, 3, 4))
        weight = [sum(member[axis] ** 2 for member in members) for axis in range(6)]
        values = [row[a] / weight[a] if a in allowed and weight[a] > 0.0 else 0.0 for a in range(6)]
        share.append((values[0], values[1], values[2], values[3], values[4], values[5]))
    return ThrusterFrame(name, tuple(effect), tuple(share))


VECTORED = _frame("vectored", ((0.111, 0.0), (-0.111, 0.0)))
VECTORED_6DOF = _frame("vectored_6dof", ((0.218, 0.120), (-0.218, 0.120), (0.218, -0.120), (-0.218, -0.120)))
FRAMES = {6: VECTORED, 8: VECTORED_6DOF}


def thrust_n(pwm_us: float, voltage_v: float) -> float:
    """Force of one T200 in still water, positive for PWM above neutral."""
    off_us = pwm_us - NEUTRAL_US
    x = (abs(off_us) - _DEADBAND_US) / _SPAN_US
    if x <= 0.0:
        return 0.0
    full_n = _AHEAD_N if off_us > 0.0 else -_ASTERN_N
    return full_n * x * (_LINEAR_SHARE + (1.0 - _LINEAR_SHARE) * x) * _strength(voltage_v)


def pwm_for_us(force_n: float, most_us: int = 400) -> int:
    """The output that gives this force at 16 V: what an autopilot without voltage compensation asks for."""
    size_n = abs(force_n)
    if size_n < 0.05:
        return NEUTRAL_US
    y = size_n / (_AHEAD_N if force_n > 0.0 else _ASTERN_N)
    square = 1.0 - _LINEAR_SHARE
    x = (math.sqrt(_LINEAR_SHARE**2 + 4.0 * square * y) - _LINEAR_SHARE) / (2.0 * square)
    off_us = min(most_us, round(_DEADBAND_US + _SPAN_US * x))
    return NEUTRAL_US + (off_us if force_n > 0.0 else -off_us)


def current_a(force_n: float, voltage_v: float) -> float:
    """What one thruster draws for a force."""
    full_n = (_AHEAD_N if force_n > 0.0 else _ASTERN_N) * _strength(voltage_v)
    return _FULL_CURRENT_A * voltage_v / _NOMINAL_V * math.pow(min(1.2, abs(force_n) / full_n), _CURRENT_POWER)


def _strength(voltage_v: float) -> float:
    """Of a thruster, against 16 V."""
    return math.pow(voltage_v / _NOMINAL_V, _VOLTAGE_POWER)


class Battery:
    """A 4S pack of 18 Ah: open voltage falls with the charge taken, and sags with the current."""

    CAPACITY_AH = 18.0
    _FULL_V, _EMPTY_V = 16.7, 13.6
    _RESISTANCE_OHM = 0.03

    def __init__(self, charge_share: float = 0.97) -> None:
        self.charge_share = charge_share
        self.current_a = 0.0

    @property
    def voltage_v(self) -> float:
        """At the terminals."""
        open_v = self._EMPTY_V + (self._FULL_V - self._EMPTY_V) * math.pow(self.charge_share, 0.8)
        return open_v - self._RESISTANCE_OHM * self.current_a

    def draw(self, current_a: float, duration_s: float) -> None:
        """Take this current for so long."""
        self.current_a = current_a
        self.charge_share = max(0.02, self.charge_share - current_a * duration_s / (3600.0 * self.CAPACITY_AH))
