"""Guided calibration of gyro and accelerometer on synthetic sensors with a known truth."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bluerov_slam.navigation.attitude.accelerometer_routine import FACES, AccelerometerRoutine
from bluerov_slam.navigation.attitude.calibration import CalibrationError
from bluerov_slam.navigation.attitude.gyro_routine import GyroRoutine
from bluerov_slam.navigation.attitude.routine import InertialSample, RoutineState
from inertial_samples import GRAVITY_MPS2

RATE_HZ = 20.0
Vectors = Callable[[float], np.ndarray]
UPRIGHT = np.array([0.0, 0.0, -GRAVITY_MPS2])
FIELD = np.array([200.0, 0.0, 400.0])


def feed(
    routine: GyroRoutine | AccelerometerRoutine,
    seconds: float,
    seed: int = 0,
    start_s: float = 0.0,
    rate: Vectors = lambda t: np.zeros(3),
    force: Vectors = lambda t: UPRIGHT,
    field: Vectors = lambda t: FIELD,
    noise: float = 1.0,
) -> float:
    """Samples of a quiet consumer sensor (0.06 deg/s, 0.03 m/s2 rms); returns when they end."""
    random = np.random.default_rng(seed)
    for k in range(round(seconds * RATE_HZ)):
        t = start_s + k / RATE_HZ
        routine.feed(
            InertialSample(
                t,
                tuple(rate(t) + noise * random.normal(0.0, math.radians(0.06), 3)),
                tuple(force(t) + noise * random.normal(0.0, 0.03, 3)),
                tuple(field(t) + noise * random.normal(0.0, 3.0, 3)),
            )
        )
    return start_s + seconds


bias_radps = st.floats(-math.radians(2.0), math.radians(2.0))


@settings(max_examples=15, deadline=None)
@given(st.tuples(bias_radps, bias_radps, bias_radps), st.integers(0, 99))
def test_gyro_bias_is_found_within_its_stated_error(bias: tuple[float, float, float], seed: int) -> None:
    routine = GyroRoutine()
    feed(routine, 12.0, seed, rate=lambda t: np.array(bias))
    assert routine.state is RoutineState.READY
    assert routine.progress == 1.0
    found = routine.finish(made_unix_s=1.7e9)
    errors = np.abs(np.subtract(found.bias_frd_radps, bias)) / found.std_radps
    assert (errors < 5.0).all()
    assert max(found.std_radps) < math.radians(0.01)
    assert found.made.unit == "deg/s"
    assert found.made.residual == pytest.approx(0.06 / math.sqrt(RATE_HZ), rel=0.5)
    assert found.made.made_unix_s == 1.7e9


def test_gyro_counts_up_and_is_not_finished_early() -> None:
    routine = GyroRoutine()
    feed(routine, 5.5)
    assert routine.progress == pytest.approx(0.5)
    assert "do not touch" in routine.instruction
    with pytest.raises(CalibrationError, match="5 still seconds"):
        routine.finish()


@pytest.mark.parametrize(
    ("disturbance", "word"),
    [
        ({"rate": lambda t: np.array([0.0, 0.1 * math.sin(3.0 * t), 0.0])}, "moved"),  # bobbing in waves
        ({"force": lambda t: UPRIGHT + np.array([0.0, 0.5 * math.sin(5.0 * t), 0.0])}, "moved"),
        ({"rate": lambda t: np.array([0.0, 0.0, 0.2])}, "deg/s"),  # a steady turn
        ({"noise": 0.0}, "do not change"),
    ],
)
def test_gyro_refuses_motion_and_frozen_sensors(disturbance: dict[str, object], word: str) -> None:
    routine = GyroRoutine()
    feed(routine, 30.0, **disturbance)  # type: ignore[arg-type]
    assert word in routine.instruction
    with pytest.raises(CalibrationError, match="leave the vehicle alone"):
        routine.finish()


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_gyro_notices_a_slow_even_turn(axis: str) -> None:
    omega = math.radians(1.0)

    def field(t: float) -> np.ndarray:
        c, s = math.cos(omega * t), math.sin(omega * t)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ FIELD

    def force(t: float) -> np.ndarray:
        return GRAVITY_MPS2 * np.array([0.0, -math.sin(omega * t), -math.cos(omega * t)])

    routine = GyroRoutine()
    if axis == "vertical":
        feed(routine, 30.0, rate=lambda t: np.array([0.0, 0.0, omega]), field=field)
    else:
        feed(routine, 30.0, rate=lambda t: np.array([omega, 0.0, 0.0]), force=force)
    assert routine.state is RoutineState.RUNNING
    assert "moved slowly" in routine.instruction


def test_gyro_begins_again_after_a_knock() -> None:
    routine = GyroRoutine()
    at_s = feed(routine, 8.5)
    at_s = feed(routine, 1.5, 1, at_s, rate=lambda t: np.array([0.3 * math.sin(20.0 * t), 0.0, 0.0]))
    assert routine.progress < 0.2
    feed(routine, 11.5, 2, at_s, rate=lambda t: np.array([0.0, 0.01, 0.0]))
    assert routine.finish().bias_frd_radps == pytest.approx((0.0, 0.01, 0.0), abs=math.radians(0.02))


def test_gaps_nonsense_and_time_going_back_do_no_harm() -> None:
    routine = GyroRoutine()
    for bad in (math.nan, math.inf):
        routine.feed(InertialSample(0.0, (bad, 0.0, 0.0), (0.0, 0.0, -9.8), None))
        routine.feed(InertialSample(bad, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8), None))
    at_s = feed(routine, 6.5)
    feed(routine, 6.5, 1, at_s - 100.0)
    assert routine.state is RoutineState.READY


def direction_of(face: tuple[int, int]) -> np.ndarray:
    up = np.zeros(3)
    up[face[0]] = face[1]
    return up


def hold(
    routine: AccelerometerRoutine,
    directions: list[np.ndarray],
    offset: np.ndarray,
    error: np.ndarray,
    seed: int = 0,
    tilt_deg: float = 6.0,
) -> None:
    """Each direction for 4.5 s, not quite straight, handled for a second in between; reading = error f + offset."""
    random = np.random.default_rng(seed + 1000)
    at_s = 0.0
    for up in directions:
        tilted = up + math.radians(tilt_deg) * random.uniform(-1.0, 1.0, 3)
        reading = error @ (GRAVITY_MPS2 * tilted / np.linalg.norm(tilted)) + offset
        at_s = feed(routine, 4.5, seed, at_s, force=lambda t, reading=reading: reading)
        at_s = feed(routine, 1.0, seed, at_s, rate=lambda t: np.array([math.sin(9.0 * t), 0.0, 0.0]))


offsets = st.floats(-0.4, 0.4)
scales = st.floats(0.97, 1.03)
small = st.floats(-0.02, 0.02)


@settings(max_examples=10, deadline=None)
@given(st.tuples(offsets, offsets, offsets), st.tuples(scales, scales, scales), st.integers(0, 99))
def test_six_faces_give_offset_and_scale_though_not_level(
    offset: tuple[float, float, float], scale: tuple[float, float, float], seed: int
) -> None:
    routine = AccelerometerRoutine()
    hold(routine, [direction_of(face) for face in FACES], np.array(offset), np.diag(scale), seed)
    assert routine.state is RoutineState.READY
    found = routine.finish()
    # 0.03 m/s2 over 60 to 90 samples per face: a few mm/s2.
    assert found.offset_frd_mps2 == pytest.approx(offset, abs=0.02)
    assert 1.0 / np.diag(found.matrix) == pytest.approx(np.array(scale), abs=0.002)
    assert found.made.residual < 0.03
    assert found.made.unit == "m/s2"


@settings(max_examples=5, deadline=None)
@given(st.tuples(small, small, small), st.integers(0, 99))
def test_tilted_poses_give_the_misalignment_too(cross: tuple[float, float, float], seed: int) -> None:
    error = np.diag([1.02, 0.98, 1.01])
    error[0, 1], error[0, 2], error[1, 2] = cross
    offset = np.array([0.1, -0.2, 0.15])
    edges = [
        np.array(e, float) for e in ((1, 1, 0), (1, -1, 0), (0, 1, 1), (0, 1, -1), (1, 0, 1), (-1, 0, 1), (-1, -1, 1))
    ]
    routine = AccelerometerRoutine(solve_misalignment=True)
    faces = [direction_of(face) for face in FACES]
    hold(routine, faces, offset, error, seed)
    assert routine.state is RoutineState.RUNNING
    assert "tilted" in routine.instruction
    routine = AccelerometerRoutine(solve_misalignment=True)
    hold(routine, faces + edges, offset, error, seed)
    found = routine.finish()
    truth = np.random.default_rng(seed).normal(size=(50, 3))
    truth *= GRAVITY_MPS2 / np.linalg.norm(truth, axis=1, keepdims=True)
    corrected = found.apply(truth @ error.T + offset)
    # The frame is the sensor's x axis by convention: the length is what can be checked.
    assert np.linalg.norm(corrected, axis=1) == pytest.approx(np.full(50, GRAVITY_MPS2), abs=0.03)
    assert corrected == pytest.approx(truth, abs=0.05)


def test_names_the_faces_that_are_missing_and_the_one_that_is_held() -> None:
    routine = AccelerometerRoutine()
    assert routine.missing == list(FACES.values())
    directions = [direction_of(face) for face in list(FACES)[:4]]
    hold(routine, directions, np.zeros(3), np.eye(3))
    assert routine.missing == ["starboard side down", "port side down"]
    assert routine.progress == pytest.approx(4.0 / 6.0)
    assert "It moves" in routine.instruction
    feed(routine, 2.0, start_s=100.0)
    assert "Held now: upright" in routine.instruction
    with pytest.raises(CalibrationError, match="starboard side down, port side down"):
        routine.finish()


@pytest.mark.parametrize(
    ("offset", "error", "word"),
    [
        (np.array([2.0, 0.0, 0.0]), np.eye(3), "defective"),
        (np.zeros(3), np.diag([1.0, 1.3, 1.0]), "defective"),
    ],
)
def test_accelerometer_refuses_what_no_sound_sensor_has(offset: np.ndarray, error: np.ndarray, word: str) -> None:
    routine = AccelerometerRoutine()
    hold(routine, [direction_of(face) for face in FACES], offset, error)
    with pytest.raises(CalibrationError, match=word):
        routine.finish()


def test_accelerometer_takes_nothing_from_a_sensor_that_moves_or_is_dead() -> None:
    routine = AccelerometerRoutine()
    feed(routine, 20.0, rate=lambda t: np.array([math.sin(5.0 * t), 0.0, 0.0]))
    feed(routine, 20.0, start_s=30.0, force=lambda t: np.zeros(3))
    feed(routine, 20.0, start_s=60.0, noise=0.0)
    assert routine.progress == 0.0
    assert "do not change" in routine.instruction
