"""The moving water: current, its change with depth and time, turbulence around the vehicle, gusts and waves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bluerov_slam.simulation.conditions import Conditions
from bluerov_slam.simulation.noise_processes import GaussMarkov, random_walk_time_constant_s

_EDDY_S, _EDDY_SMOOTHING_S = 3.0, 0.4
_DOWN_SHARE = 0.3  # of the turbulence
_DIVEABLE = 2.25  # standard deviations of one axis: in more current than that nobody goes in
_TIDE_PERIOD_S = 44_714.0
_SHEAR_DEPTH_M = 10.0
_GUST_S = 40.0
_BURST_S = 25.0
_WAVE_COUNT = 9
_WAVE_PERIOD_S = 4.5
_NO_WAVES_BELOW = 0.02  # of the height at the surface
_GRAVITY_MPS2 = 9.81

Vector = tuple[float, float, float]


class Water(NamedTuple):
    """Velocity and acceleration of the water at the vehicle, NED over ground, and the sea surface above it.

    `surface_m`: how much higher the surface is than the mean, times the decay with depth (what a pressure sensor sees).
    `slope`: of the surface towards north and east, with the same decay.
    """

    velocity_mps: Vector
    acceleration_mps2: Vector
    surface_m: float
    slope: tuple[float, float]


class Ocean:
    """Water of a seed. `step` must be called in order of time; the current alone can be asked for at any time."""

    def __init__(self, conditions: Conditions, seed: int, step_s: float) -> None:
        self._conditions = conditions
        self._step_s = step_s
        rng = np.random.default_rng([seed, 0xC0])
        std, walk = conditions.current_std_mps, conditions.current_walk_mps_per_root_s
        time_constant_s = random_walk_time_constant_s(std, walk) if std > 0.0 else 1.0e5
        first = std * rng.standard_normal(2)
        first *= min(1.0, _DIVEABLE * std / max(float(np.hypot(*first)), 1.0e-9))
        self._current = GaussMarkov(rng, (std, std), time_constant_s, first=first.tolist())
        self._gusts = GaussMarkov(rng, (conditions.gust_std_mps,) * 2, _GUST_S)
        self._bursts = GaussMarkov(rng, (1.0,), _BURST_S)
        self._tide_rad = rng.uniform(0.0, 2.0 * math.pi, 2)
        self._eddy_rng = np.random.default_rng([seed, 0xEDD1])
        self._eddy_noise: list[float] = []
        self._eddy = [[0.0, 0.0, 0.0] for _ in range(3)]  # driven velocity, smoothed velocity, its acceleration
        self._waves = _wave_components(rng, conditions.wave_height_m)
        self._settle()

    def current_ned_mps(self, at_s: float, depth_m: float) -> Vector:
        """The current proper: what a filter's current state stands for, without turbulence, gusts and waves."""
        north, east = self._current.at(at_s).tolist()
        conditions = self._conditions
        if conditions.tide_mps:
            phase_rad = 2.0 * math.pi * at_s / _TIDE_PERIOD_S
            north += conditions.tide_mps * math.sin(phase_rad + self._tide_rad[0])
            east += conditions.tide_mps * math.sin(phase_rad + self._tide_rad[1])
        keep = 1.0 - conditions.shear_share * min(1.0, max(0.0, depth_m) / _SHEAR_DEPTH_M)
        return north * keep, east * keep, 0.0

    def step(self, at_s: float, place: Vector, moving: Vector) -> Water:
        """The water one step further on, where the vehicle is then; `moving`: its velocity, NED.

        The acceleration is that of the water met on the way, so that it fits the velocities from step to step.
        """
        north_m, east_m, depth_m = place
        conditions = self._conditions
        north, east, down = self.current_ned_mps(at_s, depth_m)
        slope_north_mps2, slope_east_mps2 = self._current.slope(at_s).tolist()
        if conditions.gust_std_mps:
            gust_north, gust_east = self._gusts.at(at_s).tolist()
            north, east = north + gust_north, east + gust_east
            gust_north, gust_east = self._gusts.slope(at_s).tolist()
            slope_north_mps2, slope_east_mps2 = slope_north_mps2 + gust_north, slope_east_mps2 + gust_east
        strength = 1.0
        if conditions.heavy_tails:
            # The logarithm of the strength wanders: long calm spells and bursts of the same total power.
            strength = math.exp(0.8 * float(self._bursts.at(at_s)[0]) - 0.64)
        eddies = self._next_eddy(strength)
        acceleration = [eddies[0][2] + slope_north_mps2, eddies[1][2] + slope_east_mps2, eddies[2][2]]
        velocity = [north + eddies[0][1], east + eddies[1][1], down + eddies[2][1]]
        surface_m = slope_north = slope_east = 0.0
        for amplitude, rate, number, cos_to, sin_to, phase in self._waves:
            decay = amplitude * math.exp(-number * max(0.0, depth_m))
            if decay < _NO_WAVES_BELOW * amplitude:
                continue
            angle = number * (north_m * cos_to + east_m * sin_to) - rate * at_s + phase
            up, along = decay * math.sin(angle), decay * math.cos(angle)
            # Deep water: particles on circles, forward under the crest.
            velocity[0] += rate * along * cos_to
            velocity[1] += rate * along * sin_to
            velocity[2] -= rate * up
            met = number * (moving[0] * cos_to + moving[1] * sin_to) - rate
            sinking = number * moving[2]
            change = -met * up - sinking * along
            acceleration[0] += rate * change * cos_to
            acceleration[1] += rate * change * sin_to
            acceleration[2] -= rate * (met * along - sinking * up)
            surface_m += along
            slope_north -= number * up * cos_to
            slope_east -= number * up * sin_to
        return Water(
            (velocity[0], velocity[1], velocity[2]),
            (acceleration[0], acceleration[1], acceleration[2]),
            surface_m,
            (slope_north, slope_east),
        )

    def _settle(self) -> None:
        for _ in range(int(6.0 * _EDDY_S / self._step_s)):
            self._next_eddy(1.0)

    def _next_eddy(self, strength: float) -> list[list[float]]:
        """White noise through two lags: white below 0.05 Hz, with an acceleration that exists.

        The second lag by the trapezoidal rule: velocity changes by exactly the mean of the accelerations.
        """
        if len(self._eddy_noise) < 3:
            self._eddy_noise = self._eddy_rng.standard_normal(3 * 1024).tolist()
        step_s = self._step_s
        walk = strength * self._conditions.unmodelled_velocity_m_per_root_s
        kick = walk * math.sqrt(step_s) / _EDDY_S
        keep, half = math.exp(-step_s / _EDDY_S), 0.5 * step_s
        for axis, eddy in enumerate(self._eddy):
            size = kick if axis < 2 else kick * _DOWN_SHARE
            driven, velocity, acceleration = eddy
            driven = driven * keep + size * self._eddy_noise.pop()
            middle = velocity + half * acceleration
            velocity = (middle + half / _EDDY_SMOOTHING_S * driven) / (1.0 + half / _EDDY_SMOOTHING_S)
            eddy[:] = driven, velocity, (driven - velocity) / _EDDY_SMOOTHING_S
        return self._eddy


def _wave_components(
    rng: np.random.Generator, significant_height_m: float
) -> list[tuple[float, float, float, float, float, float]]:
    """Amplitude, angular rate, wave number, direction cosines and phase of each component."""
    if significant_height_m <= 0.0:
        return []
    rates = 2.0 * math.pi / _WAVE_PERIOD_S * np.linspace(0.7, 2.1, _WAVE_COUNT) * rng.uniform(0.97, 1.03, _WAVE_COUNT)
    peak = 2.0 * math.pi / _WAVE_PERIOD_S
    spectrum = rates**-5.0 * np.exp(-1.25 * (peak / rates) ** 4)
    amplitudes = np.sqrt(spectrum / spectrum.sum() * 2.0) * significant_height_m / 4.0
    towards = rng.uniform(0.0, 2.0 * math.pi) + rng.normal(0.0, 0.35, _WAVE_COUNT)
    phases = rng.uniform(0.0, 2.0 * math.pi, _WAVE_COUNT)
    return [
        (float(a), float(w), float(w * w / _GRAVITY_MPS2), math.cos(t), math.sin(t), float(p))
        for a, w, t, p in zip(amplitudes, rates, towards, phases, strict=True)
    ]
