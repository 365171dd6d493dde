"""What the rig's kinematics cost: servo angles of one platform and of many, the set point of servo angles.

Time is this process's processor time, so that other programs do not count; the best of several rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import fsolve

from bench.system import row
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, AxisLimits
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.platform import published_servo_angles_rad, servo_angles_rad

PLATFORMS, SINGLE, ROUNDS = 100_000, 200, 9


def rows() -> list[dict[str, object]]:
    """rig_inverse_us, rig_inverse_batch_us, rig_forward_us."""
    random = np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (PLATFORMS, 6)) * AxisLimits().array()
    angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
    within = np.all(np.isfinite(angles), axis=1)
    some, commands = points[within][:SINGLE], angles[within][:SINGLE]

    def lengths(point: np.ndarray, command: np.ndarray) -> np.ndarray:
        return leg_lengths(point, command, FO_SHIP_PLATFORM).excess_mm

    one = _each_us(lambda k: servo_angles_rad(some[k], FO_SHIP_PLATFORM))
    quadratic = _each_us(lambda k: published_servo_angles_rad(some[k], FO_SHIP_PLATFORM))
    many = _best_us(lambda: servo_angles_rad(points, FO_SHIP_PLATFORM)) / PLATFORMS
    quadratics = _best_us(lambda: published_servo_angles_rad(points, FO_SHIP_PLATFORM)) / PLATFORMS
    forward = _each_us(lambda k: plate_pose(commands[k], FO_SHIP_PLATFORM))
    general = _each_us(lambda k: fsolve(lengths, np.zeros(6), args=(commands[k],), xtol=1e-12))
    return [
        row("rig_inverse_us", "servo angles of one set point, six legs", one, "us", "<= 20",
            f"published quadratic in NumPy {quadratic:.0f} us"),
        row("rig_inverse_batch_us", f"the same of {PLATFORMS} at once, each", many, "us", "<= 0.5",
            f"published quadratic in NumPy {quadratics:.2f} us"),
        row("rig_forward_us", "set point of six servo angles, from home", forward, "us", "<= 300",
            f"SciPy's fsolve without derivative {general:.0f} us"),
    ]  # fmt: skip


def _each_us(work: Callable[[int], object]) -> float:
    def all_of_them() -> None:
        for k in range(SINGLE):
            work(k)

    return _best_us(all_of_them) / SINGLE


def _best_us(work: Callable[[], object]) -> float:
    taken = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return 1e6 * min(taken)
