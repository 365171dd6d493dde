"""Exact inertial and magnetic samples of a given motion, and the errors a consumer sensor puts on them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude.quaternion import Quaternion, conjugate, from_euler, multiply, rotate

GRAVITY_MPS2 = 9.80665
FIELD_NED = (0.45, 0.0, 0.89)  # towards magnetic north and down, central Europe


@dataclass(frozen=True, slots=True)
class Samples:
    """`quaternion_ned_frd[k]` is the attitude at the end of interval k, over which `rate[k]` turned."""

    interval_s: float
    quaternion_ned_frd: list[Quaternion]
    rate: NDArray[np.float64]
    force: NDArray[np.float64]
    field: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.rate)


def samples_of(
    euler_at: Callable[[float], tuple[float, float, float]],
    duration_s: float,
    rate_hz: float = 100.0,
    acceleration_ned_at: Callable[[float], tuple[float, float, float]] | None = None,
) -> Samples:
    """Samples of roll, pitch, yaw (rad) as a function of time; the rate is the exact mean over each interval."""
    dt = 1.0 / rate_hz
    attitudes = [from_euler(*euler_at(k * dt)) for k in range(round(duration_s * rate_hz) + 1)]
    rates, forces, fields = [], [], []
    for k, (before, after) in enumerate(itertools.pairwise(attitudes), start=1):
        w, x, y, z = multiply(conjugate(before), after)
        sine = math.sqrt(x * x + y * y + z * z)
        per_s = 2.0 * math.atan2(sine, abs(w)) / (sine * dt) * math.copysign(1.0, w) if sine > 0.0 else 0.0
        rates.append((x * per_s, y * per_s, z * per_s))
        a = (0.0, 0.0, 0.0) if acceleration_ned_at is None else acceleration_ned_at(k * dt)
        forces.append(rotate(conjugate(after), (a[0], a[1], a[2] - GRAVITY_MPS2)))
        fields.append(rotate(conjugate(after), FIELD_NED))
    return Samples(dt, attitudes[1:], np.array(rates), np.array(forces), np.array(fields))


def wobble(t: float) -> tuple[float, float, float]:
    """A lively motion about all three axes, all headings."""
    return 0.4 * math.sin(1.1 * t), 0.3 * math.sin(0.7 * t + 0.5), 0.5 * t + 0.2 * math.sin(0.4 * t)
