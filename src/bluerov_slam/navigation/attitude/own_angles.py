"""The sensor's own angles (HWT905 and the like) on the interface of the filters."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bluerov_slam.navigation.attitude.filter import NO_BIAS, usable
from bluerov_slam.navigation.attitude.quaternion import IDENTITY, Quaternion, Vector, from_euler, multiply, turned


class OwnAngles:
    """Takes the sensor's angles as they come and bridges the time between two of them with the rates.

    The gyro and the magnetometer are inside the angles: nothing of the sensor may be used a second time beside them.
    Its yaw is towards magnetic north.
    """

    def __init__(self, declination_rad: float = 0.0) -> None:
        half = 0.5 * declination_rad
        self._to_true: Quaternion = (math.cos(half), 0.0, 0.0, math.sin(half))
        self._q: Quaternion = IDENTITY
        self._bias: Vector = NO_BIAS

    @property
    def quaternion_ned_frd(self) -> Quaternion:
        """The newest angles, carried on by the rates since."""
        return self._q

    @property
    def gyro_bias_frd_radps(self) -> Vector:
        """The bias given at the start: the sensor keeps its own to itself."""
        return self._bias

    def initialise(self, quaternion_ned_frd: Quaternion, gyro_bias_frd_radps: Vector = NO_BIAS) -> None:
        """Begin at a known attitude and bias."""
        self._q = quaternion_ned_frd
        self._bias = gyro_bias_frd_radps

    def take(self, roll_rad: float | None, pitch_rad: float | None, yaw_rad: float | None) -> Quaternion:
        """The sensor's angles; where one is missing or not finite, nothing changes."""
        if (
            roll_rad is None
            or pitch_rad is None
            or yaw_rad is None
            or not math.isfinite(roll_rad + pitch_rad + yaw_rad)
        ):
            return self._q
        self._q = multiply(self._to_true, from_euler(roll_rad, pitch_rad, yaw_rad))
        return self._q

    def update(
        self,
        angular_rate_frd_radps: Sequence[float],
        specific_force_frd_mps2: Sequence[float],
        magnetic_field_frd: Sequence[float] | None,
        interval_s: float,
    ) -> Quaternion:
        """Turn on by the rate; specific force and field are the sensor's business."""
        if usable(angular_rate_frd_radps, interval_s):
            gx, gy, gz = angular_rate_frd_radps
            bx, by, bz = self._bias
            self._q = turned(self._q, ((gx - bx) * interval_s, (gy - by) * interval_s, (gz - bz) * interval_s))
        return self._q
