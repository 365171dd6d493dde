"""A winding dive at 20 Hz whose noise is exactly what the filter assumes: for tests of consistency, not of realism."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bluerov_slam.navigation.ekf import ErrorStateFilter, Measurement
from bluerov_slam.navigation.measurements import CompassHeading, Depth, HorizontalPosition
from bluerov_slam.navigation.process import Earth, ImuSample, ProcessModel, ProcessNoise
from bluerov_slam.navigation.rotation import euler_from_rotation
from bluerov_slam.navigation.state import NavEstimate, StateLayout

INTERVAL_S = 0.05
LATITUDE_DEG = 60.0
FULL = StateLayout.make()
LEAN = StateLayout.make(without=("current", "thrust_scale", "gps_wander", "dvl", "sound_speed_scale"))
STDS = {
    "position": 5.0, "velocity": 0.5, "attitude": (0.03, 0.03, 0.2), "gyro_bias": 0.002, "accel_bias": 0.1,
    "current": 0.2, "thrust_scale": 0.1, "compass": 0.03, "compass_wander": 0.017, "gps_wander": 1.4,
    "depth_bias": 0.05, "sound_speed_scale": 0.01, "dvl": (0.01, 0.03),
}  # fmt: skip


def initial_std(layout: StateLayout, **other: object) -> np.ndarray:
    """Standard deviations (n,) at the start; `other` than the usual ones by block."""
    return layout.vector(**{name: other.get(name, STDS[name]) for name, _ in layout.blocks})


def full_filter(layout: StateLayout = FULL, **arguments) -> ErrorStateFilter:
    """A filter at rest at the origin, heading north."""
    return ErrorStateFilter(NavEstimate(layout, 0.0), initial_std(layout), **arguments)


def resting(at_s: float, interval_s: float = INTERVAL_S) -> ImuSample:
    """What an ideal IMU reads that lies still and level."""
    return ImuSample(at_s, interval_s, np.array([0.0, 0.0, -Earth().gravity_mps2]), np.zeros(3))


class WindingDive:
    """Truth that starts off `full_filter`'s estimate by a draw of its covariance; samples and measurements of it."""

    def __init__(self, seed: int, layout: StateLayout = LEAN, gps_until_s: float = math.inf, **std: object) -> None:
        self.noise = ProcessNoise()
        self.layout = layout
        self.truth = NavEstimate(layout, 0.0)
        self.gps_until_s = gps_until_s
        self._random = np.random.default_rng(seed)
        self._model = ProcessModel(layout, self.noise, Earth(LATITUDE_DEG))
        self.std = initial_std(layout, **std)
        self.truth.add_error(self.std * self._random.normal(size=layout.size))

    def steps(self, seconds: float) -> Iterator[tuple[ImuSample, list[Measurement]]]:
        """Each IMU sample, and what was measured at its end; `truth` is then at that instant, too."""
        for step in range(1, round(seconds / INTERVAL_S) + 1):
            sample = self._move(step * INTERVAL_S)
            yield sample, self._measure(step, sample.at_s)

    def _move(self, t: float) -> ImuSample:
        truth, noise, random = self.truth, self.noise, self._random
        rate = np.array([0.05 * math.sin(0.7 * t), 0.04 * math.cos(0.5 * t), 0.3 * math.sin(0.05 * t)])
        acceleration = np.array([0.1 * math.cos(0.3 * t), 0.05 * math.sin(0.4 * t), 0.02 * math.sin(0.2 * t)])
        force = acceleration - truth.rotation_ned_frd.T @ self._model.earth.gravity_ned_mps2 + truth.block("accel_bias")
        rate = rate + truth.block("gyro_bias")
        self._model.strapdown(truth, force, rate, INTERVAL_S)
        truth.at_s = t
        truth.values[9:] += np.sqrt(noise.walks(self.layout)[9:] * INTERVAL_S) * random.normal(size=truth.blocks.size)
        fresh = math.sqrt(-math.expm1(-2.0 * INTERVAL_S / noise.compass_wander_time_s))
        truth.block("compass_wander")[:] += noise.compass_wander_std_rad * fresh * random.normal()
        root = math.sqrt(INTERVAL_S)
        return ImuSample(
            t,
            INTERVAL_S,
            force + noise.accel_noise_mps_per_sqrt_s / root * random.normal(size=3),
            rate + noise.gyro_noise_rad_per_sqrt_s / root * random.normal(size=3),
        )

    def _measure(self, step: int, t: float) -> list[Measurement]:
        truth, random = self.truth, self._random
        found: list[Measurement] = []
        if step % 2 == 0:
            depth = truth.values[2] + truth.block("depth_bias")[0] + 0.02 * random.normal()
            found.append(Depth(t, depth, 0.02))
        if step % 4 == 0:
            heading = euler_from_rotation(truth.rotation_ned_frd)[2]
            a, b, c = truth.block("compass")
            wander = truth.block("compass_wander")[0]
            compass = heading + a + b * math.cos(heading) + c * math.sin(heading) + wander
            found.append(CompassHeading(t, compass + 0.03 * random.normal(), 0.03))
        north, east = truth.position_ned_m[:2] + random.normal(size=2)
        if step % 20 == 0 and t <= self.gps_until_s:
            found.append(HorizontalPosition(t, north, east, np.eye(2)))
        return found


def dive_filter(dive: WindingDive, **arguments) -> ErrorStateFilter:
    """The filter that knows the dive's noise and how uncertain its start is."""
    start = NavEstimate(dive.layout, 0.0)
    return ErrorStateFilter(start, dive.std, noise=dive.noise, earth=Earth(LATITUDE_DEG), **arguments)


def nees(truth: NavEstimate, estimate: NavEstimate, covariance: np.ndarray) -> float:
    """Normalised squared error of all states."""
    error = truth.difference(estimate)
    return float(error @ np.linalg.solve(covariance, error))
