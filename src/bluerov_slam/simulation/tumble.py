"""On deck: the IMU's housing is laid on each of its six faces, then turned about in the hands. No water, no thrust."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation import flight as columns
from bluerov_slam.simulation.thrusters import FRAMES

REST_S, TURN_S, HANDS_S = 8.0, 3.0, 70.0
ON_DECK_M = -1.2  # above the water
_FACES = ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (-90.0, 0.0), (0.0, 80.0), (0.0, -80.0), (0.0, 0.0))  # roll, pitch
_TREMOR_RAD = math.radians(0.05)

FloatArray = NDArray[np.float64]


def tumble_rows(count: int, seed: int, step_s: float, thrusters: int = 6) -> FloatArray:
    """`count` rows of truth as a flight makes them, by differences of a smooth attitude."""
    rng = np.random.default_rng([seed, 0x70B])
    fine = 8
    times_s: FloatArray = np.arange(-1.0, count * fine + 2) * (step_s / fine)
    quaternions = _attitudes(times_s, rng)
    here = slice(1, 1 + count * fine, fine)
    rates = _rates(quaternions, step_s / fine)
    rows = np.zeros((count, columns.FIRST_PWM + FRAMES[thrusters].count))
    rows[:, columns.POSITION] = (0.0, 0.0, ON_DECK_M)
    rows[:, columns.QUATERNION] = quaternions[here]
    rows[:, columns.RATE] = rates[here]
    rows[:, columns.VOLTAGE] = 16.4
    rows[:, columns.AMPERES] = 1.2
    rows[:, columns.FIRST_PWM :] = 1500.0
    return rows


def _attitudes(times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Quaternions; in the hands the axes turn at rates that share no period, so that every direction comes up."""
    roll, pitch, yaw = np.zeros_like(times_s), np.zeros_like(times_s), np.zeros_like(times_s)
    heading = rng.uniform(-math.pi, math.pi)
    begin_s = 0.0
    for (roll_0, pitch_0), (roll_1, pitch_1) in itertools.pairwise(_FACES):
        share = np.clip((times_s - begin_s - REST_S) / TURN_S, 0.0, 1.0)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        roll += np.radians(roll_1 - roll_0) * smooth
        pitch += np.radians(pitch_1 - pitch_0) * smooth
        begin_s += REST_S + TURN_S
    begin_s += REST_S
    hands_s = np.maximum(0.0, times_s - begin_s)
    gentle = np.minimum(1.0, hands_s / 4.0)
    gentle = gentle**3 * (10.0 - 15.0 * gentle + 6.0 * gentle**2)
    roll += gentle * math.pi * np.sin(2.0 * math.pi * hands_s / 23.0)
    pitch += gentle * 1.3 * np.sin(2.0 * math.pi * hands_s / 13.7)
    yaw = heading + gentle * 2.0 * math.pi * hands_s / 17.0
    for angle in (roll, pitch):
        phase = rng.uniform(0.0, 2.0 * math.pi)
        angle += _TREMOR_RAD * np.sin(2.0 * math.pi * 1.3 * times_s + phase)
    return _quaternions(roll, pitch, yaw)


def _quaternions(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    cr, sr = np.cos(roll / 2.0), np.sin(roll / 2.0)
    cp, sp = np.cos(pitch / 2.0), np.sin(pitch / 2.0)
    cy, sy = np.cos(yaw / 2.0), np.sin(yaw / 2.0)
    return np.column_stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def _rates(quaternions: FloatArray, step_s: float) -> FloatArray:
    """Angular rate in the body frame, 2 q* dq/dt, by central differences."""
    change = np.gradient(quaternions, step_s, axis=0)
    w, x, y, z = quaternions.T
    dw, dx, dy, dz = change.T
    return 2.0 * np.column_stack(
        (
            w * dx - x * dw - y * dz + z * dy,
            w * dy - y * dw - z * dx + x * dz,
            w * dz - z * dw - x * dy + y * dx,
        )
    )
