"""The thrusters' magnetic field: found one by one, taken off, and refused where it cannot be told apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.calibration import CalibrationError
from bluerov_slam.navigation.attitude.routine import RoutineState
from bluerov_slam.navigation.attitude.thruster_field_routine import ThrusterFieldRoutine

FIELD = np.array([0.4, 0.1, 0.9])
TRUTH = np.random.default_rng(4).normal(0.0, 0.15, (6, 3))
STILL = (0.0, 0.0, 0.0)


def run(
    routine: ThrusterFieldRoutine,
    together: bool = False,
    outliers: bool = False,
    noise: float = 0.01,
    rate: tuple[float, float, float] = STILL,
) -> None:
    """Four seconds at rest, then each thruster at rising power for five, at 20 Hz; the held vehicle drifts a little."""
    random = np.random.default_rng(9)
    at_s = 0.0
    for thruster in (None, 0, 1, 2, 3, 4, 5):
        for k in range(80 if thruster is None else 100):
            effort = np.zeros(6)
            if thruster is not None:
                effort[thruster] = 0.2 + 0.006 * k
                if together:
                    effort[:] = effort[thruster]
            at_s += 0.05
            field = FIELD + np.array([0.0, 0.0005 * at_s, 0.0]) + effort @ TRUTH + random.normal(0.0, noise, 3)
            if outliers and random.random() < 0.05:
                field += random.normal(0.0, 1.0, 3)
            routine.feed(at_s, field, effort, rate)


@pytest.mark.parametrize("outliers", [False, True])
def test_each_thrusters_field_is_found(outliers: bool) -> None:
    routine = ThrusterFieldRoutine(6)
    run(routine, outliers=outliers)
    assert routine.state is RoutineState.READY
    found = routine.finish(made_unix_s=1.7e9)
    assert np.array(found.field_per_effort_frd) == pytest.approx(TRUTH, abs=0.02)
    if not outliers:
        assert found.made.residual == pytest.approx(1.0, rel=0.2)
    effort = np.array([0.3, 0.0, 0.8, 0.5, 0.0, 0.1])
    assert found.apply(FIELD + effort @ TRUTH, effort) == pytest.approx(FIELD, abs=0.02)


def test_says_which_thrusters_are_still_to_run() -> None:
    routine = ThrusterFieldRoutine(6)
    for k in range(60):
        routine.feed(0.05 * k, FIELD, [0.0, 0.5, 0.0, 0.0, 0.0, 0.0], STILL)
    assert "1, 3, 4, 5, 6" in routine.instruction
    assert routine.progress == pytest.approx(1.0 / 7.0)
    with pytest.raises(CalibrationError, match="1, 3, 4, 5, 6"):
        routine.finish()


def test_thrusters_that_only_ran_together_cannot_be_told_apart() -> None:
    routine = ThrusterFieldRoutine(6)
    run(routine, together=True)
    with pytest.raises(CalibrationError, match="run each one alone"):
        routine.finish()


def test_a_vehicle_that_turns_gives_nothing() -> None:
    routine = ThrusterFieldRoutine(6)
    run(routine, rate=(0.0, 0.0, 0.1))
    assert routine.progress == 0.0
    assert "It turns" in routine.instruction
    run(routine, rate=(math.nan, 0.0, 0.0))
    assert routine.progress == 0.0


def test_a_field_all_over_the_place_is_refused() -> None:
    routine = ThrusterFieldRoutine(6)
    run(routine, noise=0.3)
    with pytest.raises(CalibrationError):
        routine.finish()


def test_nonsense_is_left_out() -> None:
    routine = ThrusterFieldRoutine(6)
    routine.feed(0.0, (math.nan, 0.0, 0.0), [0.0] * 6, STILL)
    routine.feed(0.0, FIELD, [0.0] * 5, STILL)
    assert routine.progress == 0.0
