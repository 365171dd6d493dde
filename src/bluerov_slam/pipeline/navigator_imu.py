"""From IMU bursts to strapdown samples; from an IMU's or an autopilot's own angles to an attitude measurement."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.measurements import SensorAngles
from bluerov_slam.navigation.process import ImuSample
from bluerov_slam.navigation.rotation import euler_from_rotation, rotation_from_euler
from bluerov_slam.pipeline.navigator_watch import FrozenWatch, TimeWatch, all_finite
from bluerov_slam.pipeline.navigator_words import Fault

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.attitude.calibration import Calibration
    from bluerov_slam.pipeline.navigator_options import ImuOptions
    from bluerov_slam.pipeline.navigator_sensors import SensorStatus
    from bluerov_slam.records import ImuBurst, SensorSample, VehicleAttitude

    Array = NDArray[np.float64]

STANDARD_GRAVITY_MPS2 = 9.80665
# HWT905: the last count of 16 g and 2000 deg/s stands for everything beyond.
ACCELERATION_END_MPS2 = 15.99 * STANDARD_GRAVITY_MPS2
RATE_END_RADPS = math.radians(1999.0)
# A vehicle in water feels gravity; free fall and the centrifuge do not happen to it.
GRAVITY_FELT_MPS2 = (2.0, 40.0)
FROZEN_AFTER_S = 1.0
FROZEN_AT_LEAST = 8
ANGLES_FROZEN_AFTER_S = 10.0
ANGLES_FROZEN_AT_LEAST = 20
# Interpolating between samples is better than knowing nothing: up to here a gap is bridged by its two ends.
LONGEST_BRIDGE_S = 0.4
# A burst repeats no sample: what lies closer to the last one than this part of the interval has been seen.
NEW_SHARE = 0.25


class ImuIntake:
    """Raw samples in body FRD, as the firmware mounts them and the options turn them."""

    def __init__(self, options: ImuOptions, status: SensorStatus) -> None:
        self._options = options
        self._status = status
        roll, pitch, yaw = (math.radians(angle) for angle in options.mounting_rpy_deg)
        self._mounting = rotation_from_euler(roll, pitch, yaw)
        self._is_turned = any(options.mounting_rpy_deg)
        self._times = TimeWatch(5.0)
        self._angle_times = TimeWatch(2.0)
        self._frozen = FrozenWatch(FROZEN_AFTER_S, FROZEN_AT_LEAST)
        self._angles_frozen = FrozenWatch(ANGLES_FROZEN_AFTER_S, ANGLES_FROZEN_AT_LEAST)
        self._last_s = -math.inf
        self._last: Array | None = None

    def mounted(self, vectors_frd: Array) -> Array:
        """Vectors (n, 3) of the IMU in the vehicle's axes."""
        return vectors_frd @ self._mounting.T if self._is_turned else vectors_frd

    def burst(self, record: ImuBurst, calibration: Calibration) -> list[ImuSample]:
        """Its samples that are new and sound, each the mean over the interval that ends at it."""
        self._status.hear(record.arrived_s)
        fault = self._times.check(record.measured_s, record.arrived_s)
        if fault is Fault.REPEATED_TIME and not self._times.hangs:
            return []
        readings = np.hstack((record.acceleration_mps2, record.angular_rate_radps))
        if fault is None:
            fault = self._fault_of(readings, record)
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return []
        force = calibration.specific_force(self.mounted(record.acceleration_mps2))
        rate = calibration.angular_rate(self.mounted(record.angular_rate_radps))
        readings = np.hstack((force, rate))
        first_s = record.measured_s - self._options.latency_s
        samples = []
        for k, reading in enumerate(readings):
            sample = self._sample(first_s + k * record.interval_s, record.interval_s, reading)
            if sample is not None:
                samples.append(sample)
        return samples

    def angles(self, record: SensorSample, declination_rad: float) -> SensorAngles | None:
        """The sensor's own angles of a SENSORS frame; its yaw is magnetic."""
        roll, pitch, yaw = record.roll_rad, record.pitch_rad, record.yaw_rad
        if roll is None or pitch is None or yaw is None or not record.imu_alive:
            return None
        self._status.hear(record.arrived_s)
        fault = self._angle_times.check(record.measured_s, record.arrived_s)
        if fault is Fault.REPEATED_TIME and not self._angle_times.hangs:
            return None
        if not all_finite((roll, pitch, yaw)):
            fault = Fault.NOT_A_NUMBER
        elif self._angles_frozen.check((roll, pitch, yaw, record.acceleration_frd_mps2), record.measured_s):
            fault = Fault.FROZEN
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return None
        at_s = record.measured_s - self._options.latency_s
        return self._angles(at_s, roll, pitch, yaw + declination_rad, self._is_turned)

    def autopilot(self, record: VehicleAttitude, measured_s: float) -> SensorAngles | None:
        """The autopilot's attitude, where the link has no IMU; its yaw is true."""
        self._status.hear(record.arrived_s)
        fault = self._angle_times.check(measured_s, record.arrived_s)
        if fault is Fault.REPEATED_TIME and not self._angle_times.hangs:
            return None
        if not all_finite((record.roll_rad, record.pitch_rad, record.yaw_rad)):
            fault = Fault.NOT_A_NUMBER
        elif self._angles_frozen.check(
            (record.roll_rad, record.pitch_rad, record.yaw_rad, record.angular_rate_frd_radps), measured_s
        ):
            fault = Fault.FROZEN
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return None
        return self._angles(measured_s, record.roll_rad, record.pitch_rad, record.yaw_rad, False)

    def _angles(self, at_s: float, roll: float, pitch: float, heading: float, turned: bool) -> SensorAngles:
        if turned:
            rotation = rotation_from_euler(roll, pitch, heading) @ self._mounting.T
            roll, pitch, heading = euler_from_rotation(rotation)
        options = self._options
        return SensorAngles(
            at_s,
            roll,
            pitch,
            heading,
            options.angle_tilt_std_rad,
            options.angle_heading_std_rad,
        )

    def _fault_of(self, readings: Array, record: ImuBurst) -> Fault | None:
        if not (record.interval_s > 0.0 and math.isfinite(record.interval_s)):
            return Fault.REPEATED_TIME
        if not np.isfinite(readings).all():
            return Fault.NOT_A_NUMBER
        frozen = False
        for k, reading in enumerate(readings):
            frozen = self._frozen.check(reading.tobytes(), record.measured_s + k * record.interval_s)
        if frozen:
            return Fault.FROZEN
        felt = float(np.sqrt((readings[:, :3] ** 2).sum(axis=1)).mean())
        low, high = GRAVITY_FELT_MPS2
        if np.abs(readings[:, :3]).max() >= ACCELERATION_END_MPS2 or np.abs(readings[:, 3:]).max() >= RATE_END_RADPS:
            return Fault.SATURATED
        return None if low <= felt <= high else Fault.IMPOSSIBLE

    def _sample(self, at_s: float, interval_s: float, reading: Array) -> ImuSample | None:
        since_s = at_s - self._last_s
        if since_s < NEW_SHARE * interval_s:
            return None
        before, self._last, self._last_s = self._last, reading, at_s
        if before is None or since_s > LONGEST_BRIDGE_S:
            return ImuSample(at_s, interval_s, reading[:3], reading[3:])
        mean = 0.5 * (before + reading)
        return ImuSample(at_s, since_s, mean[:3], mean[3:])
