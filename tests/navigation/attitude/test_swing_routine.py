"""Compass swing against the gyro and under GPS, with known deviations."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.calibration import CalibrationError
from bluerov_slam.navigation.attitude.routine import RoutineState
from bluerov_slam.navigation.attitude.swing_routine import CourseSwingRoutine, TurnSwingRoutine

DEGREE = math.radians(1.0)


def turn(
    routine: TurnSwingRoutine,
    seed: int = 0,
    abc: tuple[float, float, float] = (0.05, 0.06, -0.04),
    rate_radps: float = 10.0 * DEGREE,
    turns: float = 2.1,
    bias_radps: float = 0.1 * DEGREE,
    scale: float = 1.01,
    noise_rad: float = 0.5 * DEGREE,
) -> float:
    """A turn on the spot at 20 Hz; the compass carries a wander of one degree over a minute beside its deviation."""
    random = np.random.default_rng(seed)
    a, b, c = abc
    phase = random.uniform(0.0, 6.0)
    heading, dt = random.uniform(-3.0, 3.0), 0.05
    steps = round(turns * 2.0 * math.pi / abs(rate_radps) / dt)
    for k in range(steps):
        t = k * dt
        rate = rate_radps * (1.0 + 0.3 * math.sin(0.5 * t))
        heading += rate * dt
        compass = heading + a + b * math.cos(heading) + c * math.sin(heading)
        compass += 0.5 * DEGREE * math.sin(0.1 * t + phase) + random.normal(0.0, noise_rad)
        routine.feed(t, math.remainder(compass, 2.0 * math.pi), rate * scale + bias_radps + random.normal(0.0, 0.001))
    return steps * dt


@pytest.mark.parametrize("seed", range(12))
def test_two_turns_give_b_and_c(seed: int) -> None:
    b, c = np.random.default_rng(seed).uniform(-8.0 * DEGREE, 8.0 * DEGREE, 2)
    rate_dps = (-12.0, 8.0, 15.0)[seed % 3]
    routine = TurnSwingRoutine()
    turn(routine, seed, (0.03, b, c), rate_dps * DEGREE)
    assert routine.state is RoutineState.READY
    found = routine.finish(made_unix_s=1.7e9)
    errors = np.array([found.b_rad - b, found.c_rad - c])
    # A of 1.7 degrees turns the pattern by as much; the wander of the compass is the rest.
    assert (np.abs(errors) < 0.8 * DEGREE).all()
    assert (np.abs(errors) < 5.0 * np.array(found.std_rad[1:])).all()
    assert found.a_rad == 0.0
    assert found.std_rad[0] == pytest.approx(3.0 * DEGREE)
    assert "A cannot be seen" in found.made.source
    assert 0.4 < found.made.residual < 1.0


def test_it_says_how_far_to_turn_and_does_not_finish_early() -> None:
    routine = TurnSwingRoutine()
    turn(routine, turns=1.0, scale=1.0, bias_radps=0.0)
    assert routine.progress == pytest.approx(0.5, abs=0.03)
    to_go = re.search(r"(\d+) degrees to go", routine.instruction)
    assert to_go is not None
    assert int(to_go[1]) == pytest.approx(360, abs=5)
    with pytest.raises(CalibrationError, match="turn on slowly"):
        routine.finish()


def test_swinging_to_and_fro_is_not_two_turns() -> None:
    routine = TurnSwingRoutine()
    for k in range(4000):
        routine.feed(0.05 * k, 0.5 * math.sin(0.02 * k), 0.2 * math.cos(0.02 * k))
    assert routine.progress < 0.15


@pytest.mark.parametrize(("rate_dps", "word"), [(45.0, "Too fast"), (-60.0, "Too fast")])
def test_a_fast_turn_begins_again(rate_dps: float, word: str) -> None:
    routine = TurnSwingRoutine()
    turn(routine, rate_radps=rate_dps * DEGREE)
    assert word in routine.instruction
    assert routine.progress < 0.5


def test_a_gap_begins_again() -> None:
    routine = TurnSwingRoutine()
    turn(routine, turns=1.5)
    routine.feed(1000.0, 0.0, 0.1)
    assert routine.progress == 0.0
    assert "gap" in routine.instruction


@pytest.mark.parametrize(
    ("abc", "noise_deg", "word"),
    [((0.0, 0.8, 0.0), 0.5, "magnetometer first|left over"), ((0.0, 0.1, 0.0), 12.0, "left over")],
)
def test_turns_that_make_no_sense_are_refused(abc: tuple[float, float, float], noise_deg: float, word: str) -> None:
    routine = TurnSwingRoutine()
    turn(routine, abc=abc, noise_rad=noise_deg * DEGREE)
    with pytest.raises(CalibrationError, match=word):
        routine.finish()


def drive(
    routine: CourseSwingRoutine,
    seed: int = 0,
    abc: tuple[float, float, float] = (0.05, 0.06, -0.04),
    current: tuple[float, float] = (0.2, -0.15),
    speed_mps: float = 0.6,
    headings: int = 8,
    seconds: int = 60,
    noise_mps: float = 0.15,
) -> None:
    """So many legs on evenly spread headings, one GPS velocity a second, its error shared by three neighbours."""
    random = np.random.default_rng(seed)
    a, b, c = abc
    for leg in range(headings):
        heading = 2.0 * math.pi * leg / headings + 0.3
        error = np.zeros(2)
        for k in range(seconds):
            if k % 3 == 0:
                error = random.normal(0.0, noise_mps, 2)
            north = speed_mps * math.cos(heading) + current[0] + error[0]
            east = speed_mps * math.sin(heading) + current[1] + error[1]
            compass = heading + a + b * math.cos(heading) + c * math.sin(heading) + random.normal(0.0, 0.01)
            routine.feed(math.remainder(compass, 2 * math.pi), math.hypot(north, east), math.atan2(east, north), 1.0)


@pytest.mark.parametrize("seed", range(10))
def test_driving_gives_all_three_whatever_the_current(seed: int) -> None:
    random = np.random.default_rng(seed)
    abc, current = random.uniform(-8.0 * DEGREE, 8.0 * DEGREE, 3), random.uniform(-0.3, 0.3, 2)
    routine = CourseSwingRoutine()
    drive(routine, seed, tuple(abc), tuple(current))
    assert routine.state is RoutineState.READY
    found = routine.finish()
    errors = np.array([found.a_rad, found.b_rad, found.c_rad]) - abc
    assert (np.abs(errors) < 4.0 * np.array(found.std_rad)).all()
    assert max(found.std_rad) < 2.5 * DEGREE
    assert found.made.unit == "deg"


def test_a_straight_run_is_not_enough_and_says_which_headings_are_missing() -> None:
    routine = CourseSwingRoutine()
    drive(routine, headings=1, seconds=400)
    assert routine.state is RoutineState.RUNNING
    assert "Headings still to drive" in routine.instruction
    with pytest.raises(CalibrationError, match="drive on"):
        routine.finish()


def test_drifting_or_jumping_fixes_are_refused() -> None:
    for bad in ({"speed_mps": 0.05}, {"noise_mps": 2.0}):
        routine = CourseSwingRoutine()
        drive(routine, **bad)  # type: ignore[arg-type]
        with pytest.raises(CalibrationError):
            routine.finish()
    routine = CourseSwingRoutine()
    for senseless in ((0.0, None, 0.0), (0.0, 1.0, None), (math.nan, 1.0, 0.0), (0.0, math.inf, 0.0)):
        routine.feed(*senseless)
    routine.feed(0.0, 0.5, 0.0, water_speed_mps=0.0)
    with pytest.raises(CalibrationError, match="only 0 GPS"):
        routine.finish()
