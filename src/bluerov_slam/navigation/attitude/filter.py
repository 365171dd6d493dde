"""What every attitude filter can do, and what they share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from bluerov_slam.navigation.attitude.quaternion import IDENTITY, Quaternion, Vector, multiply, normalised

MAX_INTERVAL_S = 1.0
NO_BIAS: Vector = (0.0, 0.0, 0.0)


class AttitudeFilter(Protocol):
    """Samples in, attitude out. All vectors are body FRD; the specific force of a level vehicle at rest is (0, 0, -g).

    The magnetic field may have any unit; None where there is no new one. Rates that are not finite, or an interval
    outside 0..1 s, change nothing; without a usable specific force the rates alone turn the attitude.
    """

    @property
    def quaternion_ned_frd(self) -> Quaternion:
        """The attitude now, towards true north."""
        ...

    @property
    def gyro_bias_frd_radps(self) -> Vector:
        """What the filter takes off the rates; zeros where it does not estimate it."""
        ...

    def initialise(self, quaternion_ned_frd: Quaternion, gyro_bias_frd_radps: Vector = NO_BIAS) -> None:
        """Begin at a known attitude and bias."""
        ...

    def update(
        self,
        angular_rate_frd_radps: Sequence[float],
        specific_force_frd_mps2: Sequence[float],
        magnetic_field_frd: Sequence[float] | None,
        interval_s: float,
    ) -> Quaternion:
        """One sample, taken `interval_s` after the one before."""
        ...


class MagneticNorthFilter:
    """State of a filter that works towards magnetic north; the declination is put on at the way in and out."""

    def __init__(self, declination_rad: float = 0.0) -> None:
        half = 0.5 * declination_rad
        self._to_true: Quaternion = (math.cos(half), 0.0, 0.0, math.sin(half))
        self._from_true: Quaternion = (math.cos(half), 0.0, 0.0, -math.sin(half))
        self._declined = declination_rad != 0.0
        self._q: Quaternion = IDENTITY
        self._bias: Vector = NO_BIAS

    @property
    def quaternion_ned_frd(self) -> Quaternion:
        """The attitude now, towards true north."""
        return multiply(self._to_true, self._q) if self._declined else self._q

    @property
    def gyro_bias_frd_radps(self) -> Vector:
        """What the filter takes off the rates."""
        return self._bias

    def initialise(self, quaternion_ned_frd: Quaternion, gyro_bias_frd_radps: Vector = NO_BIAS) -> None:
        """Begin at a known attitude and bias."""
        self._q = multiply(self._from_true, normalised(quaternion_ned_frd))
        self._bias = gyro_bias_frd_radps


def usable(rate: Sequence[float], interval_s: float) -> bool:
    """Whether a sample may change the attitude."""
    return 0.0 < interval_s <= MAX_INTERVAL_S and math.isfinite(rate[0] + rate[1] + rate[2])


def direction(vector: Sequence[float] | None, sign: float = 1.0) -> Vector | None:
    """A vector with length 1, or None for none, for zero and for what is not finite."""
    if vector is None:
        return None
    x, y, z = vector
    square = x * x + y * y + z * z
    if not 0.0 < square < math.inf:
        return None
    scale = sign / math.sqrt(square)
    return x * scale, y * scale, z * scale


def integrated(q: Quaternion, rate: Sequence[float], bias: Vector, interval_s: float) -> Quaternion:
    """q + (1/2) q (x) (rate - bias) dt, not yet of length 1 (Madgwick 2010, eq. 11 to 13)."""
    q0, q1, q2, q3 = q
    half = 0.5 * interval_s
    gx, gy, gz = rate
    bx, by, bz = bias
    gx, gy, gz = half * (gx - bx), half * (gy - by), half * (gz - bz)
    return (
        q0 - q1 * gx - q2 * gy - q3 * gz,
        q1 + q0 * gx + q2 * gz - q3 * gy,
        q2 + q0 * gy - q1 * gz + q3 * gx,
        q3 + q0 * gz + q1 * gy - q2 * gx,
    )
