"""A bench at rest or moving in steps: its true yaw, what its compass says of it and what its gyro integrates.

The compass wobbles as measured in the thesis's logs (0.36 to 0.56 deg, correlated over 40 to 80 s); the gyro is a
consumer one whose bias was taken from a second at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WobbleFigures:
    """Ranges that a session is drawn from, and the gyro's figures; degrees and seconds."""

    wobble_deg: tuple[float, float] = (0.36, 0.56)
    correlation_s: tuple[float, float] = (40.0, 80.0)
    compass_noise_deg: float = 0.05
    gyro_noise_deg_per_rt_s: float = 0.005
    gyro_bias_deg_per_s: float = 0.003
    gyro_wander_deg_per_s: float = 0.001
    gyro_wander_s: float = 300.0


@dataclass(frozen=True, eq=False)
class YawSession:
    """Arrays (n,): instants, true yaw, compass yaw, and the gyro's turn since the instant before; radians."""

    times_s: Array
    true_rad: Array
    compass_rad: Array
    gyro_turn_rad: Array


def yaw_session(
    seed: int, count: int, every_s: float, turned_rad: Array | None = None, figures: WobbleFigures | None = None
) -> YawSession:
    """One session at rest at any yaw; with `turned_rad` (n,), turned by so much from it at each instant."""
    drawn = figures or WobbleFigures()
    random = np.random.default_rng([seed, 0x3A3])
    wobble = random.uniform(*drawn.wobble_deg) * _gauss_markov(
        random, count, every_s, random.uniform(*drawn.correlation_s)
    )
    turned = np.zeros(count) if turned_rad is None else np.degrees(turned_rad)
    steps = np.diff(turned, prepend=turned[:1])
    true = random.uniform(-180.0, 180.0) + turned
    constant = drawn.gyro_bias_deg_per_s * random.standard_normal()
    bias = constant + drawn.gyro_wander_deg_per_s * _gauss_markov(random, count, every_s, drawn.gyro_wander_s)
    turn = steps + bias * every_s + drawn.gyro_noise_deg_per_rt_s * math.sqrt(every_s) * random.standard_normal(count)
    turn[0] = 0.0
    compass = true + wobble + drawn.compass_noise_deg * random.standard_normal(count)
    return YawSession(
        np.arange(count, dtype=np.float64) * every_s, np.radians(true), np.radians(compass), np.radians(turn)
    )


def _gauss_markov(random: np.random.Generator, count: int, every_s: float, time_s: float) -> Array:
    """Of standard deviation 1."""
    decay = math.exp(-every_s / time_s)
    white = random.standard_normal(count)
    values = np.empty(count)
    values[0] = white[0]
    for index in range(1, count):
        values[index] = decay * values[index - 1] + math.sqrt(1.0 - decay * decay) * white[index]
    return values
