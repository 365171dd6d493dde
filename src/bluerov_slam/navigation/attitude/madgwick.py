"""Madgwick's gradient-descent filter, and the version of the iSBL thesis.

S. Madgwick, An efficient orientation filter for inertial and inertial/magnetic sensor arrays (2010); equation numbers
below are his. His accelerometer reads +1 g along the earth's z at rest, which here points down: a = -f / |f|.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from bluerov_slam.navigation.attitude.filter import NO_BIAS, MagneticNorthFilter, direction, integrated, usable
from bluerov_slam.navigation.attitude.quaternion import Quaternion, Vector, conjugate, normalised, to_euler

THESIS_BETA_RADPS = 0.11
THESIS_SETTLING_UPDATES = 10_000
_NO_STEP: Quaternion = (0.0, 0.0, 0.0, 0.0)


class Madgwick(MagneticNorthFilter):
    """The filter with both gains.

    `beta_radps`: how fast the attitude follows gravity and field. `zeta_radps2`: how fast the gyro bias is learnt from
    the direction of that correction (0: not at all). The step always has the length beta, however small the error is:
    beta also sets the noise at rest.

    Published, a sample is compared with the attitude of the sample before, so that the attitude lags by one sample (at
    20 Hz and 20 deg/s one degree). Here the rate turns the attitude first; `published_order` keeps the old way.
    """

    def __init__(
        self,
        beta_radps: float = 0.05,
        zeta_radps2: float = 0.002,
        declination_rad: float = 0.0,
        published_order: bool = False,
    ) -> None:
        super().__init__(declination_rad)
        self.beta_radps = beta_radps
        self.zeta_radps2 = zeta_radps2
        self.published_order = published_order

    def update(
        self,
        angular_rate_frd_radps: Sequence[float],
        specific_force_frd_mps2: Sequence[float],
        magnetic_field_frd: Sequence[float] | None,
        interval_s: float,
    ) -> Quaternion:
        """One sample; without a usable specific force the rate alone moves the attitude."""
        if not usable(angular_rate_frd_radps, interval_s):
            return self.quaternion_ned_frd
        down, field = direction(specific_force_frd_mps2, -1.0), direction(magnetic_field_frd)
        if self.published_order:
            step = self._step(self._q, down, field, interval_s)
            p0, p1, p2, p3 = integrated(self._q, angular_rate_frd_radps, self._bias, interval_s)
        else:
            predicted = normalised(integrated(self._q, angular_rate_frd_radps, self._bias, interval_s))
            step = self._step(predicted, down, field, interval_s)
            p0, p1, p2, p3 = predicted
        k = self.beta_radps * interval_s
        self._q = normalised((p0 - k * step[0], p1 - k * step[1], p2 - k * step[2], p3 - k * step[3]))
        return self.quaternion_ned_frd

    def _step(self, q: Quaternion, down: Vector | None, field: Vector | None, interval_s: float) -> Quaternion:
        """Unit step against the error (eq. 42 to 44), and the bias it speaks for (eq. 47, 48)."""
        if down is None:
            return _NO_STEP
        s0, s1, s2, s3 = gradient(q, down, field, 1.0)
        square = s0 * s0 + s1 * s1 + s2 * s2 + s3 * s3
        if square == 0.0:
            return _NO_STEP
        scale = 1.0 / math.sqrt(square)
        s0, s1, s2, s3 = s0 * scale, s1 * scale, s2 * scale, s3 * scale
        if self.zeta_radps2:
            k = 2.0 * self.zeta_radps2 * interval_s
            q0, q1, q2, q3 = q
            bx, by, bz = self._bias
            self._bias = (
                bx + k * (q0 * s1 - q1 * s0 - q2 * s3 + q3 * s2),
                by + k * (q0 * s2 + q1 * s3 - q2 * s0 - q3 * s1),
                bz + k * (q0 * s3 - q1 * s2 + q2 * s1 - q3 * s0),
            )
        return s0, s1, s2, s3


class ThesisMadgwick(MagneticNorthFilter):
    """The filter as it ran in the iSBL thesis (J. Frabosilio, Cal Poly 2024, chapter 4): a baseline, not for use.

    What it does differently, and why `Madgwick` does not:
    - no gyro bias: what the 256 samples at the start leave pulls the heading for the whole session;
    - the reference field has half its length (an error of the C code it stems from), so that the magnetometer pulls
      half as hard as it should;
    - normalises by a bit trick with one Newton step, 0.17 % short;
    - compares a sample with the attitude of the sample before;
    - begins at the identity and needs 10,000 updates (48 s) to settle; the start yaw is then ONE sample's
      (`thesis_start_yaw`), with all its noise, for the session.
    Its magnetometer and accelerometer were never calibrated; that lies in the samples, not here.
    """

    def __init__(self, beta_radps: float = THESIS_BETA_RADPS) -> None:
        super().__init__()
        self.beta_radps = beta_radps

    def update(
        self,
        angular_rate_frd_radps: Sequence[float],
        specific_force_frd_mps2: Sequence[float],
        magnetic_field_frd: Sequence[float] | None,
        interval_s: float,
    ) -> Quaternion:
        """One sample. The thesis always has a field (an old one again where there is no new one)."""
        if not usable(angular_rate_frd_radps, interval_s):
            return self._q
        p0, p1, p2, p3 = integrated(self._q, angular_rate_frd_radps, NO_BIAS, interval_s)
        down = _scaled_by_trick(specific_force_frd_mps2, -1.0)
        if down is not None:
            s0, s1, s2, s3 = gradient(self._q, down, _scaled_by_trick(magnetic_field_frd, 1.0), 0.5)
            square = s0 * s0 + s1 * s1 + s2 * s2 + s3 * s3
            if square > 0.0:
                k = self.beta_radps * fast_inverse_root(square) * interval_s
                p0, p1, p2, p3 = p0 - k * s0, p1 - k * s1, p2 - k * s2, p3 - k * s3
        scale = fast_inverse_root(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
        self._q = (p0 * scale, p1 * scale, p2 * scale, p3 * scale)
        return self._q


def thesis_start_yaw(quaternion_ned_frd: Quaternion) -> float:
    """The yaw of the conjugate of one sample, as the thesis takes it.

    It turns the session back by this angle; the true one is -yaw(q), which differs where the vehicle is tilted.
    """
    return to_euler(conjugate(quaternion_ned_frd))[2]


def gradient(q: Quaternion, down: Vector, field: Vector | None, field_length: float) -> Quaternion:
    """J^T f of gravity (eq. 25, 26) and, where there is one, of the field (eq. 29 to 34, 45, 46).

    `field_length` scales the reference field: 1 is right.
    """
    q0, q1, q2, q3 = q
    ax, ay, az = down
    q11, q22, q33 = q1 * q1, q2 * q2, q3 * q3
    u13, u01, half_z = q1 * q3 - q0 * q2, q0 * q1 + q2 * q3, 0.5 - q11 - q22
    f1, f2, f3 = 2.0 * u13 - ax, 2.0 * u01 - ay, 2.0 * half_z - az
    s0 = 2.0 * (q1 * f2 - q2 * f1)
    s1 = 2.0 * (q3 * f1 + q0 * f2) - 4.0 * q1 * f3
    s2 = 2.0 * (q3 * f2 - q0 * f1) - 4.0 * q2 * f3
    s3 = 2.0 * (q1 * f1 + q2 * f2)
    if field is None:
        return s0, s1, s2, s3
    mx, my, mz = field
    half_x, u12, u02 = 0.5 - q22 - q33, q1 * q2 - q0 * q3, q0 * q2 + q1 * q3
    # The field turned into the earth's frame; its horizontal part is north by definition.
    hx = 2.0 * (mx * half_x + my * u12 + mz * u02)
    hy = 2.0 * (mx * (q1 * q2 + q0 * q3) + my * (0.5 - q11 - q33) + mz * (q2 * q3 - q0 * q1))
    bx = 2.0 * field_length * math.sqrt(hx * hx + hy * hy)
    bz = 4.0 * field_length * (mx * u13 + my * u01 + mz * half_z)
    f4 = bx * half_x + bz * u13 - mx
    f5 = bx * u12 + bz * u01 - my
    f6 = bx * u02 + bz * half_z - mz
    return (
        s0 - bz * q2 * f4 + (bz * q1 - bx * q3) * f5 + bx * q2 * f6,
        s1 + bz * q3 * f4 + (bx * q2 + bz * q0) * f5 + (bx * q3 - 2.0 * bz * q1) * f6,
        s2 - (2.0 * bx * q2 + bz * q0) * f4 + (bx * q1 + bz * q3) * f5 + (bx * q0 - 2.0 * bz * q2) * f6,
        s3 + (bz * q1 - 2.0 * bx * q3) * f4 + (bz * q2 - bx * q0) * f5 + bx * q1 * f6,
    )


def fast_inverse_root(square: float) -> float:
    """1 / sqrt by the bits of a 32-bit float and one Newton step: up to 0.175 % too small."""
    bits: int = struct.unpack("<i", struct.pack("<f", square))[0]
    guess: float = struct.unpack("<f", struct.pack("<i", 0x5F3759DF - (bits >> 1)))[0]
    return guess * (1.5 - 0.5 * square * guess * guess)


def _scaled_by_trick(vector: Sequence[float] | None, sign: float) -> Vector | None:
    if vector is None:
        return None
    x, y, z = vector
    square = x * x + y * y + z * z
    if not 0.0 < square < 1e30:
        return None
    scale = sign * fast_inverse_root(square)
    return x * scale, y * scale, z * scale
