"""What each sensor says about the state: residual, Jacobian and noise.

Every class is one value of one sensor with what is known about its mounting and noise. World is NED, body is FRD; lever
arms run from the vehicle's origin to the sensor, in FRD. An optional state (a bias, a scale, a wander) that the layout
lacks is taken as zero. With the attitude's error e on the left, R_true = Exp(e) R, the first-order changes are

    R u          ->  e x (R u)     = -[R u] e
    R' w         ->  -R' (e x w)   =  R' [w] e

where [.] is the matrix of the cross product.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.navigation.ekf import Innovation
from bluerov_slam.navigation.process import EARTH_RATE_RADPS
from bluerov_slam.navigation.rotation import (
    cross,
    left_jacobian_inverse,
    log_so3,
    right_jacobian_inverse,
    rotation_from_euler,
    skew,
    wrap_angle,
)
from bluerov_slam.navigation.state import ATTITUDE, VELOCITY, NavEstimate, StateLayout

Array = NDArray[np.float64]

NO_LEVER_M = (0.0, 0.0, 0.0)

STEEPEST_LEVEL = 0.2
"""A heading means nothing when less than this part of the bow's direction is level (steeper than 78 deg)."""


@dataclass(frozen=True, slots=True)
class HorizontalPosition:
    """North and east of the sensor (m, NED about the origin): GPS, an acoustic system, an operator's click.

    `wanders`: the source has slow errors of the size the layout's `gps_wander` describes (GPS has, others rarely).
    """

    at_s: float
    north_m: float
    east_m: float
    covariance_m2: Array  # (2, 2)
    sensor: str = "gps"
    lever_arm_frd_m: ArrayLike = NO_LEVER_M
    wanders: bool = True

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = (p + R l + wander) north, east."""
        lever = estimate.rotation_ned_frd @ np.asarray(self.lever_arm_frd_m, dtype=np.float64)
        jacobian = np.zeros((2, layout.size))
        jacobian[0, 0] = jacobian[1, 1] = 1.0
        jacobian[:, ATTITUDE] = -skew(lever)[:2]
        predicted = estimate.position_ned_m[:2] + lever[:2]
        if self.wanders and "gps_wander" in layout:
            place = layout["gps_wander"]
            jacobian[0, place.start] = jacobian[1, place.start + 1] = 1.0
            predicted = predicted + estimate.values[place]
        return Innovation(np.array((self.north_m, self.east_m)) - predicted, jacobian, self.covariance_m2)


@dataclass(frozen=True, slots=True)
class HorizontalVelocity:
    """North and east velocity of the sensor over ground (m/s, NED), such as speed and course of a GPS.

    `angular_rate_frd_radps` is the gyro's, bias and all; needed where there is a lever arm.
    """

    at_s: float
    north_mps: float
    east_mps: float
    covariance_m2ps2: Array  # (2, 2)
    sensor: str = "gps"
    lever_arm_frd_m: ArrayLike = NO_LEVER_M
    angular_rate_frd_radps: ArrayLike = (0.0, 0.0, 0.0)

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = (v + R (w x l)) north, east."""
        lever = np.asarray(self.lever_arm_frd_m, dtype=np.float64)
        swing = estimate.rotation_ned_frd @ cross(_rate(self.angular_rate_frd_radps, estimate, layout), lever)
        jacobian = np.zeros((2, layout.size))
        jacobian[0, 3] = jacobian[1, 4] = 1.0
        jacobian[:, ATTITUDE] = -skew(swing)[:2]
        if "gyro_bias" in layout:
            jacobian[:, layout["gyro_bias"]] = (estimate.rotation_ned_frd @ skew(lever))[:2]
        residual = np.array((self.north_mps, self.east_mps)) - (estimate.velocity_ned_mps + swing)[:2]
        return Innovation(residual, jacobian, self.covariance_m2ps2)


@dataclass(frozen=True, slots=True)
class Depth:
    """Depth of the pressure sensor below the surface (m)."""

    at_s: float
    depth_m: float
    std_m: float
    sensor: str = "depth"
    lever_arm_frd_m: ArrayLike = NO_LEVER_M

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = (p + R l) down + bias."""
        lever = estimate.rotation_ned_frd @ np.asarray(self.lever_arm_frd_m, dtype=np.float64)
        jacobian = np.zeros((1, layout.size))
        jacobian[0, 2] = 1.0
        jacobian[0, 6], jacobian[0, 7] = lever[1], -lever[0]
        predicted = float(estimate.values[2] + lever[2])
        if "depth_bias" in layout:
            place = layout["depth_bias"].start
            jacobian[0, place] = 1.0
            predicted += float(estimate.values[place])
        return Innovation(np.array([self.depth_m - predicted]), jacobian, np.array([[self.std_m**2]]))


@dataclass(frozen=True, slots=True)
class CompassHeading:
    """Heading of a compass (rad, true north: declination already added) that levels itself."""

    at_s: float
    heading_rad: float
    std_rad: float
    sensor: str = "compass"

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = heading + A + B cos + C sin + wander; None with the bow nearly straight up or down."""
        heading = _Heading.of(estimate)
        if heading is None:
            return None
        deviation, jacobian = _deviation(heading, estimate, layout)
        jacobian[0, ATTITUDE] += heading.by_attitude
        residual = wrap_angle(self.heading_rad - heading.angle_rad - deviation)
        return Innovation(np.array([residual]), jacobian, np.array([[self.std_rad**2]]))


@dataclass(frozen=True, slots=True)
class MagneticField:
    """Direction of the earth's field in the body (FRD, calibrated, any length): a heading the filter levels itself.

    Unlike with `CompassHeading` the filter knows how an error of its roll and pitch turns the levelled field.
    `thruster_load` is the share of full current that the thrusters draw: their field, fixed to the hull, adds that
    share of the block `thruster_field` (rad at full current) to B and C.
    """

    at_s: float
    field_frd: ArrayLike
    declination_rad: float
    std_rad: float
    sensor: str = "compass"
    thruster_load: float = 0.0

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """Azimuth of R m = declination - (A + B cos + C sin + wander) where R is right; B, C grow with the load."""
        heading = _Heading.of(estimate)
        north, east, down = (estimate.rotation_ned_frd @ np.asarray(self.field_frd, dtype=np.float64)).tolist()
        level = north * north + east * east
        if heading is None or not level > 0.01 * (level + down * down):
            return None
        deviation, jacobian = _deviation(heading, estimate, layout, self.thruster_load)
        jacobian[0, 6] -= down * north / level
        jacobian[0, 7] -= down * east / level
        jacobian[0, 8] += 1.0
        residual = wrap_angle(self.declination_rad - math.atan2(east, north) - deviation)
        return Innovation(np.array([residual]), jacobian, np.array([[self.std_rad**2]]))


@dataclass(frozen=True, slots=True)
class GravityDirection:
    """Specific force (m/s2, FRD) of a vehicle whose acceleration is known (zero, or what a vehicle model says).

    The noise grows with how much |force| differs from gravity: `std` + `std_per_excess` times the difference.
    Neighbouring values share waves and manoeuvres: use a few a second at most.
    """

    at_s: float
    specific_force_frd_mps2: ArrayLike
    gravity_mps2: float
    std_mps2: float = 0.3
    std_per_excess: float = 2.0
    acceleration_frd_mps2: ArrayLike = (0.0, 0.0, 0.0)
    sensor: str = "imu"

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = R' (0, 0, -g) + acceleration + bias."""
        up_ned = np.array((0.0, 0.0, -self.gravity_mps2))
        rotation_frd_ned = estimate.rotation_ned_frd.T
        jacobian = np.zeros((3, layout.size))
        jacobian[:, ATTITUDE] = rotation_frd_ned @ skew(up_ned)
        force = np.asarray(self.specific_force_frd_mps2, dtype=np.float64)
        acceleration = np.asarray(self.acceleration_frd_mps2, dtype=np.float64)
        if "accel_bias" in layout:
            place = layout["accel_bias"]
            jacobian[:, place] = np.eye(3)
            force = force - estimate.values[place]
        static = force - acceleration
        excess = abs(math.sqrt(float(static @ static)) - self.gravity_mps2)
        std = self.std_mps2 + self.std_per_excess * excess
        return Innovation(static - rotation_frd_ned @ up_ned, jacobian, std * std * np.eye(3))


@dataclass(frozen=True, slots=True)
class SensorAngles:
    """Roll, pitch and, if it has one, heading (rad, true north) of a sensor or autopilot that estimates them itself.

    Its heading is a compass's and takes the compass's deviation. Without a heading two components remain.
    """

    at_s: float
    roll_rad: float
    pitch_rad: float
    heading_rad: float | None
    tilt_std_rad: float
    heading_std_rad: float = math.radians(3.0)
    sensor: str = "imu"

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """Log(Rz(-deviation) R_z R') = error, in NED; without a heading where R sees the measured vertical."""
        rotation = estimate.rotation_ned_frd
        heading = _Heading.of(estimate)
        if self.heading_rad is None or heading is None:
            return self._tilt(rotation, layout)
        deviation, compass = _deviation(heading, estimate, layout)
        true_heading = self.heading_rad - deviation
        error = log_so3(rotation_from_euler(self.roll_rad, self.pitch_rad, true_heading) @ rotation.T)
        # The deviation is a turn about NED's vertical, left of the measured rotation.
        by_error = right_jacobian_inverse(error)
        by_deviation = left_jacobian_inverse(error)[:, 2:]
        jacobian = by_deviation @ compass
        jacobian[:, ATTITUDE] += by_error
        noise = np.diag((self.tilt_std_rad**2, self.tilt_std_rad**2, self.heading_std_rad**2))
        return Innovation(error, jacobian, noise)

    def _tilt(self, rotation: Array, layout: StateLayout) -> Innovation:
        sine, cosine = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        vertical_frd = np.array((-sine, math.sin(self.roll_rad) * cosine, math.cos(self.roll_rad) * cosine))
        north, east, down = (rotation @ vertical_frd).tolist()
        jacobian = np.zeros((2, layout.size))
        jacobian[:, ATTITUDE] = ((0.0, -down, east), (down, 0.0, -north))
        return Innovation(np.array((north, east)), jacobian, self.tilt_std_rad**2 * np.eye(2))


@dataclass(frozen=True, slots=True)
class WaterVelocity:
    """Velocity through the water (m/s, FRD) as a vehicle model has it: surge, sway and, if known, heave.

    True velocity through water = (1 + thrust_scale) x the model's. The current has no vertical part. `steady_frd_mps`
    (2,) is what the scale is learned from (`steady_velocity` says why); without it, the velocity itself. What a wrong
    scale makes of the rest is an error that the Jacobian does not show: `std_mps` has to hold it.
    """

    at_s: float
    velocity_frd_mps: ArrayLike  # (2,) or (3,)
    std_mps: ArrayLike  # of each component
    sensor: str = "thrust"
    steady_frd_mps: ArrayLike | None = None

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """(1 + s) u = R' (v - current)."""
        model = np.asarray(self.velocity_frd_mps, dtype=np.float64)
        count = len(model)
        rotation_frd_ned = estimate.rotation_ned_frd.T[:count]
        through_water_ned = estimate.velocity_ned_mps.copy()
        jacobian = np.zeros((count, layout.size))
        if "current" in layout:
            place = layout["current"]
            through_water_ned[:2] -= estimate.values[place]
            jacobian[:, place] = -rotation_frd_ned[:, :2]
        jacobian[:, VELOCITY] = rotation_frd_ned
        jacobian[:, ATTITUDE] = rotation_frd_ned @ skew(through_water_ned)
        scaled = model.copy()
        if "thrust_scale" in layout:
            place = layout["thrust_scale"]
            scaled[:2] *= 1.0 + estimate.values[place]
            steady = model if self.steady_frd_mps is None else np.asarray(self.steady_frd_mps, dtype=np.float64)
            jacobian[0, place.start], jacobian[1, place.start + 1] = -steady[0], -steady[1]
        std = np.broadcast_to(np.asarray(self.std_mps, dtype=np.float64), (count,))
        return Innovation(scaled - rotation_frd_ned @ through_water_ned, jacobian, np.diag(std * std))


@dataclass(frozen=True, slots=True)
class GroundVelocity:
    """Velocity over ground in the instrument's axes (m/s), such as a DVL's bottom track, nominally along FRD.

    The instrument reads (1 + scale) times the truth and is turned by the mounting yaw from the body's axes (positive:
    its x axis points to starboard of the bow). `angular_rate_frd_radps` is the gyro's, bias and all. `steady_frd_mps`
    (2,) is what scale and yaw are learned from (`steady_velocity` says why); without it, the estimated velocity.
    """

    at_s: float
    velocity_frd_mps: ArrayLike  # (3,)
    covariance_m2ps2: Array  # (3, 3)
    angular_rate_frd_radps: ArrayLike = (0.0, 0.0, 0.0)
    lever_arm_frd_m: ArrayLike = NO_LEVER_M
    sensor: str = "dvl"
    steady_frd_mps: ArrayLike | None = None

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = (1 + scale) Rz(yaw)' (R' v + w x l)."""
        rotation_frd_ned = estimate.rotation_ned_frd.T
        lever = np.asarray(self.lever_arm_frd_m, dtype=np.float64)
        rate = _rate(self.angular_rate_frd_radps, estimate, layout)
        body = rotation_frd_ned @ estimate.velocity_ned_mps + cross(rate, lever)
        scale, yaw = estimate.values[layout["dvl"]].tolist() if "dvl" in layout else (0.0, 0.0)
        sine, cosine = math.sin(yaw), math.cos(yaw)
        turned = np.array(((cosine, sine, 0.0), (-sine, cosine, 0.0), (0.0, 0.0, 1.0)))
        seen = turned @ body
        gain = (1.0 + scale) * turned
        jacobian = np.zeros((3, layout.size))
        jacobian[:, VELOCITY] = gain @ rotation_frd_ned
        jacobian[:, ATTITUDE] = gain @ rotation_frd_ned @ skew(estimate.velocity_ned_mps)
        if "gyro_bias" in layout:
            jacobian[:, layout["gyro_bias"]] = gain @ skew(lever)
        if "dvl" in layout:
            place = layout["dvl"].start
            lasting = seen
            if self.steady_frd_mps is not None:
                lasting = np.append(np.asarray(self.steady_frd_mps, dtype=np.float64) / (1.0 + scale), 0.0)
            jacobian[:, place] = lasting
            jacobian[:2, place + 1] = ((1.0 + scale) * lasting[1], -(1.0 + scale) * lasting[0])
        residual = np.asarray(self.velocity_frd_mps, dtype=np.float64) - (1.0 + scale) * seen
        return Innovation(residual, jacobian, self.covariance_m2ps2)


@dataclass(frozen=True, slots=True)
class ZeroVelocity:
    """The vehicle stands still over ground: on deck, on the bottom, at a berth."""

    at_s: float
    std_mps: float = 0.02
    sensor: str = "imu"

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """0 = v."""
        jacobian = np.zeros((3, layout.size))
        jacobian[0, 3] = jacobian[1, 4] = jacobian[2, 5] = 1.0
        return Innovation(-estimate.velocity_ned_mps, jacobian, self.std_mps**2 * np.eye(3))


@dataclass(frozen=True, slots=True)
class ZeroRate:
    """The vehicle does not turn: what the gyro reads (rad/s, FRD) is its bias and the earth's rotation."""

    at_s: float
    angular_rate_frd_radps: ArrayLike
    std_radps: float = 0.003
    latitude_deg: float | None = None
    sensor: str = "imu"

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = bias + R' earth rate. None where the layout has no gyro bias."""
        if "gyro_bias" not in layout:
            return None
        jacobian = np.zeros((3, layout.size))
        jacobian[:, layout["gyro_bias"]] = np.eye(3)
        residual = _rate(self.angular_rate_frd_radps, estimate, layout)
        if self.latitude_deg is not None:
            latitude = math.radians(self.latitude_deg)
            earth_ned = EARTH_RATE_RADPS * np.array((math.cos(latitude), 0.0, -math.sin(latitude)))
            rotation_frd_ned = estimate.rotation_ned_frd.T
            residual -= rotation_frd_ned @ earth_ned
            jacobian[:, ATTITUDE] = rotation_frd_ned @ skew(earth_ned)
        return Innovation(residual, jacobian, self.std_radps**2 * np.eye(3))


@dataclass(frozen=True, slots=True)
class BlockValue:
    """Direct knowledge of one block but the attitude: a calibration's result, a known current, a stated position."""

    at_s: float
    block: str
    values: Array
    covariance: Array
    sensor: str = field(default="")

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = block. None where the layout has no such block."""
        if self.block not in layout:
            return None
        place = layout[self.block]
        jacobian = np.zeros((place.stop - place.start, layout.size))
        jacobian[:, place] = np.eye(place.stop - place.start)
        return Innovation(
            np.asarray(self.values, dtype=np.float64) - estimate.block(self.block), jacobian, self.covariance
        )


@dataclass(frozen=True, slots=True)
class _Heading:
    """Where the bow points, level, and how an error of the attitude changes that."""

    angle_rad: float
    by_attitude: Array  # (3,)

    @classmethod
    def of(cls, estimate: NavEstimate) -> _Heading | None:
        north, east, down = estimate.rotation_ned_frd[:, 0].tolist()
        level = north * north + east * east
        if level < STEEPEST_LEVEL * STEEPEST_LEVEL:
            return None
        return cls(math.atan2(east, north), np.array((-down * north / level, -down * east / level, 1.0)))


def _deviation(
    heading: _Heading, estimate: NavEstimate, layout: StateLayout, thruster_load: float = 0.0
) -> tuple[float, Array]:
    """A + B cos + C sin + wander, and its Jacobian (1, n)."""
    jacobian = np.zeros((1, layout.size))
    deviation = 0.0
    if "compass" in layout:
        place = layout["compass"]
        constant, by_cosine, by_sine = estimate.values[place].tolist()
        sine, cosine = math.sin(heading.angle_rad), math.cos(heading.angle_rad)
        deviation += constant + by_cosine * cosine + by_sine * sine
        jacobian[0, place] = (1.0, cosine, sine)
        jacobian[0, ATTITUDE] = (by_sine * cosine - by_cosine * sine) * heading.by_attitude
    if thruster_load and "thruster_field" in layout:
        place = layout["thruster_field"]
        by_cosine, by_sine = (thruster_load * estimate.values[place]).tolist()
        sine, cosine = math.sin(heading.angle_rad), math.cos(heading.angle_rad)
        deviation += by_cosine * cosine + by_sine * sine
        jacobian[0, place] = (thruster_load * cosine, thruster_load * sine)
        jacobian[0, ATTITUDE] += (by_sine * cosine - by_cosine * sine) * heading.by_attitude
    if "compass_wander" in layout:
        place = layout["compass_wander"]
        deviation += float(estimate.values[place.start])
        jacobian[0, place] = 1.0
    return deviation, jacobian


def _rate(angular_rate_frd_radps: ArrayLike, estimate: NavEstimate, layout: StateLayout) -> Array:
    """The vehicle's angular rate: the gyro's without its bias."""
    rate = np.array(angular_rate_frd_radps, dtype=np.float64)
    if "gyro_bias" in layout:
        rate -= estimate.values[layout["gyro_bias"]]
    return rate


__all__ = [
    "BlockValue",
    "CompassHeading",
    "Depth",
    "GravityDirection",
    "GroundVelocity",
    "HorizontalPosition",
    "HorizontalVelocity",
    "MagneticField",
    "SensorAngles",
    "WaterVelocity",
    "ZeroRate",
    "ZeroVelocity",
]
