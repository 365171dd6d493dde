"""What a side-scan sonar would hear in the world: one echogram of 8-bit amplitudes per ping and side.

The chain: seabed line under the beam -> slope, shadow and beam pattern -> energy gathered by slant range (so the
first bottom return, layover and the bright near range come out by themselves) -> surface return and bottom multiple
-> speckle and receiver noise -> the device's compressing 8-bit law.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation.vehicle import VehicleState
from bluerov_slam.simulation.world import World

STARBOARD = 1
PORT = -1

_GROUND_STEP_M = 0.05
_OVERSAMPLING = 1.5
_DEPRESSION_RAD = math.radians(35.0)
_BEAM_WIDTH_RAD = math.radians(45.0)
_AMPLITUDE_SCALE = 128.0
_AMPLITUDE_POWER = 0.75  # compresses Rayleigh speckle (0.52) to the 0.32..0.44 variation seen on real recordings
_NOISE_FLOOR = 0.012
_MULTIPLE_GAIN = 0.10
_SURFACE_GAIN = 0.30
_RINGING_M = 0.22
_SPECKLE_TABLE = 1 << 16
_SPECKLE_ALONG_TRACK = 0.55  # correlation of the complex field from ping to ping: 0.30 in intensity
_SPECKLE_KERNEL = (0.30, 1.0, 0.30)

FloatArray = NDArray[np.float64]


class SideScan:
    """One sonar looking to one side of the vehicle."""

    def __init__(self, world: World, side: int, seed: int) -> None:
        self._world = world
        self._side = side
        self._rng = np.random.default_rng([seed, 0x50A2, side + 1])
        self._speckle_table = _speckle_table(self._rng)
        self._field: NDArray[np.complex128] = np.zeros(0, np.complex128)

    def ping(self, state: VehicleState, samples: int, resolution_m: float, first_sample: int) -> NDArray[np.uint8]:
        """The echogram: `samples` amplitudes, sample i at slant range `(first_sample + i) * resolution_m`."""
        start_m = first_sample * resolution_m
        altitude_m = self._world.bottom_depth_m(state.north_m, state.east_m) - state.depth_m
        energy = self._seabed(state, altitude_m, samples, resolution_m, start_m)
        slant_m = start_m + resolution_m * (np.arange(samples, dtype=np.float64) + 0.5)
        energy = energy + self._multiples(energy, state.depth_m, slant_m, resolution_m)
        energy = energy + np.where(slant_m < _RINGING_M, 5.0 * (1.0 - slant_m / _RINGING_M), 0.0)
        amplitude = np.sqrt(energy) * self._speckle(samples)
        amplitude += _NOISE_FLOOR * np.abs(self._rng.standard_normal(samples)) * (1.0 + slant_m / 20.0)
        levels = _AMPLITUDE_SCALE * amplitude**_AMPLITUDE_POWER
        return np.minimum(levels, 255.0).astype(np.uint8)

    def _seabed(
        self, state: VehicleState, altitude_m: float, samples: int, resolution_m: float, start_m: float
    ) -> FloatArray:
        """Energy returned by the seabed, by slant range."""
        reach_m = start_m + samples * resolution_m
        if reach_m <= altitude_m * 0.5:
            return np.zeros(samples)
        ground_m = np.arange(0.0, reach_m, _GROUND_STEP_M)
        bearing = state.yaw_rad + self._side * math.pi / 2.0
        height_m, reflectivity = self._world.profile(
            state.north_m + ground_m * math.cos(bearing), state.east_m + ground_m * math.sin(bearing)
        )
        below_m = self._world.water_depth_m - state.depth_m - height_m
        slant_m = np.hypot(ground_m, below_m)
        strength = reflectivity**2 * _facing(ground_m, below_m, height_m, slant_m)
        strength *= _beam_pattern(below_m / slant_m, self._side * state.roll_rad)
        strength *= _lit(ground_m, below_m)
        return _gather(ground_m, slant_m, strength, samples, resolution_m, start_m)

    def _multiples(self, energy: FloatArray, depth_m: float, slant_m: FloatArray, resolution_m: float) -> FloatArray:
        """The sea surface seen from below, and the bottom seen once more by way of the surface."""
        surface = np.zeros_like(energy)
        beyond = slant_m > depth_m
        roughness = 1.0 + 0.4 * self._rng.standard_normal()
        decay = np.exp(-(slant_m[beyond] - depth_m) / 0.5)
        surface[beyond] = _SURFACE_GAIN**2 * max(0.2, roughness) * decay
        delay = round(2.0 * depth_m / resolution_m)
        if 0 < delay < len(energy):
            surface[delay:] += _MULTIPLE_GAIN**2 * energy[:-delay]
        return surface

    def _speckle(self, samples: int) -> FloatArray:
        """Multiplicative speckle of unit mean, correlated from ping to ping and from sample to sample."""
        offset = int(self._rng.integers(0, _SPECKLE_TABLE - samples))
        fresh = self._speckle_table[offset : offset + samples]
        if len(self._field) != samples:
            self._field = fresh
        else:
            mix = math.sqrt(1.0 - _SPECKLE_ALONG_TRACK**2)
            self._field = _SPECKLE_ALONG_TRACK * self._field + mix * fresh
        amplitude: FloatArray = np.abs(self._field)
        return amplitude


def _speckle_table(rng: np.random.Generator) -> NDArray[np.complex128]:
    """A complex Gaussian field, smoothed across track, whose modulus is Rayleigh with unit mean."""
    parts = rng.standard_normal((2, _SPECKLE_TABLE))
    kernel = np.array(_SPECKLE_KERNEL) / math.sqrt(sum(k * k for k in _SPECKLE_KERNEL))
    field = np.convolve(parts[0], kernel, "same") + 1j * np.convolve(parts[1], kernel, "same")
    return field / math.sqrt(math.pi / 2.0)


def _facing(ground_m: FloatArray, below_m: FloatArray, height_m: FloatArray, slant_m: FloatArray) -> FloatArray:
    """Lambert's law: cosine squared of the angle between the ray and the local normal, 0 on faces turned away.

    Per metre of ground, so a steep face counts with its whole surface.
    """
    slope = np.gradient(height_m, _GROUND_STEP_M)
    area = np.sqrt(1.0 + slope * slope)
    cosine = (slope * ground_m + below_m) / (slant_m * area)
    return np.maximum(cosine, 0.0) ** 2 * area


def _beam_pattern(sine_of_depression: FloatArray, roll_rad: float) -> FloatArray:
    """Two-way vertical pattern of the transducer, tilted down, moving with the vehicle's roll."""
    depression = np.arcsin(np.clip(sine_of_depression, -1.0, 1.0))
    off_axis = (depression - _DEPRESSION_RAD - roll_rad) / _BEAM_WIDTH_RAD
    return 0.02 + np.exp(-2.0 * off_axis * off_axis)


def _lit(ground_m: FloatArray, below_m: FloatArray) -> NDArray[np.bool_]:
    """True where the ray from the sonar is not blocked by something nearer."""
    tangent = ground_m / np.maximum(below_m, 0.05)
    return np.asarray(tangent >= np.maximum.accumulate(tangent) - 1.0e-9)


def _gather(
    ground_m: FloatArray,
    slant_m: FloatArray,
    strength: FloatArray,
    samples: int,
    resolution_m: float,
    start_m: float,
) -> FloatArray:
    """Sum the strength of fine ground cells into slant-range samples, split over two neighbours against moire."""
    count = max(len(ground_m), int(_OVERSAMPLING * ground_m[-1] / resolution_m))
    fine_m = np.linspace(0.0, ground_m[-1], count)
    fine_slant = np.interp(fine_m, ground_m, slant_m)
    fine_strength = np.interp(fine_m, ground_m, strength)
    position = (fine_slant - start_m) / resolution_m - 0.5
    inside = (position >= 0.0) & (position < samples - 1)
    position, weight = position[inside], fine_strength[inside] * (fine_m[1] / resolution_m)
    lower = position.astype(np.intp)
    share = position - lower
    energy = np.bincount(lower, weight * (1.0 - share), samples) + np.bincount(lower + 1, weight * share, samples)
    return np.asarray(energy, np.float64)
