"""How the state moves on: strapdown integration of an IMU sample, or a random walk where there is no IMU.

An IMU sample is the mean specific force and angular rate over an interval, both constant in the body during it. For
that motion the integrals are exact (closed forms in the rotation of the step), so that the force is turned by the
attitude as it changes inside the step, not by the one at its start: at 20 Hz and 20 deg/s that is half a degree.

The earth's rotation (15 deg/h, as much as the gyro's bias wanders) turns the attitude. Left out, being below 20
micro-g or 1 % of the noise they join: Coriolis force, gravity's change with depth and distance, the products of two
process noises inside one step. Rows 0 to 8 (position, velocity, attitude) of the transition are a full matrix over the
first blocks up to the accelerometer bias; all other rows are diagonal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.navigation.rotation import integral_coefficients, normalised, polynomial_of_skew, skew
from bluerov_slam.navigation.state import ATTITUDE, POSITION, VELOCITY, NavEstimate, StateLayout

Array = NDArray[np.float64]

EARTH_RATE_RADPS = 7.292115e-5
"""WGS-84 (NIMA TR8350.2)."""

MOVING = 9
"""Position, velocity, attitude: the states whose prediction is a full matrix."""


class ImuSample(NamedTuple):
    """Mean specific force and angular rate, body FRD, over the `interval_s` that ends at `at_s`."""

    at_s: float
    interval_s: float
    specific_force_frd_mps2: Array
    angular_rate_frd_radps: Array


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """How fast what is estimated wanders. Sources: (a) slam.md 3.4, (b) docs/navigation.md section 4, (c) judgement.

    A walk of w per square root of a second has the standard deviation w * sqrt(t) after t seconds.
    """

    accel_noise_mps_per_sqrt_s: float = 0.01
    """(a) 600 to 900 micro-g per root hertz measured on a vehicle, vibration included: 0.006 to 0.009."""
    gyro_noise_rad_per_sqrt_s: float = 3.5e-4
    """(a) 0.011 to 0.024 deg/s per root hertz measured; the wire's step of 0.061 deg/s adds 0.004 at 20 Hz."""
    gyro_bias_walk_radps_per_sqrt_s: float = 3e-6
    """(a) 5 to 25 deg/h of instability, reached in some minutes."""
    accel_bias_walk_mps2_per_sqrt_s: float = 5e-5
    """(a) 30 to 100 micro-g of instability, reached in some minutes."""
    current_walk_mps_per_sqrt_s: float = 1e-3
    """(b) hard; calm is half of it."""
    thrust_scale_walk_per_sqrt_s: float = 1e-4
    """(c) 0.6 % in an hour: a tether's drag, fouling."""
    compass_walk_rad_per_sqrt_s: float = 2e-5
    """(c) 0.07 deg in an hour."""
    compass_wander_std_rad: float = math.radians(1.0)
    """(b)"""
    compass_wander_time_s: float = 300.0
    """(b)"""
    gps_wander_std_m: float = 1.4
    """(b) 1.5 m per axis, most of it slow."""
    gps_wander_time_s: float = 60.0
    """(b)"""
    depth_bias_walk_m_per_sqrt_s: float = 5e-4
    """(c) 3 cm in an hour: air pressure, tide, warming of the sensor."""
    sound_speed_scale_walk_per_sqrt_s: float = 1e-5
    """(c) 0.06 % in an hour, 1 m/s."""
    dvl_scale_walk_per_sqrt_s: float = 1e-6
    """(c) constant but for the sound speed inside the instrument."""
    dvl_yaw_walk_rad_per_sqrt_s: float = 1e-6
    """(c) a mounting does not move."""
    extra_walk_per_sqrt_s: float = 0.0
    """Blocks that other packages add, unless `extra_walks` names them."""
    extra_walks: tuple[tuple[str, float], ...] = ()
    gap_attitude_walk_rad_per_sqrt_s: float = 0.35
    """(a) yaw rates of 17 to 23 deg/s (95 %), kept for about a second: what may happen while no IMU is heard."""
    gap_velocity_walk_mps_per_sqrt_s: float = 0.3
    """(c) half the top speed within some seconds."""

    def walks(self, layout: StateLayout) -> Array:
        """Variance per second (n,) of every state that neither the IMU nor a Gauss-Markov process drives."""
        named: dict[str, ArrayLike] = {
            "gyro_bias": self.gyro_bias_walk_radps_per_sqrt_s,
            "accel_bias": self.accel_bias_walk_mps2_per_sqrt_s,
            "current": self.current_walk_mps_per_sqrt_s,
            "thrust_scale": self.thrust_scale_walk_per_sqrt_s,
            "compass": self.compass_walk_rad_per_sqrt_s,
            "depth_bias": self.depth_bias_walk_m_per_sqrt_s,
            "sound_speed_scale": self.sound_speed_scale_walk_per_sqrt_s,
            "dvl": (self.dvl_scale_walk_per_sqrt_s, self.dvl_yaw_walk_rad_per_sqrt_s),
            "position": 0.0,
            "velocity": 0.0,
            "attitude": 0.0,
            "compass_wander": 0.0,
            "gps_wander": 0.0,
            **dict(self.extra_walks),
        }
        present = {name: named.get(name, self.extra_walk_per_sqrt_s) for name, _ in layout.blocks}
        walks: Array = layout.vector(**present) ** 2
        return walks

    def wanders(self) -> tuple[tuple[str, float, float], ...]:
        """Gauss-Markov blocks: name, standard deviation at rest, correlation time in seconds."""
        return (
            ("compass_wander", self.compass_wander_std_rad, self.compass_wander_time_s),
            ("gps_wander", self.gps_wander_std_m, self.gps_wander_time_s),
        )


class Earth:
    """Gravity and the earth's rotation in NED at one latitude; without a latitude those of 45 deg and no rotation."""

    def __init__(self, latitude_deg: float | None = None) -> None:
        self.gravity_mps2 = normal_gravity_mps2(45.0 if latitude_deg is None else latitude_deg)
        self.gravity_ned_mps2: Array = np.array([0.0, 0.0, self.gravity_mps2])
        self.rate_ned_radps: Array = np.zeros(3)
        if latitude_deg is not None:
            latitude = math.radians(latitude_deg)
            self.rate_ned_radps[:] = EARTH_RATE_RADPS * np.array([math.cos(latitude), 0.0, -math.sin(latitude)])


def normal_gravity_mps2(latitude_deg: float) -> float:
    """Gravity on the WGS-84 ellipsoid by Somigliana's formula (NIMA TR8350.2, 4.1). Check: 45 deg -> 9.806198 m/s2."""
    square = math.sin(math.radians(latitude_deg)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * square) / math.sqrt(1.0 - 0.00669437999013 * square)


class ProcessModel:
    """Moves an estimate and its covariance on in time, for one layout, one place on earth and one set of noises."""

    def __init__(self, layout: StateLayout, noise: ProcessNoise | None = None, earth: Earth | None = None) -> None:
        self.layout = layout
        self.noise = ProcessNoise() if noise is None else noise
        self.earth = Earth() if earth is None else earth
        self._gyro = layout.places.get("gyro_bias")
        self._accel = layout.places.get("accel_bias")
        self._span = MOVING + 3 * ((self._gyro is not None) + (self._accel is not None))
        self._walks = self.noise.walks(layout)
        self._wanders = [(layout[name], std, time) for name, std, time in self.noise.wanders() if name in layout]
        self._minus_earth_skew = -skew(self.earth.rate_ned_radps)
        self._slow_for = math.nan
        self._slow: tuple[Array, Array, Array] = (np.ones(0),) * 3

    def strapdown(self, estimate: NavEstimate, force: Array, rate: Array, interval_s: float) -> Array:
        """Move `estimate` on under specific force and rate (3,) in FRD; returns the top rows of the transition."""
        dt = interval_s
        rotation = estimate.rotation_ned_frd
        turn = rate - self.earth.rate_ned_radps @ rotation
        if self._gyro is not None:
            turn -= estimate.values[self._gyro]
        turn *= dt
        if self._accel is not None:
            force = force - estimate.values[self._accel]
        x, y, z = turn.tolist()
        c0, c1, c2, c3 = integral_coefficients(x * x + y * y + z * z)
        once = rotation @ polynomial_of_skew(x, y, z, dt, c1 * dt, c2 * dt)
        twice = rotation @ polynomial_of_skew(x, y, z, 0.5 * dt * dt, c2 * dt * dt, c3 * dt * dt)
        velocity_gain, position_gain = once @ force, twice @ force

        top = np.zeros((MOVING, self._span))
        top.flat[:: self._span + 1] = 1.0
        top[0, 3] = top[1, 4] = top[2, 5] = dt
        top[POSITION, ATTITUDE] = skew(-position_gain)
        top[VELOCITY, ATTITUDE] = skew(-velocity_gain)
        top[ATTITUDE, ATTITUDE] += dt * self._minus_earth_skew
        if self._gyro is not None:
            force_skew = skew(force)
            second = skew(turn) @ force_skew + skew(_cross(turn, force))
            top[POSITION, self._gyro] = rotation @ ((dt**3 / 6.0) * force_skew + (dt**3 / 24.0) * second)
            top[VELOCITY, self._gyro] = rotation @ ((dt * dt / 2.0) * force_skew + (dt * dt / 6.0) * second)
            top[ATTITUDE, self._gyro] = -once
        if self._accel is not None:
            top[POSITION, self._accel] = -twice
            top[VELOCITY, self._accel] = -once

        values, gravity = estimate.values, self.earth.gravity_mps2
        values[POSITION] += dt * values[VELOCITY] + position_gain
        values[VELOCITY] += velocity_gain
        values[2] += 0.5 * gravity * dt * dt
        values[5] += gravity * dt
        estimate.rotation_ned_frd = normalised(rotation @ polynomial_of_skew(x, y, z, 1.0, c0, c1))
        self._end(estimate, dt)
        return top

    def kinematic(self, estimate: NavEstimate, interval_s: float) -> Array:
        """Move `estimate` on with its velocity and attitude kept; returns the top rows of the transition (9, 9)."""
        top = np.eye(MOVING)
        top[0, 3] = top[1, 4] = top[2, 5] = interval_s
        estimate.values[POSITION] += interval_s * estimate.values[VELOCITY]
        self._end(estimate, interval_s)
        return top

    def propagate(
        self,
        covariance: Array,
        top: Array,
        interval_s: float,
        velocity_walk_mps_per_sqrt_s: float | None = None,
        attitude_walk_rad_per_sqrt_s: float | None = None,
    ) -> Array:
        """F P F' + Q in place for the transition whose top rows are `top`; returns the slow states' decay (n - 9,).

        The walks default to the IMU's noise. White noise on the velocity reaches the position inside the step, too.
        """
        noise, dt = self.noise, interval_s
        velocity = velocity_walk_mps_per_sqrt_s
        attitude = attitude_walk_rad_per_sqrt_s
        velocity = noise.accel_noise_mps_per_sqrt_s if velocity is None else velocity
        attitude = noise.gyro_noise_rad_per_sqrt_s if attitude is None else attitude
        decay, decay_outer, added = self._slow_change(dt)
        span = top.shape[1]
        rows = top @ covariance[:span]
        corner = rows[:, :span] @ top.T
        covariance[MOVING:, MOVING:] *= decay_outer
        cross = rows[:, MOVING:] * decay
        covariance[:MOVING, MOVING:] = cross
        covariance[MOVING:, :MOVING] = cross.T
        covariance[:MOVING, :MOVING] = 0.5 * (corner + corner.T)
        diagonal = covariance.reshape(-1)[:: self.layout.size + 1]
        diagonal[MOVING:] += added
        rate = velocity * velocity
        diagonal[POSITION] += rate * dt**3 / 3.0
        diagonal[VELOCITY] += rate * dt
        diagonal[ATTITUDE] += attitude * attitude * dt
        both = 0.5 * rate * dt * dt
        for axis in range(3):
            covariance[axis, axis + 3] += both
            covariance[axis + 3, axis] += both
        return decay

    def _end(self, estimate: NavEstimate, dt: float) -> None:
        estimate.at_s += dt
        estimate.values[MOVING:] *= self._slow_change(dt)[0]

    def _slow_change(self, dt: float) -> tuple[Array, Array, Array]:
        """Decay (n - 9,), its outer product, and the variance added to the states behind the attitude."""
        if dt != self._slow_for:
            decay = np.ones(self.layout.size)
            added = self._walks * dt
            for place, std, time_s in self._wanders:
                decay[place] = math.exp(-dt / time_s)
                added[place] = -std * std * math.expm1(-2.0 * dt / time_s)
            decay = decay[MOVING:]
            self._slow_for, self._slow = dt, (decay, np.outer(decay, decay), added[MOVING:])
        return self._slow


def _cross(a: Array, b: Array) -> Array:
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
