"""Derivatives by difference quotients, on the manifold the state lives in; and states to take them at."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st

from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate, StateLayout

SIZES = {
    "position": 50.0,
    "velocity": 2.0,
    "gyro_bias": 0.02,
    "accel_bias": 0.3,
    "current": 0.5,
    "thrust_scale": 0.2,
    "compass": 0.1,
    "compass_wander": 0.05,
    "gps_wander": 3.0,
    "depth_bias": 0.2,
    "sound_speed_scale": 0.01,
    "dvl": 0.05,
    "thruster_field": 0.1,
}


def random_estimate(layout: StateLayout, seed: int, tilt: float = 1.2) -> NavEstimate:
    """Any heading, roll and pitch up to `tilt`, every block of a likely size."""
    random = np.random.default_rng(seed)
    blocks = {
        name: SIZES.get(name, 1.0) * random.uniform(-1.0, 1.0, size)
        for name, size in layout.blocks
        if name != "attitude"
    }
    roll, pitch = random.uniform(-tilt, tilt, 2)
    rotation = rotation_from_euler(roll, pitch, random.uniform(-math.pi, math.pi))
    return NavEstimate(layout, 100.0, rotation, **blocks)


def derivative(function: Callable[[NavEstimate], np.ndarray], at: NavEstimate, step: float = 1e-6) -> np.ndarray:
    """Columns: change of the function's value per error added to the estimate."""
    columns = []
    for index in range(at.layout.size):
        error = np.zeros(at.layout.size)
        error[index] = step
        ahead, behind = at.copy(), at.copy()
        ahead.add_error(error)
        behind.add_error(-error)
        columns.append((function(ahead) - function(behind)) / (2.0 * step))
    return np.array(columns).T


seeds = st.integers(0, 2**32 - 1)
