"""Every figure of the navigator that the vehicle itself does not measure.

The defaults are what somebody knows who has read datasheets and the literature; none is a figure of the simulator.
Where that leaves a range, tuning dives (seeds 0 to 99) had a say: in the IMU's noises, walks and latency, the compass's
period and the thrust scale's walk. Sources in short: [HWT905], [MS5837] the makers' registers and claims; [logs]
measured on autopilot logs of BlueROV2; [survey] the literature on vehicles without DVL; [choice] a decision of ours.
White noises are per root hertz, random walks per root second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from bluerov_slam.navigation.vehicle_model import BLUEROV2, ThrusterLayout
from bluerov_slam.pipeline.acoustic_options import AcousticOptions

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ImuOptions:
    """Inertial sensors, and how the vehicle may move while there are none."""

    # [survey] 0.005 to 0.01 deg/s and 0.0015 to 0.004 m/s2 per root hertz for a sensor of this class: its upper ends,
    # for the wire's steps and vibration come on top ([logs] of an autopilot, all included: 0.011 and 0.006 at least).
    gyro_noise_radps: float = math.radians(0.010)
    accelerometer_noise_mps2: float = 0.004
    # [survey] turn-on bias 0.1 to 1 deg/s before a calibration; instability 5 to 25 deg/h, here 12 within 4 minutes.
    gyro_bias_std_radps: float = math.radians(0.3)
    gyro_bias_walk_radps: float = 4e-6
    # [choice] what a turn leaves of a gyro's scale error and misalignment, 1 to 2 % of consumer sensors: half a turn
    # is wrong by 2 to 3 deg. Without it turns would teach the compass a deviation that it has not.
    gyro_scale_std: float = 0.012
    # [choice] and of axes that are not square, 0.5 % of consumer sensors: half a turn may tilt the estimate by 0.9 deg.
    gyro_cross_axis_std: float = 0.005
    # [survey] 2 to 10 mg after a six-face calibration; instability 30 to 100 ug, here 100 within a minute and a half.
    accelerometer_bias_std_mps2: float = 0.05
    accelerometer_bias_walk_mps2: float = 1e-4
    # [HWT905] claims 0.1 deg at its best. Errors that are no states, such as its axes in its case, are always added to
    # the stated error of roll and pitch.
    tilt_least_std_rad: float = math.radians(0.1)
    # Turns the readings of an IMU that is not mounted as the firmware assumes.
    mounting_rpy_deg: Vector = (0.0, 0.0, 0.0)
    # Age of a sample when it is stamped. [choice] a sensor that filters at 20 Hz lags by 8 ms, and by half a cycle.
    latency_s: float = 0.012
    silent_after_s: float = 0.5
    # The sensor's own angles. [HWT905] claims 0.1 deg in motion, but waves accelerate the vehicle; [survey] heading 2
    # to 5 deg.
    angle_tilt_std_rad: float = math.radians(1.0)
    angle_heading_std_rad: float = math.radians(3.0)
    # Without an IMU velocity and attitude walk. [logs] yaw rate 17 to 23 deg/s at the 95th percentile.
    kinematic_attitude_walk_rad: float = 0.35
    kinematic_velocity_walk_mps: float = 0.25  # while thrusters or a DVL tell the velocity
    # Where nothing does, it goes over into the water's within seconds, as an ROV stops and turns, [logs] with 0.5 m/s
    # rms per axis on lively dives and less on quiet ones: learned within these limits.
    kinematic_velocity_time_s: float = 4.0
    kinematic_speed_std_mps: float = 0.5
    kinematic_speed_limits_mps: tuple[float, float] = (0.15, 0.7)
    # [choice] a pilot holds a course for a minute or two. Then current and course look the same, and the current stands
    # for both: it wanders until it is as unknown as a current may be.
    kinematic_course_walk_mps: float = 0.016
    # What is left when nothing was measured for longer: adrift with a current, 0.46 m/s rms that last.
    adrift_after_s: float = 30.0
    adrift_velocity_walk_mps: float = 0.12
    adrift_velocity_time_s: float = 30.0


@dataclass(frozen=True, slots=True)
class CompassOptions:
    """Heading from the magnetometer: true + A + B cos + C sin + wander + white noise."""

    # [HWT905] sample to sample 0.1 to 0.2 deg, [survey] 2 deg with all that a moving vehicle adds; learned between 0.1
    # and 4 deg.
    std_rad: float = math.radians(1.0)
    # [survey] 3 deg in total over A, B, C after a calibration.
    deviation_std_rad: Vector = (math.radians(1.75), math.radians(1.75), math.radians(1.75))
    # The sensor was calibrated with its maker's program and holds the result itself: no calibration of ours is needed.
    calibrated_in_sensor: bool = False
    # [choice] without any: hard iron of a tenth to a fifth of the horizontal field.
    uncalibrated_deviation_std_rad: Vector = (math.radians(5.0), math.radians(12.0), math.radians(12.0))
    swung_std_rad: float = math.radians(0.5)  # [choice] what a compass swing leaves beside its own stated error
    deviation_walk_rad: float = 2e-5
    wander_std_rad: float = math.radians(1.0)  # [survey]
    wander_time_s: float = 300.0  # [survey]
    # [choice] about twice what a moving vehicle shows: strength as a share, dip as an angle.
    norm_tolerance: float = 0.2
    dip_tolerance_rad: float = math.radians(10.0)
    # [survey] 2 to 10 deg beside servos and power leads, with all thrusters at full current; a state of its own.
    throttle_std_rad: float = math.radians(4.0)
    thruster_calibrated_share: float = 0.35  # [choice] what a calibration of the thruster field leaves of it
    # [choice] readings are this far apart, and those for the filter: the field of cables and motors changes with the
    # sticks, within seconds, so that nearer values share their error. A swing needs them closer.
    period_s: float = 0.5
    filter_period_s: float = 2.0


@dataclass(frozen=True, slots=True)
class DepthOptions:
    """Depth from absolute pressure."""

    std_m: float = 0.02  # [MS5837] 2 mm resolution, [logs] 0.2 mbar from sample to sample; waves above it move more
    bias_std_m: float = 0.15  # [choice] zeroed by itself: floating or on the deck is not known
    zeroed_bias_std_m: float = 0.05  # [choice] zeroed by the user
    unzeroed_bias_std_m: float = 0.5  # [MS5837] absolute accuracy 50 mbar
    bias_walk_m: float = 1e-4  # weather and tide, 1 cm in 3 hours
    density_relative_std: float = 0.016  # 997 to 1029 kg/m3 while no salinity was measured
    # What counts as air or the first decimetres of water when the surface pressure is taken by itself.
    surface_pressure_range_pa: tuple[float, float] = (95_000.0, 107_000.0)
    latency_s: float = 0.02
    period_s: float = 0.4


@dataclass(frozen=True, slots=True)
class GpsOptions:
    """GPS at the surface."""

    std_m_per_hdop: float = 1.5  # [survey] 1.5 to 3 m standalone, per axis
    unknown_hdop: float = 2.0
    white_share: float = 0.3  # of the standard deviation: what changes from one fix to the next
    wander_time_s: float = 60.0  # [survey] how long the rest lasts
    depth_limit_m: float = 0.3  # [survey] below it the antenna is awash
    hdop_limit: float = 5.0
    age_limit_s: float = 2.0
    consistent_fixes: int = 3
    consistent_within_m: float = 10.0
    consistent_speed_mps: float = 3.0
    # [choice] a refused position that stays by itself for so long is believed, with a reset: longer than any multipath.
    jump_persists_s: float = 20.0
    latency_s: float = 0.1
    period_s: float = 0.9
    lever_arm_frd_m: Vector = (0.0, 0.0, -0.15)
    # [survey] receivers claim 0.05 m/s per axis, more in waves, whose motion they smooth; learned between half and four
    # times this.
    velocity_std_mps: float = 0.07


@dataclass(frozen=True, slots=True)
class FixOptions:
    """Positions from outside the link: acoustics, an imported log."""

    std_m: float = 1.5  # where the source states none
    # [survey] jitter of centimetres, slow errors of 1 to 8 m: most of the error lasts from fix to fix.
    white_share: float = 0.4
    wander_time_s: float = 30.0
    # [choice] refused fixes that agree with each other for so long are believed, with a reset: what the vehicle itself
    # measures leads it astray by a few metres in half a minute, where it measures nothing by ten within ten seconds.
    jump_persists_s: float = 30.0
    jump_persists_unaided_s: float = 10.0
    latency_s: float = 0.0
    lever_arm_frd_m: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ThrustOptions:
    """Velocity through water from the thruster model, and the current."""

    layout: ThrusterLayout | None = BLUEROV2  # None: another vehicle, its thrusters tell nothing
    noise_mps: float = 0.05  # [survey] per root second: gusts, tether, wash
    scale_std: tuple[float, float] = (0.10, 0.05)  # [survey] 20 % of thrust is 11 % of speed; sway half
    # [choice] 6 % in half an hour: another speed, another part of the thrusters' curve, tether, battery, fouling.
    scale_walk: float = 1.5e-3
    current_std_mps: float = 0.2  # [survey] 0.05 to 0.4 m/s
    # [survey] 0.0005 to 0.003, upper half: this state stands for all that is slow in the velocity through the water,
    # the cable's pull and unequal thrusters, too (10 to 20 mm/s that last for minutes on tuning dives).
    current_walk_mps: float = 2e-3
    stale_after_s: float = 0.6
    battery_stale_after_s: float = 30.0
    # [choice] eddies and the model's transients last some seconds: values nearer together share their error. Where no
    # IMU bridges the time, more of them are needed all the same.
    period_s: float = 4.0
    period_without_imu_s: float = 0.5
    # Where nothing measures velocity, drag still holds an ROV below about 1 m/s: one opinion in so many seconds.
    speed_prior_std_mps: float = 0.5
    speed_prior_time_s: float = 20.0


@dataclass(frozen=True, slots=True)
class DvlOptions:
    """A DVL, heard as VISION_POSITION_DELTA."""

    std_mps: float = 0.015  # [survey] 1.0 to 1.7 cm/s at 5 Hz
    std_per_mps: float = 0.003
    scale_std: float = 0.003  # [survey] 0.1 to 0.5 %
    yaw_std_rad: float = math.radians(0.5)  # what a user can align
    walk: float = 1e-6
    bad_below_percent: float = 20.0
    lever_arm_frd_m: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class NavigatorOptions:
    """All of them."""

    imu: ImuOptions = ImuOptions()
    compass: CompassOptions = CompassOptions()
    depth: DepthOptions = DepthOptions()
    gps: GpsOptions = GpsOptions()
    fix: FixOptions = FixOptions()
    thrust: ThrustOptions = ThrustOptions()
    dvl: DvlOptions = DvlOptions()
    aided_age_s: float = 10.0  # a fix younger than this is "aided"
    # [choice] without any motion sensor for so long an ROV may be anywhere within a hundred metres: nothing is stated.
    unknown_after_s: float = 60.0
    # A correction beyond these counts up `reset_counter`. A controller that knows how uncertain the position is follows
    # a small share of that by itself: the position's limit grows with its stated standard deviation.
    jump_m: float = 1.0
    jump_share_of_std: float = 0.25
    jump_heading_rad: float = math.radians(10.0)
    save_limit_s: float = 3600.0  # a saved state older than this is not taken up
    resume_speed_mps: float = 0.6  # how fast the vehicle may have moved while nobody looked
    origin_deg: tuple[float, float] | None = None  # else the first fix
    declination_rad: float | None = None  # else the model's at the first fix, 0 +- 10 deg before it
    gate_probability: float = 0.999
    acoustics: AcousticOptions | None = None  # None: no array is fitted
