"""Flies the vehicle: pilot, thrusters, battery, hull, tether and water, step by step, into rows of truth.

A step is 50 ms; `tests/simulation/test_flight.py` says how little changes with half of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation import hull as body
from bluerov_slam.simulation.conditions import Conditions
from bluerov_slam.simulation.hull import Hull, State, Surroundings, Vector
from bluerov_slam.simulation.ocean import Ocean, Water
from bluerov_slam.simulation.pilot import Pilot, Route, Seen
from bluerov_slam.simulation.thrusters import VECTORED, Battery, Force, ThrusterFrame, current_a, thrust_n

STEP_S = 0.05
POSITION, QUATERNION, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
RATE, RATE_CHANGE, THROUGH_WATER, CURRENT = slice(13, 16), slice(16, 19), slice(19, 22), slice(22, 24)
VOLTAGE, AMPERES, SURFACE, FIRST_PWM = 24, 25, 26, 27

_THRUST_LAG_S = 0.12
_HOTEL_A = 1.2
_BUFFET_NM, _BUFFET_S = (0.10, 0.10, 0.12), 0.8
_CABLE_REACH_M = 100.0
_CABLE_DRAG = body.DRAG_X[1]
_STILL_M = 2.0

FloatArray = NDArray[np.float64]


class Flight:
    """One dive from `start_s` of the route on, at rest on its target; the sea begins there. `fly`: the next rows."""

    def __init__(
        self,
        route: Route,
        conditions: Conditions,
        seed: int,
        start_s: float = 0.0,
        frame: ThrusterFrame = VECTORED,
        step_s: float = STEP_S,
    ) -> None:
        self.step_s = step_s
        self.start_s = start_s
        self.ocean = Ocean(conditions, seed, step_s)
        rng = np.random.default_rng([seed, 0xB0A7])
        scales = conditions.speed_scale_std * np.clip(rng.standard_normal(2), -2.5, 2.5) * (1.0, 0.5)
        self.hull = Hull(float(scales[0]), float(scales[1]))
        self._efficiency = (1.0 + conditions.thruster_spread * rng.standard_normal(frame.count)).tolist()
        self._battery = Battery(float(rng.uniform(0.85, 1.0)))
        self._conditions = conditions
        self._frame = frame
        self._pilot = Pilot(route, frame, seed, start_s, step_s)
        self._buffet_rng = np.random.default_rng([seed, 0xBFFE])
        self._buffet_noise: list[float] = []
        self._buffet = [0.0, 0.0, 0.0]
        self._thrust: Force = (0.0,) * 6
        self._steps = 0
        target = route.target(start_s)
        depth_m = body.FLOATING_DEPTH_M if target.depth_m is None else target.depth_m
        half = 0.5 * target.heading_rad
        place = (target.north_m, target.east_m, depth_m)
        self._water = self.ocean.step(0.0, place, (0.0, 0.0, 0.0))
        water = self._water.velocity_mps
        cos_h, sin_h = math.cos(target.heading_rad), math.sin(target.heading_rad)
        # Drifting with the water would be unfair to a pilot who has held the place: at rest over ground.
        through = (-cos_h * water[0] - sin_h * water[1], sin_h * water[0] - cos_h * water[1], -water[2])
        self._state: State = (
            target.north_m, target.east_m, depth_m, math.cos(half), 0.0, 0.0, math.sin(half), *through, 0.0, 0.0, 0.0
        )  # fmt: skip

    def fly(self, steps: int) -> FloatArray:
        """The next so many rows, each the truth of one instant, `step_s` apart."""
        columns = FIRST_PWM + self._frame.count
        return np.array([self._row() for _ in range(steps)], np.float64).reshape(steps, columns)

    def _row(self) -> list[float]:
        """Truth at the present instant; the vehicle is one step further afterwards."""
        state, water, step_s = self._state, self._water, self.step_s
        flown_s = self._steps * step_s
        at_s = self.start_s + flown_s
        self._steps += 1
        north, east, down, qw, qx, qy, qz, u, v, w, p, q, r = state
        rotation = (
            (1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)),
            (2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz - qw * qx)),
            (2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)),
        )
        flow = [row[0] * u + row[1] * v + row[2] * w for row in rotation]
        velocity = (flow[0] + water.velocity_mps[0], flow[1] + water.velocity_mps[1], flow[2] + water.velocity_mps[2])
        roll, yaw = math.atan2(rotation[2][1], rotation[2][2]), math.atan2(rotation[1][0], rotation[0][0])
        pitch = -math.asin(min(1.0, max(-1.0, rotation[2][0])))
        pwm = self._pilot.steer(at_s, Seen(north, east, down, velocity, roll, pitch, yaw, (p, q, r)))
        voltage_v = self._battery.voltage_v
        begin, middle, end, amperes = self._push(pwm, voltage_v)
        self._battery.draw(amperes, step_s)

        ahead = (north + velocity[0] * step_s, east + velocity[1] * step_s, down + velocity[2] * step_s)
        after = self.ocean.step(flown_s + step_s, ahead, velocity)
        pull = self._tether(north, east, flow)
        torque = self._next_buffet()
        half_water = _halfway(water, after, step_s)
        new, slope = body.step(
            self.hull,
            state,
            Surroundings(begin, water.velocity_mps, pull, torque, water.surface_m, water.slope),
            Surroundings(middle, half_water, pull, torque, water.surface_m, water.slope),
            Surroundings(end, after.velocity_mps, pull, torque, after.surface_m, after.slope),
            step_s,
        )
        du, dv, dw = slope[7] + q * w - r * v, slope[8] + r * u - p * w, slope[9] + p * v - q * u
        acceleration = [
            row[0] * du + row[1] * dv + row[2] * dw + moving
            for row, moving in zip(rotation, water.acceleration_mps2, strict=True)
        ]
        current = self.ocean.current_ned_mps(flown_s, down)
        self._state, self._water = new, after
        return [
            *state[:7], *velocity, *acceleration, p, q, r, *slope[10:], u, v, w, current[0], current[1],
            voltage_v, amperes, water.surface_m, *pwm,
        ]  # fmt: skip

    def _push(self, pwm: list[int], voltage_v: float) -> tuple[Force, Force, Force, float]:
        """Force on the body at the beginning, in the middle and at the end of a step, and the current drawn."""
        total = [0.0] * 6
        amperes = _HOTEL_A
        for output, efficiency, effect in zip(pwm, self._efficiency, self._frame.effect, strict=True):
            force_n = thrust_n(output, voltage_v)
            if force_n:
                amperes += current_a(force_n, voltage_v)
                for axis in range(6):
                    total[axis] += efficiency * force_n * effect[axis]
        begin = self._thrust
        half, whole = math.exp(-0.5 * self.step_s / _THRUST_LAG_S), math.exp(-self.step_s / _THRUST_LAG_S)
        middle = tuple([aim + (now - aim) * half for aim, now in zip(total, begin, strict=True)])
        end = tuple([aim + (now - aim) * whole for aim, now in zip(total, begin, strict=True)])
        self._thrust = end  # type: ignore[assignment]
        return begin, middle, end, amperes  # type: ignore[return-value]

    def _tether(self, north_m: float, east_m: float, flow: list[float]) -> Vector:
        """Drag of the cable: against the motion through the water, and towards the boat at the origin."""
        share = self._conditions.tether_share
        away_m = math.hypot(north_m, east_m)
        speed = math.hypot(flow[0], flow[1])
        if share == 0.0 or away_m < _STILL_M or speed < 1.0e-6:
            return 0.0, 0.0, 0.0
        size_n = share * away_m / _CABLE_REACH_M * _CABLE_DRAG * speed * speed
        to_n, to_e = -north_m / away_m, -east_m / away_m
        return (
            size_n * (0.4 * to_n - 0.6 * flow[0] / speed),
            size_n * (0.4 * to_e - 0.6 * flow[1] / speed),
            0.0,
        )

    def _next_buffet(self) -> Vector:
        """Moments of the turbulent water and of the thrusters' wash."""
        if len(self._buffet_noise) < 3:
            self._buffet_noise = self._buffet_rng.standard_normal(3 * 1024).tolist()
        keep = math.exp(-self.step_s / _BUFFET_S)
        kick = math.sqrt(1.0 - keep * keep)
        for axis in range(3):
            self._buffet[axis] = self._buffet[axis] * keep + kick * _BUFFET_NM[axis] * self._buffet_noise.pop()
        return self._buffet[0], self._buffet[1], self._buffet[2]


def _halfway(before: Water, after: Water, step_s: float) -> Vector:
    """Velocity of the water in the middle of a step, from both ends' velocities and accelerations."""
    values = [
        0.5 * (v0 + v1) + 0.125 * step_s * (a0 - a1)
        for v0, v1, a0, a1 in zip(
            before.velocity_mps, after.velocity_mps, before.acceleration_mps2, after.acceleration_mps2, strict=True
        )
    ]
    return values[0], values[1], values[2]
