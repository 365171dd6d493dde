"""Mahony's complementary filter.

R. Mahony, T. Hamel, J.-M. Pflimlin, Nonlinear complementary filters on the special orthogonal group (2008),
doi:10.1109/TAC.2008.923738, the explicit filter (eq. 32) with gravity and the field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from bluerov_slam.navigation.attitude.filter import NO_BIAS, MagneticNorthFilter, direction, integrated, usable
from bluerov_slam.navigation.attitude.quaternion import Quaternion, Vector, normalised


class Mahony(MagneticNorthFilter):
    """`kp_radps` pulls the attitude towards gravity and field, `ki_radps2` learns the gyro bias (0: not at all).

    Unlike Madgwick's, its correction shrinks with the error: quiet at rest, and slower from a wrong start. The heading
    is pulled by the square of the field's horizontal share: at a dip of 63 degrees five times slower than the tilt. As
    with `Madgwick`, the rate turns the attitude before the sample is compared; `published_order` keeps the old way.
    """

    def __init__(
        self,
        kp_radps: float = 0.5,
        ki_radps2: float = 0.01,
        declination_rad: float = 0.0,
        published_order: bool = False,
    ) -> None:
        super().__init__(declination_rad)
        self.kp_radps = kp_radps
        self.ki_radps2 = ki_radps2
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
        q = self._q
        if not self.published_order:
            q = normalised(integrated(q, angular_rate_frd_radps, self._bias, interval_s))
        down = direction(specific_force_frd_mps2, -1.0)
        ex, ey, ez = (0.0, 0.0, 0.0) if down is None else _error(q, down, direction(magnetic_field_frd))
        bx, by, bz = self._bias
        k = self.ki_radps2 * interval_s
        self._bias = bx, by, bz = bx - k * ex, by - k * ey, bz - k * ez
        kp = self.kp_radps
        rate: Sequence[float] = (kp * ex, kp * ey, kp * ez)
        if self.published_order:
            gx, gy, gz = angular_rate_frd_radps
            rate = (gx - bx + rate[0], gy - by + rate[1], gz - bz + rate[2])
        self._q = normalised(integrated(q, rate, NO_BIAS, interval_s))
        return self.quaternion_ned_frd


def _error(q: Quaternion, down: Vector, field: Vector | None) -> Vector:
    """Measured x expected, summed over gravity and field (eq. 32c): the small rotation that is missing, in the body."""
    q0, q1, q2, q3 = q
    ax, ay, az = down
    q11, q22, q33 = q1 * q1, q2 * q2, q3 * q3
    # Where the attitude expects down: the third row of the rotation matrix.
    vx, vy, vz = 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q11 + q22)
    ex, ey, ez = ay * vz - az * vy, az * vx - ax * vz, ax * vy - ay * vx
    if field is None:
        return ex, ey, ez
    mx, my, mz = field
    r11, r12, r13 = 1.0 - 2.0 * (q22 + q33), 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2)
    hx = mx * r11 + my * r12 + mz * r13
    hy = 2.0 * mx * (q1 * q2 + q0 * q3) + my * (1.0 - 2.0 * (q11 + q33)) + 2.0 * mz * (q2 * q3 - q0 * q1)
    bx, bz = math.sqrt(hx * hx + hy * hy), mx * vx + my * vy + mz * vz
    wx, wy, wz = bx * r11 + bz * vx, bx * r12 + bz * vy, bx * r13 + bz * vz
    return ex + my * wz - mz * wy, ey + mz * wx - mx * wz, ez + mx * wy - my * wx
