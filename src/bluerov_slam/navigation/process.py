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

from bluerov_slam.navigation.rotation import integral_coefficients, normalised, skew
from bluerov_slam.navigation.state import ATTITUDE, POSITION, VELOCITY, NavEstimate, StateLayout

Array = NDArray[np.float64]

EARTH_RATE_RADPS = 7.292115e-5
"""WGS-84 (NIMA TR8350.2)."""

MOVING = 9
"""Position, velocity, attitude: the states whose prediction is a full matrix."""


NORMALISE_EVERY = 64
"""Steps between two corrections of the rotation matrix."""


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
    """Moves an estimate and its covariance on in time, for one layout, one place on earth and one set of noises.

    What a step needs of 3 x 3 algebra is written out in floats and done in one product: it is called 20 times a second.
    """

    def __init__(self, layout: StateLayout, noise: ProcessNoise | None = None, earth: Earth | None = None) -> None:
        self.layout = layout
        self.noise = ProcessNoise() if noise is None else noise
        self.earth = Earth() if earth is None else earth
        self._gyro = layout.places.get("gyro_bias")
        self._accel = layout.places.get("accel_bias")
        self._current = layout.places.get("current")
        self._span = MOVING + 3 * ((self._gyro is not None) + (self._accel is not None))
        self._walks = self.noise.walks(layout)[MOVING:]
        self._wanders = [(layout[name], std, time) for name, std, time in self.noise.wanders() if name in layout]
        self._earth_rate: tuple[float, float, float] = tuple(self.earth.rate_ned_radps.tolist())
        self._earth_turns = any(self._earth_rate)
        self.kinematic_velocity_time_s = math.inf
        """Without an IMU drag brings the velocity to the water's over this time; who knows of drag sets it."""
        self._slow_for = math.nan
        self._slow = _SlowChange(np.ones(0), None, np.zeros(0))
        self._added_for = (math.nan, math.nan, math.nan)
        self._added: Array = np.zeros((MOVING, MOVING))
        self._template_for = math.nan
        self._template: Array = np.zeros((MOVING, self._span))
        self._worn = 0

    def strapdown(self, estimate: NavEstimate, force: Array, rate: Array, interval_s: float) -> Array:
        """Move `estimate` on under specific force and rate (3,) in FRD; returns the top rows of the transition."""
        dt, values, rotation = interval_s, estimate.values, estimate.rotation_ned_frd
        x, y, z = self._turn(estimate, rate, dt)
        fx, fy, fz = force.tolist()
        if self._accel is not None:
            bx, by, bz = values[self._accel].tolist()
            fx, fy, fz = fx - bx, fy - by, fz - bz
        # With S = skew(turn), once = dt (1 + c1 S + c2 S^2) and twice = dt^2 (1/2 + c2 S + c3 S^2) integrate the force.
        c0, c1, c2, c3 = integral_coefficients(x * x + y * y + z * z)
        square = dt * dt
        step = _polynomial(x, y, z, 1.0, c0, c1)
        once = _polynomial(x, y, z, -dt, -c1 * dt, -c2 * dt)
        twice = _polynomial(x, y, z, -0.5 * square, -c2 * square, -c3 * square)
        by_gyro = _by_turn(x, y, z, fx, fy, fz, dt)
        # Columns: rotation of the step | velocity by gyro's bias | position, velocity by accelerometer's | both gained.
        rows = [
            (
                *step[row],
                *by_gyro[row],
                *twice[row],
                *once[row],
                -once[row][0] * fx - once[row][1] * fy - once[row][2] * fz,
                -twice[row][0] * fx - twice[row][1] * fy - twice[row][2] * fz,
            )
            for row in (0, 1, 2)
        ]
        turned = rotation @ np.array(rows)
        (vx, px), (vy, py), (vz, pz) = turned[:, 12:].tolist()

        top = self._start_of_top(dt)
        top[0, 7], top[0, 8], top[1, 6], top[1, 8], top[2, 6], top[2, 7] = pz, -py, -pz, px, py, -px
        top[3, 7], top[3, 8], top[4, 6], top[4, 8], top[5, 6], top[5, 7] = vz, -vy, -vz, vx, vy, -vx
        if self._gyro is not None:
            top[VELOCITY, self._gyro] = turned[:, 3:6]
            top[POSITION, self._gyro] = (dt / 3.0) * turned[:, 3:6]
            top[ATTITUDE, self._gyro] = turned[:, 9:12]
        if self._accel is not None:
            top[POSITION, self._accel] = turned[:, 6:9]
            top[VELOCITY, self._accel] = turned[:, 9:12]

        gained = self.earth.gravity_mps2 * dt
        north, east, down, vn, ve, vd = values[:6].tolist()
        values[:6] = (
            north + dt * vn + px, east + dt * ve + py, down + dt * vd + pz + 0.5 * gained * dt,
            vn + vx, ve + vy, vd + vz + gained,
        )  # fmt: skip
        self._set_rotation(estimate, turned[:, :3])
        self._end(estimate, dt)
        return top

    def kinematic(self, estimate: NavEstimate, interval_s: float) -> Array:
        """Move `estimate` on with its velocity going over into the current's and its attitude kept; the transition's
        top rows.
        """
        time_s, current = self.kinematic_velocity_time_s, self._current
        dragged = current is not None and not math.isinf(time_s)
        top = np.eye(MOVING, current.stop if current is not None and dragged else MOVING)
        left = math.exp(-interval_s / time_s)
        reach_s = interval_s if math.isinf(time_s) else time_s * (1.0 - left)
        top[0, 3] = top[1, 4] = top[2, 5] = reach_s
        top[3, 3] = top[4, 4] = top[5, 5] = left
        values = estimate.values
        values[POSITION] += reach_s * values[VELOCITY]
        values[VELOCITY] *= left
        if current is not None and dragged:
            north, east = current.start, current.start + 1
            top[0, north] = top[1, east] = interval_s - reach_s
            top[3, north] = top[4, east] = 1.0 - left
            values[0:2] += (interval_s - reach_s) * values[current]
            values[3:5] += (1.0 - left) * values[current]
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
        noise = self.noise
        velocity = velocity_walk_mps_per_sqrt_s
        attitude = attitude_walk_rad_per_sqrt_s
        velocity = noise.accel_noise_mps_per_sqrt_s if velocity is None else velocity
        attitude = noise.gyro_noise_rad_per_sqrt_s if attitude is None else attitude
        slow = self._slow_change(interval_s)
        span = top.shape[1]
        rows = top @ covariance[:span]
        corner = rows[:, :span] @ top.T
        corner += self._moving_noise(interval_s, velocity, attitude)
        cross = rows[:, MOVING:]
        if slow.outer is not None:
            covariance[MOVING:, MOVING:] *= slow.outer
            cross = cross * slow.decay
        covariance[:MOVING, MOVING:] = cross
        covariance[MOVING:, :MOVING] = cross.T
        np.add(corner, corner.T, out=covariance[:MOVING, :MOVING])
        covariance[:MOVING, :MOVING] *= 0.5
        covariance.reshape(-1)[MOVING * (self.layout.size + 1) :: self.layout.size + 1] += slow.added
        return slow.decay

    def _turn(self, estimate: NavEstimate, rate: Array, dt: float) -> tuple[float, float, float]:
        """Rotation vector of the body against NED in this step."""
        x, y, z = rate.tolist()
        if self._gyro is not None:
            bx, by, bz = estimate.values[self._gyro].tolist()
            x, y, z = x - bx, y - by, z - bz
        if self._earth_turns:
            ex, ey, ez = (self.earth.rate_ned_radps @ estimate.rotation_ned_frd).tolist()
            x, y, z = x - ex, y - ey, z - ez
        return x * dt, y * dt, z * dt

    def _start_of_top(self, dt: float) -> Array:
        """What of the transition depends on the step's length alone."""
        if dt != self._template_for:
            template = np.eye(MOVING, self._span)
            template[0, 3] = template[1, 4] = template[2, 5] = dt
            template[ATTITUDE, ATTITUDE] -= dt * skew(self._earth_rate)
            self._template_for, self._template = dt, template
        return self._template.copy()

    def _set_rotation(self, estimate: NavEstimate, rotation: Array) -> None:
        """Each product adds some 1e-16 of rounding: taken out again now and then."""
        self._worn += 1
        if self._worn >= NORMALISE_EVERY:
            self._worn = 0
            rotation = normalised(rotation)
        estimate.rotation_ned_frd = rotation.copy() if rotation.base is not None else rotation

    def _end(self, estimate: NavEstimate, dt: float) -> None:
        estimate.at_s += dt
        slow = self._slow_change(dt)
        if slow.outer is not None:
            estimate.values[MOVING:] *= slow.decay

    def _moving_noise(self, dt: float, velocity: float, attitude: float) -> Array:
        """Covariance (9, 9) that a step adds to position, velocity and attitude."""
        if (dt, velocity, attitude) != self._added_for:
            added = np.zeros((MOVING, MOVING))
            rate, unit = velocity * velocity, np.eye(3)
            added[POSITION, POSITION] = rate * dt**3 / 3.0 * unit
            added[POSITION, VELOCITY] = added[VELOCITY, POSITION] = 0.5 * rate * dt * dt * unit
            added[VELOCITY, VELOCITY] = rate * dt * unit
            added[ATTITUDE, ATTITUDE] = attitude * attitude * dt * unit
            self._added_for, self._added = (dt, velocity, attitude), added
        return self._added

    def _slow_change(self, dt: float) -> _SlowChange:
        if dt != self._slow_for:
            decay, added = np.ones(self.layout.size - MOVING), self._walks * dt
            for place, std, time_s in self._wanders:
                here = slice(place.start - MOVING, place.stop - MOVING)
                decay[here] = math.exp(-dt / time_s)
                added[here] = -std * std * math.expm1(-2.0 * dt / time_s)
            outer = np.outer(decay, decay) if self._wanders else None
            self._slow_for, self._slow = dt, _SlowChange(decay, outer, added)
        return self._slow


class _SlowChange(NamedTuple):
    """What a step does to the states behind the attitude: decay, its outer product (None: 1), variance added."""

    decay: Array
    outer: Array | None
    added: Array


Rows = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


def _polynomial(x: float, y: float, z: float, c0: float, c1: float, c2: float) -> Rows:
    """Rows of c0 + c1 S + c2 S^2 for S = skew((x, y, z))."""
    xx, yy, zz = c2 * x * x, c2 * y * y, c2 * z * z
    xy, xz, yz = c2 * x * y, c2 * x * z, c2 * y * z
    sx, sy, sz = c1 * x, c1 * y, c1 * z
    return (
        (c0 - yy - zz, xy - sz, xz + sy),
        (xy + sz, c0 - xx - zz, yz - sx),
        (xz - sy, yz + sx, c0 - xx - yy),
    )


def _by_turn(x: float, y: float, z: float, fx: float, fy: float, fz: float, dt: float) -> Rows:
    """Change of the gained velocity (in the body at the step's start) per change of the gyro's bias.

    The turn t is -dt times the bias's change. The integral of the force f, dt (f + t x f / 2 + t x (t x f) / 6), has
    the derivative -dt ([f] / 2 + T / 6) by t with T = [t] [f] + [t x f] = 2 f t' - t f' - (t . f) 1. The position's is
    dt / 3 of it but for a quarter of T's part, a micrometre.
    """
    a, b = dt * dt / 2.0, dt * dt / 6.0
    x, y, z = b * x, b * y, b * z
    dot = x * fx + y * fy + z * fz
    return (
        (fx * x - dot, 2.0 * fx * y - x * fy - a * fz, 2.0 * fx * z - x * fz + a * fy),
        (2.0 * fy * x - y * fx + a * fz, fy * y - dot, 2.0 * fy * z - y * fz - a * fx),
        (2.0 * fz * x - z * fx - a * fy, 2.0 * fz * y - z * fy + a * fx, fz * z - dot),
    )
