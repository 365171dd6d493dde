"""Logs of a vehicle without our link: attitude, depth and height of the autopilot."""

import math

import numpy as np
import pytest

from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.pipeline.navigator_aids import SlowThroughWater
from bluerov_slam.pipeline.navigator_start import LAYOUT
from bluerov_slam.records import (
    NavMode,
    NavState,
    PositionFix,
    SensorTrust,
    VehicleAttitude,
    VehicleDepth,
    VehicleRange,
)
from pipeline.navigator_records import sensor_sample

SURFACE_PA = 101_500.0
PA_PER_M = 1025.0 * 9.80665


def run(records) -> NavState:
    navigator = Navigator()
    states = [result for record in records for result in navigator.feed(record) if isinstance(result, NavState)]
    return states[-1]


def attitude(at_s: float) -> VehicleAttitude:
    wobble = 0.01 * math.sin(at_s)
    return VehicleAttitude(at_s, round(at_s * 1000), wobble, -wobble, 0.5 + wobble, (0.0, 0.0, math.nan))


def dive(depth, until_s: float = 60.0):
    """Ten seconds at the surface, then down to 5 m at 0.2 m/s; the depth as `depth(at_s, depth_m)` says it."""
    for step in range(round(until_s * 5)):
        at_s = 10.0 + step * 0.2
        depth_m = min(5.0, max(0.0, 0.2 * (at_s - 20.0)))
        yield attitude(at_s)
        yield depth(at_s + 0.05, depth_m + 0.002 * math.sin(7.0 * at_s))


def test_the_vehicles_pressure_gives_the_depth():
    state = run(dive(lambda at_s, m: VehicleDepth(at_s, round(at_s * 1000), SURFACE_PA + m * PA_PER_M, None, 12.0)))
    assert state.depth_m == pytest.approx(5.0, abs=0.1)
    assert state.depth_std_m is not None
    assert 0.0 < state.depth_std_m < 0.5


def test_a_log_that_rounds_its_depth_gives_it_all_the_same():
    state = run(dive(lambda at_s, m: VehicleDepth(at_s, round(at_s * 1000), None, round(m / 0.1) * 0.1, None)))
    assert state.depth_m == pytest.approx(5.0, abs=0.1)
    (sensor,) = [sensor for sensor in state.sensors if sensor.name == "depth"]
    assert sensor.trust is SensorTrust.USED


def test_the_links_pressure_goes_before_the_vehicles():
    records = []
    for record in dive(lambda at_s, m: VehicleDepth(at_s, round(at_s * 1000), 400_000.0, None, None)):
        if isinstance(record, VehicleDepth):
            pressure_pa = SURFACE_PA + 3.0 * math.sin(record.arrived_s)
            records.append(
                sensor_sample(record.arrived_s, pressure_pa=pressure_pa, device_ms=round(1000.0 * record.arrived_s))
            )
        records.append(record)
    state = run(records)
    assert state.depth_m == pytest.approx(0.0, abs=0.1)


def test_a_height_is_shown_while_it_is_new():
    navigator = Navigator()
    navigator.feed(attitude(10.0))
    navigator.feed(VehicleRange(10.1, 10_100, 3.25, None))
    shown = [state for state in navigator.feed(attitude(10.2)) if isinstance(state, NavState)]
    assert shown[-1].altitude_m == 3.25
    later = [s for step in range(100) for s in navigator.feed(attitude(10.4 + step * 0.2)) if isinstance(s, NavState)]
    assert later[-1].altitude_m is None


@pytest.mark.parametrize(
    ("distance_m", "quality", "words"),
    [(math.nan, None, "not numbers"), (-1.0, 80, "impossible"), (4.0, 5, "does not believe its own echo")],
)
def test_a_height_that_is_none_is_not_shown_and_it_is_said(distance_m, quality, words):
    navigator = Navigator()
    navigator.feed(attitude(10.0))
    navigator.feed(VehicleRange(10.1, 10_100, distance_m, quality))
    shown = [state for state in navigator.feed(attitude(10.2)) if isinstance(state, NavState)][-1]
    assert shown.altitude_m is None
    told = next(sensor for sensor in shown.sensors if sensor.name == "altitude")
    assert told.trust is SensorTrust.IGNORED
    assert words in told.reason
    navigator.feed(VehicleRange(10.3, 10_300, 4.0, 80))
    states = [state for step in range(40) for state in navigator.feed(attitude(10.4 + 0.05 * step))]
    assert next(state for state in states if isinstance(state, NavState)).altitude_m == 4.0


def test_fixes_alone_make_a_track():
    navigator = Navigator()
    states: list[NavState] = []
    for step in range(240):
        at_s = 100.0 + step * 0.5
        place = (48.1 + 0.3 * at_s / 111_195.0, -4.5)
        fix = PositionFix(at_s, at_s + 0.1, "acoustics", *place, (1.0, 0.0, 1.0), 3.0)
        states += [result for result in navigator.feed(fix) if isinstance(result, NavState)]
    assert states[0].measured_s > 109.0
    last = states[-1]
    assert last.mode is NavMode.AIDED
    assert last.velocity_ned_mps is not None
    assert last.velocity_ned_mps[:2] == pytest.approx((0.3, 0.0), abs=0.15)
    assert last.depth_m is None
    # No sensor tells a heading: none may be learnt, however long the vehicle moves.
    assert all(math.degrees(math.sqrt(state.pose_covariance[5, 5])) > 50.0 for state in states)
    assert last.quaternion_ned_frd is None
    late = [result for result in navigator.feed(attitude(221.0)) if isinstance(result, NavState)]
    assert late


def test_the_speed_limits_jacobian_is_that_of_finite_differences():
    estimate = NavEstimate(
        LAYOUT, 0.0, rotation_from_euler(0.1, -0.2, 2.0), velocity=(0.4, -0.3, 0.1), current=(0.2, 0.1)
    )
    limit = SlowThroughWater(0.0, 0.5, 0.25)
    nominal = limit.evaluate(estimate, LAYOUT)
    assert nominal is not None
    for place in range(LAYOUT.size):
        error = np.zeros(LAYOUT.size)
        error[place] = 1e-6
        moved = estimate.copy()
        moved.add_error(error)
        after = limit.evaluate(moved, LAYOUT)
        assert after is not None
        slope = (nominal.residual - after.residual) / 1e-6
        np.testing.assert_allclose(slope, nominal.jacobian[:, place], atol=1e-6)
