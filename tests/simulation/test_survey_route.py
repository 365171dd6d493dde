import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.simulation.survey_route import SPEED_MPS, SURFACE_TIME_S, SurveyRoute

STEP_S = 0.05


@given(st.floats(0.0, 3_000.0))
def test_the_survey_moves_and_turns_without_jumps(schedule_s: float) -> None:
    route = SurveyRoute(9.0)
    before, after = route.target(schedule_s), route.target(schedule_s + STEP_S)
    assert math.hypot(after.north_m - before.north_m, after.east_m - before.east_m) <= SPEED_MPS * STEP_S + 1.0e-9
    assert abs((after.depth_m or 0.15) - (before.depth_m or 0.15)) < 0.7 * STEP_S
    turned_rad = math.remainder(after.heading_rad - before.heading_rad, 2.0 * math.pi)
    assert abs(turned_rad) < 0.3 * STEP_S


def test_the_survey_starts_afloat_then_dives_then_comes_up_again() -> None:
    route = SurveyRoute(9.0)
    assert route.target(SURFACE_TIME_S / 2).depth_m is None
    assert route.target(120.0).depth_m == pytest.approx(9.0, abs=0.1)
    afloat = [route.target(float(t)).depth_m is None for t in range(60, 900)]
    assert sum(now and not before for before, now in itertools.pairwise(afloat)) >= 2


def test_the_track_closes() -> None:
    route = SurveyRoute(9.0)
    start = route.target(100.0)
    turn_m = math.pi * 5.0
    length_m = 6 * 50.0 + 5 * turn_m + turn_m + 40.0
    again = route.target(100.0 + length_m / SPEED_MPS)
    assert (again.north_m, again.east_m) == pytest.approx((start.north_m, start.east_m), abs=1e-6)
