"""How sound gets from one transmitter to every receiver: delay and loss of the direct path and of each echo.

Echoes come by image sources: a flat reflector is a plane given in the array's frame, and the sound it returns seems to
come from the transmitter mirrored in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HALF_POWER_CONE_RAD = math.radians(55.0)  # both transducers, whole angle
BACK_LEAK = 0.1  # amplitude that still leaves or enters behind a transducer, relative to its axis
_PISTON_HALF_POWER = 1.61634  # argument x at which (2 J1(x) / x)^2 is one half

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reflector:
    """A flat boundary: the points p of the array's frame with normal . p = distance. A surface's coefficient is < 0."""

    normal: tuple[float, float, float]
    distance_m: float
    coefficient: float

    def image(self, points_m: FloatArray) -> FloatArray:
        """Points (..., 3) mirrored in the plane."""
        normal = np.asarray(self.normal, np.float64)
        normal = normal / np.linalg.norm(normal)
        return points_m - 2.0 * ((points_m @ normal) - self.distance_m)[..., None] * normal


def floor_below(distance_m: float, coefficient: float) -> Reflector:
    """A floor this far below the array's centre, the array being level."""
    return Reflector((0.0, 0.0, 1.0), distance_m, coefficient)


def surface_above(distance_m: float, coefficient: float = -0.9) -> Reflector:
    """The water's surface this far above the array's centre, the array being level."""
    return Reflector((0.0, 0.0, -1.0), distance_m, coefficient)


@dataclass(frozen=True, slots=True)
class Medium:
    """What the sound travels through: speed, absorption, and whether it spreads (1/r) at all."""

    sound_speed_mps: float = 343.0
    absorption_db_per_m: float = 0.0
    spreading: bool = True

    def amplitude(self, distance_m: FloatArray) -> FloatArray:
        """Amplitude relative to 1 m from the transmitter."""
        loss = 10.0 ** (-self.absorption_db_per_m * (distance_m - 1.0) / 20.0)
        result: FloatArray = loss / np.maximum(distance_m, 0.1) if self.spreading else loss
        return result


@dataclass(frozen=True, slots=True)
class Paths:
    """Every way to every receiver: (draws, paths, receivers); path 0 is the direct one."""

    delay_s: FloatArray
    amplitude: FloatArray


def trace_paths(
    receivers_m: FloatArray,
    sources_m: FloatArray,
    medium: Medium,
    reflectors: tuple[Reflector, ...] = (),
    directivity: bool = True,
) -> Paths:
    """Delays and amplitudes for sources (draws, 3) seen by receivers (n, 3) that look along +x of their array.

    The transmitter points at the array's centre.
    """
    places = np.stack([sources_m, *(mirror.image(sources_m) for mirror in reflectors)], axis=1)
    # A reflected ray leaves the image as the real one leaves the transmitter, mirrored; so is its axis.
    axes = np.stack([-sources_m, *(_turn(mirror, -sources_m) for mirror in reflectors)], axis=1)
    path = receivers_m[None, None] - places[:, :, None]
    distance_m = np.linalg.norm(path, axis=-1)
    coefficient = np.array([1.0, *(mirror.coefficient for mirror in reflectors)])
    amplitude = medium.amplitude(distance_m) * coefficient[None, :, None]
    if directivity:
        amplitude = amplitude * beam(_angle(path, axes[:, :, None])) * beam(_angle(-path, np.array([1.0, 0.0, 0.0])))
    return Paths(distance_m / medium.sound_speed_mps, amplitude)


def beam(angle_rad: FloatArray) -> FloatArray:
    """Amplitude of a piston with the transducers' half-power cone, at this angle from its axis."""
    x = _PISTON_HALF_POWER / math.sin(0.5 * HALF_POWER_CONE_RAD) * np.sin(angle_rad)
    front = np.maximum(_piston(x), BACK_LEAK)
    result: FloatArray = np.where(np.abs(angle_rad) < 0.5 * math.pi, front, BACK_LEAK)
    return result


def _piston(x: FloatArray) -> FloatArray:
    """2 J1(x) / x by its power series; x is at most 3.5 here, where 12 terms are exact to 1e-12."""
    square = 0.25 * np.square(x)
    term = np.ones_like(square)
    total = np.ones_like(square)
    for k in range(1, 13):
        term = -term * square / (k * (k + 1))
        total = total + term
    return total


def _turn(mirror: Reflector, direction: FloatArray) -> FloatArray:
    normal = np.asarray(mirror.normal, np.float64)
    normal = normal / np.linalg.norm(normal)
    result: FloatArray = direction - 2.0 * (direction @ normal)[..., None] * normal
    return result


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    cosine = (a * b).sum(axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    result: FloatArray = np.arccos(np.clip(cosine, -1.0, 1.0))
    return result
