import math

import numpy as np
import pytest

from bluerov_slam.simulation import flight as columns
from bluerov_slam.simulation.conditions import conditions_of
from bluerov_slam.simulation.flight import STEP_S, Flight
from bluerov_slam.simulation.hull import FLOATING_DEPTH_M, drag_n
from bluerov_slam.simulation.routes import DepthPlan, JoinedRoutes, LegRoute, SwingRoute, lawnmower_corners
from bluerov_slam.simulation.survey_route import SurveyRoute
from bluerov_slam.simulation.thrusters import FRAMES, thrust_n

AFLOAT = DepthPlan(((0.0, None),))
DIVES = DepthPlan(((0.0, None), (30.0, 6.0), (150.0, None)))


def yaw_rad(rows: np.ndarray) -> np.ndarray:
    w, x, y, z = rows[:, columns.QUATERNION].T
    return np.unwrap(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))


def lean_deg(rows: np.ndarray) -> np.ndarray:
    _, x, y, _ = rows[:, columns.QUATERNION].T
    return np.degrees(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))


@pytest.mark.parametrize("thrusters", [6, 8])
@pytest.mark.parametrize(("name", "family"), [("calm", "nominal"), ("hard", "mismatched")])
def test_the_pilot_keeps_the_line_the_depth_and_the_vehicle_upright(name: str, family: str, thrusters: int) -> None:
    route = LegRoute([(0.0, 0.0), (0.0, 55.0), (40.0, 55.0)], 0.5, DIVES, rest_s=10.0)
    rows = Flight(route, conditions_of(name, family), 3, frame=FRAMES[thrusters]).fly(int(200.0 / STEP_S))
    along = rows[int(30.0 / STEP_S) : int(110.0 / STEP_S)]
    assert np.abs(along[:, 0]).max() < 3.0
    under_water = rows[int(80.0 / STEP_S) : int(145.0 / STEP_S)]
    assert under_water[:, 2] == pytest.approx(6.0, abs=0.4)
    assert rows[-1, 2] < 0.45
    assert math.dist(rows[-1, :2], (40.0, 55.0)) < 3.0
    assert lean_deg(rows).max() < 30.0


def test_afloat_the_thrusters_that_push_down_rest() -> None:
    rows = Flight(LegRoute([(0.0, 0.0), (30.0, 0.0)], 0.5, AFLOAT), conditions_of("calm"), 1).fly(600)
    assert np.all(rows[:, columns.FIRST_PWM + 4 :] == 1500)
    assert rows[:, 2].mean() == pytest.approx(FLOATING_DEPTH_M, abs=0.02)


def test_a_swing_turns_twice_on_the_spot() -> None:
    route = SwingRoute(2.0, 40.0, AFLOAT, rest_s=5.0)
    rows = Flight(route, conditions_of("calm"), 2).fly(int(95.0 / STEP_S))
    turned = yaw_rad(rows)
    assert turned[-1] - turned[0] == pytest.approx(4.0 * math.pi, abs=0.2)
    assert np.hypot(*rows[:, :2].T).max() < 2.5


def test_in_steady_motion_thrust_is_drag() -> None:
    route = LegRoute([(0.0, 0.0), (90.0, 0.0)], 0.5, DepthPlan(((0.0, 5.0),)))
    flight = Flight(route, conditions_of("still"), 4)
    rows = flight.fly(int(150.0 / STEP_S))[int(40.0 / STEP_S) :]
    pushed = np.zeros(len(rows))
    for number in range(4):
        sign = flight._frame.effect[number][0]
        pushed += [sign * thrust_n(p, v) for p, v in zip(rows[:, 27 + number], rows[:, columns.VOLTAGE], strict=True)]
    speed = rows[:, columns.THROUGH_WATER][:, 0].mean()
    expected_n = drag_n(speed / (1.0 + flight.hull.surge_scale))
    assert pushed.mean() == pytest.approx(expected_n, rel=0.04)


def test_the_same_seed_flies_the_same_dive_however_it_is_cut() -> None:
    def flight(seed: int) -> Flight:
        return Flight(SurveyRoute(5.0), conditions_of("hard", "mismatched"), seed, 30.0)

    whole = flight(7).fly(1_000)
    pieces = flight(7)
    assert np.array_equal(np.concatenate([pieces.fly(n) for n in (1, 99, 400, 500)]), whole)
    assert not np.array_equal(flight(8).fly(1_000), whole)


def test_in_more_current_than_it_can_stem_the_schedule_waits() -> None:
    conditions = conditions_of("hard")
    for seed in range(400):
        flight = Flight(LegRoute(lawnmower_corners(), 0.5, AFLOAT), conditions, seed)
        north = flight.ocean.current_ned_mps(0.0, 0.0)[0]
        if north < -0.38 and flight.hull.surge_scale < 0.0:
            break
    rows = flight.fly(int(120.0 / STEP_S))
    assert flight._pilot.behind_s > 5.0
    assert 5.0 < rows[-1, 0] < 55.0
    assert np.abs(rows[:, 1]).max() < 4.0


def test_depth_plans_take_their_time_and_routes_join() -> None:
    assert DIVES.depth_m(10.0) is None
    assert DIVES.depth_m(35.0) == pytest.approx(1.5)
    assert DIVES.depth_m(100.0) == 6.0
    assert DIVES.depth_m(155.0) == pytest.approx(4.5)
    assert DIVES.depth_m(171.0) is None
    assert DepthPlan(((0.0, 5.0),)).depth_m(0.0) == 5.0
    joined = JoinedRoutes(SwingRoute(1.0, 30.0, AFLOAT, 0.0), LegRoute([(0.0, 0.0), (10.0, 0.0)], 0.5, AFLOAT))
    assert joined.end_s == pytest.approx(50.0)
    assert joined.target(40.0).north_m == pytest.approx(5.0)
    assert LegRoute(lawnmower_corners(), 0.5, AFLOAT).length_m == pytest.approx(980.0)
    assert LegRoute(lawnmower_corners(), 0.5, AFLOAT).end_s == pytest.approx(1960.0)
