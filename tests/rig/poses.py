"""Set points that one platform can reach, and random stacks of them, for the tests of the rig."""

import numpy as np

from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, AxisLimits
from bluerov_slam.rig.platform import servo_angles_rad

HALF_TURN = 0.5 * np.pi


def reachable(count, seed=0, share=1.0):
    """(count, 6), all servos within a quarter turn of level, axes within that share of their published limits."""
    random = np.random.default_rng(seed)
    found = np.empty((0, 6))
    while len(found) < count:
        points = random.uniform(-1.0, 1.0, (2 * count, 6)) * AxisLimits().array() * share
        angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
        found = np.concatenate([found, points[np.all(np.abs(angles) <= HALF_TURN, axis=-1)]])
    return found[:count]


def stacks(count, seed=0, share=1.0):
    """(count, 4, 6)."""
    return reachable(4 * count, seed, share).reshape(count, 4, 6)


def unequal(seed=0, spread_mm=0.5):
    """A platform whose legs all differ."""
    random = np.random.default_rng(seed)
    parts = ("base_joints_mm", "plate_joints_mm", "arm_mm", "rod_mm")
    made = {part: getattr(FO_SHIP_PLATFORM, part) for part in parts}
    made = {part: value + spread_mm * random.standard_normal(value.shape) for part, value in made.items()}
    bearings = FO_SHIP_PLATFORM.arm_bearings_rad + 0.01 * random.standard_normal(6)
    return type(FO_SHIP_PLATFORM)(arm_bearings_rad=bearings, **made)


def derivative(function, at, step):
    """Central differences of function(at) by every number of `at` (n,), along a new last axis."""
    columns = []
    for k in range(len(at)):
        move = np.zeros(len(at))
        move[k] = step
        columns.append((function(at + move) - function(at - move)) / (2.0 * step))
    return np.stack(columns, axis=-1)
