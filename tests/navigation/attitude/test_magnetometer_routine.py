"""Guided calibration of the magnetometer: hard and soft iron, wild readings, and motions that show too little."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.calibration import CalibrationError, MagnetometerCalibration
from bluerov_slam.navigation.attitude.magnetometer_routine import MagnetometerRoutine
from bluerov_slam.navigation.attitude.quaternion import conjugate, from_euler, rotate
from bluerov_slam.navigation.attitude.routine import InertialSample, RoutineState
from inertial_samples import FIELD_NED

STRENGTH_RAW = 450.0
UNIT_FIELD = tuple(np.array(FIELD_NED) / np.linalg.norm(FIELD_NED))
SOFT_IRON = np.array([[1.1, 0.05, -0.02], [0.05, 0.93, 0.04], [-0.02, 0.04, 1.03]])
HARD_IRON = np.array([130.0, -90.0, 310.0])


def directions(reach_rad: float, count: int = 1200) -> np.ndarray:
    """The Earth's field in the body while it turns about the vertical and rocks by so much."""
    t = np.linspace(0.0, 60.0, count)
    return np.array(
        [
            rotate(
                conjugate(from_euler(reach_rad * math.sin(0.37 * s), 0.5 * reach_rad * math.sin(0.23 * s), 0.6 * s)),
                UNIT_FIELD,
            )
            for s in t
        ]
    )


TUMBLING = directions(math.pi)


def feed(routine: MagnetometerRoutine, readings: np.ndarray) -> None:
    for k, reading in enumerate(readings):
        routine.feed(InertialSample(0.05 * k, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8), tuple(reading)))


def readings_of(
    field: np.ndarray, seed: int = 0, noise: float = 0.01, soft: np.ndarray = SOFT_IRON, hard: np.ndarray = HARD_IRON
) -> np.ndarray:
    clean = STRENGTH_RAW * field @ soft.T + hard
    return np.round(clean + np.random.default_rng(seed).normal(0.0, noise * STRENGTH_RAW, clean.shape))


def worst_angle_deg(found: MagnetometerCalibration, soft: np.ndarray, hard: np.ndarray) -> float:
    corrected = found.apply(STRENGTH_RAW * TUMBLING @ soft.T + hard)
    corrected /= np.linalg.norm(corrected, axis=1, keepdims=True)
    return math.degrees(float(np.arccos(np.clip((corrected * TUMBLING).sum(axis=1), -1.0, 1.0)).max()))


@pytest.mark.parametrize("seed", range(8))
def test_hard_and_soft_iron_are_found(seed: int) -> None:
    random = np.random.default_rng(seed)
    hard = random.uniform(-600.0, 600.0, 3)
    a, b, c = random.uniform(0.85, 1.15, 3)
    d, e, f = random.uniform(-0.08, 0.08, 3)
    soft = np.array([[a, d, e], [d, b, f], [e, f, c]])
    routine = MagnetometerRoutine()
    feed(routine, readings_of(TUMBLING, seed, soft=soft, hard=hard))
    assert routine.state is RoutineState.READY
    found = routine.finish(made_unix_s=1.7e9)
    assert worst_angle_deg(found, soft, hard) < 0.7
    assert found.offset_raw == pytest.approx(hard, abs=0.01 * STRENGTH_RAW)
    assert found.made.residual == pytest.approx(1.0, rel=0.3)  # the noise, in percent
    assert found.made.unit == "% of the field"


def test_corrected_fields_have_length_one() -> None:
    routine = MagnetometerRoutine()
    feed(routine, readings_of(TUMBLING, noise=0.002))
    found = routine.finish()
    lengths = np.linalg.norm(found.apply(readings_of(directions(2.0), 5, noise=0.002)), axis=1)
    assert lengths == pytest.approx(np.ones(len(lengths)), abs=0.01)
    assert found.raw_norm == pytest.approx(STRENGTH_RAW * np.cbrt(np.linalg.det(SOFT_IRON)), rel=0.01)


def test_wild_readings_do_not_bend_it() -> None:
    readings = readings_of(TUMBLING)
    random = np.random.default_rng(3)
    readings[::12] += random.normal(0.0, 2.0 * STRENGTH_RAW, readings[::12].shape)
    routine = MagnetometerRoutine()
    feed(routine, readings)
    assert worst_angle_deg(routine.finish(), SOFT_IRON, HARD_IRON) < 0.7


@pytest.mark.parametrize("reach_rad", [0.0, 0.05, 0.35, 0.7])
def test_a_motion_that_shows_too_little_is_refused_with_what_is_missing(reach_rad: float) -> None:
    routine = MagnetometerRoutine()
    feed(routine, readings_of(directions(reach_rad)))
    assert routine.state is RoutineState.RUNNING
    assert routine.progress < 0.5
    assert "up, down and all around" in routine.instruction
    with pytest.raises(CalibrationError, match="too few directions"):
        routine.finish()


def test_a_long_time_in_one_attitude_outweighs_nothing() -> None:
    resting = readings_of(np.tile(TUMBLING[:1], (9000, 1)), 7)
    routine = MagnetometerRoutine()
    feed(routine, np.concatenate([resting, readings_of(TUMBLING)]))
    assert worst_angle_deg(routine.finish(), SOFT_IRON, HARD_IRON) < 0.8


@pytest.mark.parametrize(
    ("readings", "word"),
    [
        (readings_of(TUMBLING[:50]), "only 50 readings"),
        (np.tile([100.0, 50.0, 400.0], (3000, 1)), "only 1 readings"),
        (readings_of(TUMBLING, noise=0.12), "off any ellipsoid"),
        (readings_of(TUMBLING, soft=np.diag([3.0, 1.0, 1.0])), "squeezed"),
        (np.full((500, 3), np.nan), "only 0 readings"),
        (np.random.default_rng(2).uniform(-500, 500, (1000, 3)), "off any ellipsoid|fit no ellipsoid"),
    ],
)
def test_garbage_is_refused_with_a_cure(readings: np.ndarray, word: str) -> None:
    routine = MagnetometerRoutine()
    feed(routine, readings)
    with pytest.raises(CalibrationError, match=word):
        routine.finish()


def test_says_that_a_magnetometer_is_stuck() -> None:
    routine = MagnetometerRoutine()
    feed(routine, np.tile([100.0, 50.0, 400.0], (500, 1)))
    assert "do not change" in routine.instruction


def test_samples_without_a_field_are_no_samples() -> None:
    routine = MagnetometerRoutine()
    routine.feed(InertialSample(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8), None))
    assert routine.progress == 0.0
    with pytest.raises(CalibrationError):
        routine.finish()
