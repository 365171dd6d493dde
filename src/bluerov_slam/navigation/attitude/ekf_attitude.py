"""The error-state filter on the interface of the attitude filters: attitude, gyro and accelerometer bias only.

The navigator runs the whole filter (`navigation/ekf.py`); this one is for comparison, and for where attitude is all
that is wanted. Beside the attitude it knows how far off it may be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bluerov_slam.navigation.attitude.filter import NO_BIAS, direction, usable
from bluerov_slam.navigation.attitude.quaternion import IDENTITY, Quaternion, Vector, normalised
from bluerov_slam.navigation.ekf import ErrorStateFilter
from bluerov_slam.navigation.measurements import GravityDirection, MagneticField
from bluerov_slam.navigation.process import ImuSample, ProcessNoise
from bluerov_slam.navigation.rotation import quaternion_from_rotation, rotation_from_quaternion
from bluerov_slam.navigation.state import NavEstimate, StateLayout

_LAYOUT = StateLayout.make(
    without=(
        "current",
        "thrust_scale",
        "compass",
        "compass_wander",
        "gps_wander",
        "depth_bias",
        "sound_speed_scale",
        "dvl",
    )
)
_HELD_M = 1.0


class EkfAttitude:
    """`gravity_every_s`, `field_every_s`: how often the vectors are used; nearer samples share their errors.

    Position and velocity mean nothing here and are set back with every use of gravity.
    """

    def __init__(
        self,
        declination_rad: float = 0.0,
        noise: ProcessNoise | None = None,
        gravity_std_mps2: float = 0.15,
        field_std_rad: float = math.radians(2.0),
        gravity_every_s: float = 0.1,
        field_every_s: float = 0.2,
        start_std_rad: Vector = (0.05, 0.05, 0.2),
        gyro_bias_std_radps: float = math.radians(0.3),
        accel_bias_std_mps2: float = 0.05,
    ) -> None:
        self._declination_rad = declination_rad
        self._noise = noise
        self._gravity_std_mps2 = gravity_std_mps2
        self._field_std_rad = field_std_rad
        self._every_s = gravity_every_s, field_every_s
        self._start_std = _LAYOUT.vector(
            position=_HELD_M,
            velocity=_HELD_M,
            attitude=start_std_rad,
            gyro_bias=gyro_bias_std_radps,
            accel_bias=accel_bias_std_mps2,
        )
        self._filter = self._begun(IDENTITY, NO_BIAS)
        self._gravity_due_s = self._field_due_s = 0.0

    @property
    def quaternion_ned_frd(self) -> Quaternion:
        """The attitude now, towards true north."""
        return quaternion_from_rotation(self._filter.estimate.rotation_ned_frd)

    @property
    def gyro_bias_frd_radps(self) -> Vector:
        """The estimated bias."""
        x, y, z = (float(value) for value in self._filter.estimate.block("gyro_bias"))
        return x, y, z

    @property
    def std_ned_rad(self) -> Vector:
        """One sigma of the attitude about north, east and down: tilt, tilt, heading."""
        north, east, down = (float(value) for value in self._filter.std("attitude"))
        return north, east, down

    def initialise(self, quaternion_ned_frd: Quaternion, gyro_bias_frd_radps: Vector = NO_BIAS) -> None:
        """Begin at a known attitude and bias."""
        self._filter = self._begun(quaternion_ned_frd, gyro_bias_frd_radps)
        self._gravity_due_s = self._field_due_s = 0.0

    def update(
        self,
        angular_rate_frd_radps: Sequence[float],
        specific_force_frd_mps2: Sequence[float],
        magnetic_field_frd: Sequence[float] | None,
        interval_s: float,
    ) -> Quaternion:
        """One sample."""
        if not usable(angular_rate_frd_radps, interval_s):
            return self.quaternion_ned_frd
        ekf = self._filter
        force = np.asarray(specific_force_frd_mps2, np.float64)
        felt = bool(np.isfinite(force).all()) and bool(force.any())
        if not felt:  # the rate alone: a vehicle at rest would feel this
            force = -ekf.estimate.rotation_ned_frd[2] * ekf.process.earth.gravity_mps2
        now_s = ekf.at_s + interval_s
        rate = np.asarray(angular_rate_frd_radps, np.float64)
        ekf.predict_strapdown(ImuSample(now_s, interval_s, force, rate))
        if felt and now_s >= self._gravity_due_s:
            self._gravity_due_s = now_s + self._every_s[0]
            gravity_mps2 = ekf.process.earth.gravity_mps2
            ekf.update(GravityDirection(now_s, force, gravity_mps2, std_mps2=self._gravity_std_mps2))
            ekf.reset_block("position", np.zeros(3), _HELD_M)
            ekf.reset_block("velocity", np.zeros(3), _HELD_M)
        if now_s >= self._field_due_s and magnetic_field_frd is not None and direction(magnetic_field_frd) is not None:
            self._field_due_s = now_s + self._every_s[1]
            ekf.update(MagneticField(now_s, magnetic_field_frd, self._declination_rad, self._field_std_rad))
        return self.quaternion_ned_frd

    def _begun(self, quaternion: Quaternion, bias: Vector) -> ErrorStateFilter:
        estimate = NavEstimate(
            _LAYOUT, 0.0, rotation_ned_frd=rotation_from_quaternion(np.array(normalised(quaternion)))
        )
        estimate.block("gyro_bias")[:] = bias
        return ErrorStateFilter(estimate, self._start_std, self._noise)
