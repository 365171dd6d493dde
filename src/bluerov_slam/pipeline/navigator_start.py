"""From nothing to a filter: which way is down and where is north, and how little else is known."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.navigation_aid import BEACON, MOUNTING, WANDER
from bluerov_slam.navigation.attitude.initial import initial_attitude
from bluerov_slam.navigation.ekf import ErrorStateFilter
from bluerov_slam.navigation.process import Earth, ProcessNoise
from bluerov_slam.navigation.rotation import rotation_from_euler, rotation_from_quaternion
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.navigator_fix import FIX_WANDER
from bluerov_slam.pipeline.navigator_words import Fault

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.attitude.calibration import Calibration
    from bluerov_slam.navigation.measurements import SensorAngles
    from bluerov_slam.navigation.process import ImuSample
    from bluerov_slam.pipeline.navigator_options import NavigatorOptions

    Array = NDArray[np.float64]

THRUSTER_FIELD = "thruster_field"
# What the first attitude is made from: enough to average samples of 20 Hz, short enough not to be waited for.
START_S = 1.0
START_AT_LEAST = 3
# The vertical averaged over one second in waves, and an accelerometer's own error.
LEAST_TILT_STD_RAD = math.radians(1.5)
# Before the first heading. Not larger: what follows is linear.
UNKNOWN_HEADING_STD_RAD = 1.0
UPRIGHT_STD_RAD = math.radians(15.0)
UNKNOWN_POSITION_STD_M = 1000.0
UNKNOWN_DEPTH_STD_M = 10.0  # the first pressure says it at once
UNKNOWN_VELOCITY_STD_MPS = 0.5
UNKNOWN_DECLINATION_STD_RAD = math.radians(10.0)
# A calibrated gyro's bias has moved since.
GYRO_SINCE_CALIBRATION_RADPS = math.radians(0.05)
LEVEL_WITHIN = 0.5  # of gravity along the vertical axis: more than 60 deg of tilt is a matter of mounting


@dataclass(frozen=True, slots=True)
class NavigatorNoise(ProcessNoise):
    """The filter's process noise with the slow error of position fixes beside that of GPS: in units of what the fixes'
    source states.
    """

    fix_wander_time_s: float = 30.0
    direction_wander_std_rad: float = 0.0
    direction_wander_time_s: float = 300.0

    def wanders(self) -> tuple[tuple[str, float, float], ...]:
        """Gauss-Markov blocks: name, standard deviation at rest, correlation time in seconds."""
        # The base class is named: a class with slots is made anew by `dataclass`, so that super() would not find it.
        return (
            *ProcessNoise.wanders(self),
            (FIX_WANDER, 1.0, self.fix_wander_time_s),
            (WANDER, self.direction_wander_std_rad, self.direction_wander_time_s),
        )


_EXTRA = ((FIX_WANDER, 2), (THRUSTER_FIELD, 2))
LAYOUT = StateLayout.make(without=("sound_speed_scale",), extra=_EXTRA)
"""No ranges are measured yet, so the sound speed's scale is left out."""
ACOUSTIC_LAYOUT = StateLayout.make(extra=(*_EXTRA, (MOUNTING, 3), (WANDER, 3), (BEACON, 3)))
"""With an acoustic array, how it is really mounted, what turns its directions for minutes and where the transmitter
really is are states.
"""


@dataclass(frozen=True, slots=True)
class Start:
    """The first attitude. `tilt_std_rad` about north and east; the heading is taken from the next compass value."""

    at_s: float
    rotation_ned_frd: Array
    tilt_std_rad: float

    @property
    def std_rad(self) -> tuple[float, float, float]:
        """About north, east and down."""
        return self.tilt_std_rad, self.tilt_std_rad, UNKNOWN_HEADING_STD_RAD

    @classmethod
    def of_angles(cls, angles: SensorAngles) -> Start:
        """As a sensor that estimates its attitude itself has it."""
        rotation = rotation_from_euler(angles.roll_rad, angles.pitch_rad, angles.heading_rad or 0.0)
        return cls(angles.at_s, rotation, max(angles.tilt_std_rad, LEAST_TILT_STD_RAD))

    @classmethod
    def upright(cls, at_s: float) -> Start:
        """Without any sensor of attitude: an ROV floats upright."""
        return cls(at_s, np.eye(3), UPRIGHT_STD_RAD)


class StartUp:
    """Collects the first samples. `fault` says what keeps the attitude from being known."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, Array, Array | None]] = deque()
        self.fault: Fault | None = None

    def add(self, sample: ImuSample, field_frd: Array | None, declination_rad: float) -> Start | None:
        """One more; the start as soon as it can be made."""
        self._samples.append((sample.at_s, sample.specific_force_frd_mps2, field_frd))
        first_s = self._samples[0][0]
        if sample.at_s - first_s < START_S or len(self._samples) < START_AT_LEAST:
            return None
        forces = np.array([force for _, force, _ in self._samples])
        fields = [field for _, _, field in self._samples if field is not None]
        self._samples.popleft()
        self.fault = mounting_fault(forces.mean(axis=0))
        if self.fault is not None:
            return None
        attitude = initial_attitude(forces, np.array(fields) if fields else None, declination_rad)
        if attitude is None:
            return None
        rotation = rotation_from_quaternion(attitude.quaternion_ned_frd)
        return Start(sample.at_s, rotation, max(attitude.tilt_std_rad, LEAST_TILT_STD_RAD))

    def clear(self) -> None:
        """Begin again."""
        self._samples.clear()
        self.fault = None


def mounting_fault(force_frd_mps2: Array) -> Fault | None:
    """Whether the mean specific force says that body "down" is not down. At rest it points up: (0, 0, -g)."""
    down = -float(force_frd_mps2[2]) / max(float(np.sqrt(force_frd_mps2 @ force_frd_mps2)), 1e-9)
    if down < -LEVEL_WITHIN:
        return Fault.IMU_UPSIDE_DOWN
    return Fault.IMU_ON_ITS_SIDE if down < LEVEL_WITHIN else None


def process_noise(options: NavigatorOptions) -> NavigatorNoise:
    """The options' figures as the filter names them."""
    imu, compass, gps, thrust, fix = options.imu, options.compass, options.gps, options.thrust, options.fix
    acoustics = options.acoustics or AcousticOptions()
    return NavigatorNoise(
        accel_noise_mps_per_sqrt_s=imu.accelerometer_noise_mps2,
        gyro_noise_rad_per_sqrt_s=imu.gyro_noise_radps,
        gyro_bias_walk_radps_per_sqrt_s=imu.gyro_bias_walk_radps,
        accel_bias_walk_mps2_per_sqrt_s=imu.accelerometer_bias_walk_mps2,
        current_walk_mps_per_sqrt_s=thrust.current_walk_mps,
        thrust_scale_walk_per_sqrt_s=thrust.scale_walk,
        compass_walk_rad_per_sqrt_s=compass.deviation_walk_rad,
        compass_wander_std_rad=compass.wander_std_rad,
        compass_wander_time_s=compass.wander_time_s,
        gps_wander_std_m=gps.std_m_per_hdop * math.sqrt(1.0 - gps.white_share**2),
        gps_wander_time_s=gps.wander_time_s,
        depth_bias_walk_m_per_sqrt_s=options.depth.bias_walk_m,
        dvl_scale_walk_per_sqrt_s=options.dvl.walk,
        dvl_yaw_walk_rad_per_sqrt_s=options.dvl.walk,
        fix_wander_time_s=fix.wander_time_s,
        direction_wander_std_rad=acoustics.wander_std_rad,
        direction_wander_time_s=acoustics.wander_time_s,
    )


def compass_prior(
    options: NavigatorOptions, calibration: Calibration, declination_known: bool
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Deviation A, B, C and their standard deviations before anything was seen."""
    values, std = (0.0, 0.0, 0.0), options.compass.uncalibrated_deviation_std_rad
    if calibration.magnetometer is not None or options.compass.calibrated_in_sensor:
        std = options.compass.deviation_std_rad
    if calibration.compass is not None:
        swing = calibration.compass
        values = (swing.a_rad, swing.b_rad, swing.c_rad)
        least = options.compass.swung_std_rad
        std = (
            math.hypot(swing.std_rad[0], least),
            math.hypot(swing.std_rad[1], least),
            math.hypot(swing.std_rad[2], least),
        )
    if not declination_known:
        std = (math.hypot(std[0], UNKNOWN_DECLINATION_STD_RAD), std[1], std[2])
    return values, std


def thruster_field_std_rad(options: NavigatorOptions, calibration: Calibration) -> float:
    """What the thrusters' field may turn the compass by at full current."""
    share = 1.0 if calibration.thruster_field is None else options.compass.thruster_calibrated_share
    return options.compass.throttle_std_rad * share


def make_filter(
    start: Start,
    options: NavigatorOptions,
    calibration: Calibration,
    depth_m: float,
    depth_bias_std_m: float,
    latitude_deg: float | None,
) -> ErrorStateFilter:
    """A filter that knows its tilt and its depth and is honest about the rest."""
    compass, compass_std = compass_prior(options, calibration, latitude_deg is not None)
    layout = LAYOUT if options.acoustics is None else ACOUSTIC_LAYOUT
    estimate = NavEstimate(layout, start.at_s, start.rotation_ned_frd, position=(0.0, 0.0, depth_m), compass=compass)
    noise = process_noise(options)
    gyro_std: float | tuple[float, ...] = options.imu.gyro_bias_std_radps
    if calibration.gyro is not None:
        gyro_std = tuple(math.hypot(std, GYRO_SINCE_CALIBRATION_RADPS) for std in calibration.gyro.std_radps)
    std = layout.vector(
        position=(UNKNOWN_POSITION_STD_M, UNKNOWN_POSITION_STD_M, UNKNOWN_DEPTH_STD_M),
        velocity=(UNKNOWN_VELOCITY_STD_MPS, UNKNOWN_VELOCITY_STD_MPS, 0.2),
        attitude=(start.tilt_std_rad, start.tilt_std_rad, UNKNOWN_HEADING_STD_RAD),
        gyro_bias=gyro_std,
        accel_bias=options.imu.accelerometer_bias_std_mps2,
        current=options.thrust.current_std_mps,
        thrust_scale=options.thrust.scale_std,
        compass=compass_std,
        compass_wander=options.compass.wander_std_rad,
        thruster_field=thruster_field_std_rad(options, calibration),
        gps_wander=noise.gps_wander_std_m,
        depth_bias=depth_bias_std_m,
        dvl=(options.dvl.scale_std, options.dvl.yaw_std_rad),
        fix_wander=1.0,
        **_acoustic_std(options.acoustics),
    )
    return ErrorStateFilter(estimate, std, noise, None if latitude_deg is None else Earth(latitude_deg))


def _acoustic_std(options: AcousticOptions | None) -> dict[str, float | tuple[float, ...]]:
    """What is not known of an array and its transmitter to begin with."""
    if options is None:
        return {}
    return {
        MOUNTING: options.mounting_std_rad,
        WANDER: options.wander_std_rad,
        BEACON: (options.beacon_std_m, options.beacon_std_m, options.beacon_depth_std_m),
        "sound_speed_scale": options.sound_speed_std,
    }
