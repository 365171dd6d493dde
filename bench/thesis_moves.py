"""The thesis's validation moves (section 4.6) on a simulated consumer sensor: truth, samples, and a bench calibration.

The moves are the thesis's: 24 degrees in 1.2 s with holds, 45 degrees without, the full range of the platform
(roll and pitch 60 degrees, yaw 16); each also five times slower. Turning about the foot of the platform accelerates
the sensor, which sits 0.3 m above. The sensor is an LSM6DSOX with a LIS3MDL by their datasheets (208 Hz; field 80 Hz,
held in between); the field carries hard and soft iron, a wander like the yaw wobble logged in the thesis (0.4 degrees
over a minute) and a disturbance by the servos while they move. None of these figures is shared with a filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude.accelerometer_routine import FACES, AccelerometerRoutine
from bluerov_slam.navigation.attitude.calibration import Calibration
from bluerov_slam.navigation.attitude.magnetometer_routine import MagnetometerRoutine
from bluerov_slam.navigation.attitude.quaternion import (
    Quaternion,
    conjugate,
    from_euler,
    multiply,
    rotate,
)
from bluerov_slam.navigation.attitude.routine import InertialSample

RATE_HZ = 208.0
REST_S = 12.0
GRAVITY_MPS2 = 9.80665
LEVER_M = 0.3
FIELD_GAUSS = np.array([0.23, 0.0, 0.42])  # San Luis Obispo: 0.48 gauss, dip 61 degrees, from magnetic north
START_YAW_RAD = 0.8

# (axis, angle in degrees, seconds to get there, seconds held)
WITH_HOLDS = [(0, 24, 1.2, 0.8), (0, 0, 1.2, 0.8), (1, 24, 1.2, 0.8), (1, 0, 1.2, 0.8)]
WITHOUT_HOLDS = [(0, 45, 0.8, 0), (0, -45, 1.6, 0), (0, 0, 0.8, 0), (1, 45, 0.8, 0), (1, -45, 1.6, 0), (1, 0, 0.8, 0)]
FULL_RANGE = [
    (axis, angle, 1.6, 2.0) for axis, most in ((0, 60), (1, 60), (2, 16)) for angle in (most, 0, -most, 0)
]  # fmt: skip
SCRIPTS = {"holds": WITH_HOLDS, "no holds": WITHOUT_HOLDS, "full range": FULL_RANGE}


@dataclass(frozen=True, slots=True)
class Run:
    """One session: rest, moves, rest. `steady[k]`: the platform has stood for half a second."""

    truth: list[Quaternion]
    rate: NDArray[np.float64]
    force: NDArray[np.float64]
    field: NDArray[np.float64]
    steady: NDArray[np.bool_]


class Sensor:
    """One specimen: its errors are drawn once, its noise anew for every sample."""

    def __init__(self, seed: int) -> None:
        self.random = random = np.random.default_rng(seed)
        self.gyro_bias = random.normal(0.0, math.radians(0.5), 3)
        self.gyro_scale = 1.0 + random.normal(0.0, 0.01, 3)
        self.offset = random.normal(0.0, 0.02 * GRAVITY_MPS2, 3)
        self.scale = np.diag(1.0 + random.normal(0.0, 0.01, 3))
        self.hard_iron = random.normal(0.0, 0.05, 3)
        squeeze = random.normal(0.0, 0.02, (3, 3))
        self.soft_iron = np.eye(3) + 0.5 * (squeeze + squeeze.T)

    def rates(self, true: NDArray[np.float64]) -> NDArray[np.float64]:
        """3.8 mdps per root hertz over 104 Hz, a bias that drifts by some 10 deg/h, steps of 35 mdps (1000 dps)."""
        random, n = self.random, len(true)
        drift = np.cumsum(random.normal(0.0, 3e-6 / math.sqrt(RATE_HZ), (n, 3)), axis=0)
        noisy = true * self.gyro_scale + self.gyro_bias + drift + random.normal(0.0, math.radians(0.039), (n, 3))
        return _stepped(noisy, math.radians(0.035))

    def forces(self, true: NDArray[np.float64]) -> NDArray[np.float64]:
        """70 ug per root hertz over 104 Hz, steps of 0.122 mg (4 g range)."""
        noisy = true @ self.scale + self.offset + self.random.normal(0.0, 0.007, true.shape)
        return _stepped(noisy, 0.000122 * GRAVITY_MPS2)

    def fields(self, true: NDArray[np.float64], moving: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """4 milligauss of noise, 80 values a second, each repeated; gauss."""
        random, n = self.random, len(true)
        noisy = true @ self.soft_iron + self.hard_iron + random.normal(0.0, 0.004, (n, 3))
        if moving is not None:
            noisy += _gauss_markov(random, n, 0.0016, 60.0) + moving[:, None] * _gauss_markov(random, n, 0.01, 0.5)
        taken = (np.floor(np.arange(n) * 80.0 / RATE_HZ) * RATE_HZ / 80.0).astype(int)
        return noisy[taken]


def session(script: str, slowness: float, sensor: Sensor) -> Run:
    """The moves of one script, `slowness` times as long."""
    angles, moving = _angles(SCRIPTS[script], slowness)
    dt = 1.0 / RATE_HZ
    attitudes = [from_euler(roll, pitch, START_YAW_RAD + yaw) for roll, pitch, yaw in angles]
    places = np.array([rotate(q, (0.0, 0.0, -LEVER_M)) for q in attitudes])
    acceleration = np.zeros_like(places)
    acceleration[1:-1] = (places[2:] - 2.0 * places[1:-1] + places[:-2]) / dt**2
    rates = np.zeros_like(places)
    for k in range(1, len(attitudes)):
        w, x, y, z = multiply(conjugate(attitudes[k - 1]), attitudes[k])
        rates[k] = 2.0 / dt * np.array([x, y, z]) * math.copysign(1.0, w)
    gravity = np.array([0.0, 0.0, GRAVITY_MPS2])
    forces = np.array([rotate(conjugate(q), tuple(a - gravity)) for q, a in zip(attitudes, acceleration, strict=True)])
    fields = np.array([rotate(conjugate(q), tuple(FIELD_GAUSS)) for q in attitudes])
    settled = np.convolve(moving, np.ones(round(0.5 * RATE_HZ)))[: len(moving)] == 0.0
    settled[: round(REST_S * RATE_HZ)] = False  # the time that a filter may take to settle
    return Run(attitudes, sensor.rates(rates), sensor.forces(forces), sensor.fields(fields, moving), settled)


def bench_calibration(sensor: Sensor) -> Calibration:
    """What our guided routines make of this specimen before it is built in: six faces, and turning it all around."""
    accelerometer, magnetometer = AccelerometerRoutine(), MagnetometerRoutine()
    at_s = 0.0
    for axis, sign in FACES:
        up = np.zeros(3)
        up[axis] = sign
        up += math.radians(5.0) * sensor.random.uniform(-1.0, 1.0, 3)
        held = np.tile(GRAVITY_MPS2 * up / np.linalg.norm(up), (900, 1))
        for force, rate in zip(sensor.forces(held), sensor.rates(np.zeros_like(held)), strict=True):
            at_s += 1.0 / RATE_HZ
            accelerometer.feed(InertialSample(at_s, tuple(rate), tuple(force), None))
        at_s += 5.0
    t = np.linspace(0.0, 60.0, 60 * 80)
    turned = [from_euler(math.pi * math.sin(0.37 * s), 1.5 * math.sin(0.23 * s), 0.6 * s) for s in t]
    clean = np.array([rotate(conjugate(q), tuple(FIELD_GAUSS)) for q in turned])
    readings = clean @ sensor.soft_iron + sensor.hard_iron + sensor.random.normal(0.0, 0.004, clean.shape)
    for s, reading in zip(t, readings, strict=True):
        magnetometer.feed(InertialSample(s, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8), tuple(reading)))
    return Calibration(accelerometer=accelerometer.finish(), magnetometer=magnetometer.finish())


def _angles(
    moves: list[tuple[int, int, float, float]], slowness: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Roll, pitch, yaw (n, 3) in rad and whether the servos run (n,), with a rest before and after."""
    rows = [np.zeros((round(2.0 * REST_S * RATE_HZ), 3))]
    running = [np.zeros(len(rows[0]))]
    at = np.zeros(3)
    for axis, angle_deg, seconds, held_s in moves:
        n = round(seconds * slowness * RATE_HZ)
        s = (np.arange(n) + 1.0) / n
        path = np.tile(at, (n, 1))
        path[:, axis] += (math.radians(angle_deg) - at[axis]) * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
        at = path[-1].copy()
        hold = np.tile(at, (round(held_s * RATE_HZ), 1))
        rows += [path, hold]
        running += [np.ones(n), np.zeros(len(hold))]
    rows.append(np.tile(at, (round(6.0 * RATE_HZ), 1)))
    running.append(np.zeros(len(rows[-1])))
    return np.concatenate(rows), np.concatenate(running)


def _gauss_markov(random: np.random.Generator, n: int, std: float, time_s: float) -> NDArray[np.float64]:
    decay = math.exp(-1.0 / RATE_HZ / time_s)
    kicks = random.normal(0.0, std * math.sqrt(1.0 - decay * decay), (n, 3))
    values = np.empty((n, 3))
    value = random.normal(0.0, std, 3)
    for k in range(n):
        value = decay * value + kicks[k]
        values[k] = value
    return values


def _stepped(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    rounded: NDArray[np.float64] = np.round(values / step) * step
    return rounded
