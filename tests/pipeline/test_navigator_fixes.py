"""Positions from outside that are wrong: one, a few, many, all; and those whose source states too large an error."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.calibration import Calibration
from bluerov_slam.navigation.ekf import Innovation
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.navigator import Navigator, NavigatorOptions
from bluerov_slam.pipeline.navigator_options import ImuOptions
from bluerov_slam.pipeline.navigator_pace import LEAD_S, Pace
from bluerov_slam.pipeline.navigator_start import LAYOUT, Start, make_filter
from bluerov_slam.records import EventLevel, GpsFix, PositionFix, Record, SensorTrust
from pipeline.navigator_records import LATITUDE_DEG, LONGITUDE_DEG, M_PER_DEG, Bench
from pipeline.navigator_runs import Run, run

FRAME = LocalFrame(LATITUDE_DEG, LONGITUDE_DEG)
Aside = Callable[[float], float]


def acoustics(
    seconds: float, aside_m: Aside = lambda _: 0.0, std_m: float | None = None, jitter_m: float = 0.1, hz: float = 1.0
) -> Iterator[PositionFix]:
    """North at 0.4 m/s; `aside_m` of the time is added to the east."""
    rng = np.random.default_rng(7)
    covariance = None if std_m is None else (std_m**2, 0.0, std_m**2)
    for step in range(round(seconds * hz)):
        at_s = step / hz
        north, east = 0.4 * at_s + jitter_m * rng.normal(), aside_m(at_s) + jitter_m * rng.normal()
        latitude, longitude, _ = FRAME.to_geodetic(north, east)
        yield PositionFix(100.0 + at_s, 100.0 + at_s, "test", latitude, longitude, covariance)


def east_m(result: Run) -> float:
    """Of the newest position, from where the first fix was."""
    assert result.last.position_ned_m is not None
    return result.last.position_ned_m[1]


def test_a_single_wild_fix_moves_nothing() -> None:
    result = run(acoustics(100.0, lambda at_s: 20.0 if at_s == 90.0 else 0.0))
    assert result.sensor("position").rejected == 1
    assert abs(east_m(result)) < 1.0
    assert not result.said("was moved")


@pytest.mark.parametrize("off_m", [20.0, 60.0])
def test_fixes_that_moved_and_agree_are_believed_after_ten_seconds_and_it_is_said(off_m: float) -> None:
    before = run(acoustics(98.0, lambda at_s: off_m if at_s >= 90.0 else 0.0))
    assert abs(east_m(before)) < 5.0
    assert before.sensor("position").trust is SensorTrust.REJECTED
    after = run(acoustics(110.0, lambda at_s: off_m if at_s >= 90.0 else 0.0))
    assert east_m(after) == pytest.approx(off_m, abs=2.0)
    assert after.last.reset_counter > before.last.reset_counter
    (event,) = [event for event in after.events if "was moved by" in event.text]
    assert event.level is EventLevel.WARNING


def test_a_short_spell_of_agreeing_echoes_is_not_followed() -> None:
    result = run(acoustics(110.0, lambda at_s: 25.0 if 90.0 <= at_s < 97.0 else 0.0))
    assert all(abs(state.position_ned_m[1]) < 5.0 for state in result.states if state.position_ned_m)
    assert not result.said("was moved")
    assert result.sensor("position").trust is SensorTrust.USED


def test_wild_fixes_that_do_not_agree_are_never_followed() -> None:
    wild = np.random.default_rng(1).uniform(20.0, 200.0, 200) * np.where(np.arange(200) % 2, 1.0, -1.0)
    result = run(acoustics(115.0, lambda at_s: float(wild[round(at_s)]) if at_s >= 90.0 else 0.0))
    assert abs(east_m(result)) < 30.0
    assert not result.said("was moved")


def test_a_vehicle_that_measures_its_motion_waits_longer() -> None:
    bench = Bench()
    jitter = np.random.default_rng(3)

    def moved(record: Record) -> list[Record]:
        if not isinstance(record, GpsFix):
            return [record]
        off_m = (25.0 if record.measured_s > 160.0 else 0.0) + 0.1 * float(jitter.normal())
        fix = bench.fix(record.measured_s, (1.0, 0.0, 1.0))
        return [replace(fix, latitude_deg=fix.latitude_deg + off_m / M_PER_DEG)]

    result = run(bench.records(80.0), moved)
    assert abs(result.last.position_ned_m[0]) < 5.0
    result.feed(bench.records(20.0), moved)
    assert result.last.position_ned_m[0] == pytest.approx(25.0, abs=3.0)
    assert result.last.reset_counter > 0


def test_fixes_that_repeat_one_place_to_the_last_digit_are_frozen() -> None:
    held: list[PositionFix] = []
    fixes = list(acoustics(140.0))
    for fix in fixes:
        frozen = fix.measured_s >= 160.0
        held.append(replace(fixes[60], measured_s=fix.measured_s, arrived_s=fix.arrived_s) if frozen else fix)
    result = run(held)
    sensor = result.sensor("position")
    assert sensor.trust is SensorTrust.IGNORED
    assert "exactly the same place" in sensor.reason
    assert result.navigator.statistics["sensors"]["position"]["faults"] == {"frozen": 60}
    # What is not measured grows uncertain again.
    stds = [math.sqrt(state.pose_covariance[0, 0]) for state in result.states if state.pose_covariance is not None]
    assert stds[-1] > 3.0 * stds[70]


@pytest.mark.parametrize("stated_m", [3.0, 9.0])
def test_a_stated_error_that_is_too_large_tells_of_the_place_and_not_of_the_next_fix(stated_m: float) -> None:
    """The fixes scatter by 0.3 m. Nobody sees whether they are all wrong by what their source states."""
    navigator = Navigator()
    results = []
    navigator.on_update = results.append
    result = Run(navigator).feed(acoustics(400.0, std_m=stated_m, jitter_m=0.3))
    told = [each for each in results if each.sensor == "position"][-100:]
    spread_m = np.sqrt([each.innovation_covariance[0, 0] for each in told])
    errors_m = np.array([each.residual[0] for each in told])
    assert 0.5 * errors_m.std() < spread_m.mean() < 2.5 * errors_m.std()
    assert spread_m.mean() < 0.4 * stated_m
    assert math.sqrt(result.last.pose_covariance[0, 0]) == pytest.approx(stated_m, rel=0.15)


def test_the_stated_error_may_be_too_small() -> None:
    navigator = Navigator()
    results = []
    navigator.on_update = results.append
    result = Run(navigator).feed(acoustics(400.0, std_m=0.5, jitter_m=0.6))
    nis = np.array([each.nis / each.dof for each in results if each.sensor == "position"][-200:])
    assert 0.6 < nis.mean() < 1.5
    assert result.sensor("position").accepted > 350


def test_a_source_that_states_more_makes_the_position_as_uncertain_and_back() -> None:
    """Out to where the source states 8 m and back: nothing of it shows from one fix to the next."""
    fixes = []
    for fix in acoustics(900.0, jitter_m=0.1):
        std_m = 2.0 if not 300.0 <= fix.measured_s - 100.0 < 600.0 else 8.0
        fixes.append(replace(fix, covariance_ne_m2=(std_m**2, 0.0, std_m**2)))
    result = run(fixes)
    at_s = np.array([state.measured_s - 100.0 for state in result.states])
    std_m = np.sqrt([state.pose_covariance[1, 1] for state in result.states])
    assert std_m[np.searchsorted(at_s, 290.0)] == pytest.approx(2.0, rel=0.15)
    assert std_m[np.searchsorted(at_s, 590.0)] == pytest.approx(8.0, rel=0.15)
    assert std_m[-1] == pytest.approx(2.0, rel=0.15)
    assert result.sensor("position").rejected < 10
    assert max(abs(state.position_ned_m[1]) for state in result.states if state.position_ned_m) < 2.0


def settled_filter():
    options = NavigatorOptions()
    filter_ = make_filter(Start.upright(0.0), options, Calibration(), 0.0, 0.5, None)
    filter_.covariance[:2, :2] = 0.01 * np.eye(2)
    return filter_


@pytest.mark.parametrize(("speed_mps", "expected_mps"), [(0.4, 0.4), (0.02, 0.15), (3.0, 0.7)])
def test_the_pace_is_learned_within_its_limits(speed_mps: float, expected_mps: float) -> None:
    """A vehicle whose velocity is the very process: forecasts from the truth, compared with the truth."""
    options = ImuOptions()
    pace, filter_, rng = Pace(options), settled_filter(), np.random.default_rng(11)
    left = math.exp(-1.0 / options.kinematic_velocity_time_s)
    place, velocity, learned = np.zeros(2), np.zeros(2), []
    filter_.covariance[3:5, 3:5] = 1e-6 * np.eye(2)
    current = LAYOUT["current"]
    filter_.covariance[current, current] = 1e-6 * np.eye(2)
    jacobian = np.zeros((2, LAYOUT.size))
    jacobian[:, :2] = np.eye(2)
    filter_.covariance[:2, :2] = 1e-4 * np.eye(2)
    for second in range(3000):
        filter_.estimate.at_s = float(second)
        filter_.estimate.values[3:5] = velocity
        pace.compare(float(second), place, 1e-4 * np.eye(2), np.zeros((2, 2)), 30.0)
        pace.begin(filter_, place, Innovation(np.zeros(2), jacobian, np.zeros((2, 2))))
        learned.append(pace.speed_std_mps)
        # Finely, so that the place follows the velocity.
        for _ in range(10):
            kept = left**0.1
            place = place + 0.1 * velocity
            velocity = kept * velocity + speed_mps * math.sqrt(1.0 - kept * kept) * rng.normal(size=2)
    assert np.mean(learned[300:]) == pytest.approx(expected_mps, rel=0.15)


def test_one_wild_fix_teaches_the_pace_little_and_a_held_pace_nothing() -> None:
    pace, filter_ = Pace(ImuOptions()), settled_filter()
    jacobian = np.zeros((2, LAYOUT.size))
    jacobian[:, :2] = np.eye(2)
    innovation = Innovation(np.zeros(2), jacobian, np.zeros((2, 2)))
    pace.compare(-1.0, np.zeros(2), np.eye(2), np.zeros((2, 2)), 30.0)
    pace.begin(filter_, np.zeros(2), innovation)
    pace.compare(LEAD_S, np.array([500.0, 0.0]), np.eye(2), np.zeros((2, 2)), 30.0)
    assert 0.5 < pace.speed_std_mps < 0.65 * 1.5
    learned = pace.speed_std_mps
    pace.hold()
    pace.compare(LEAD_S + 1.0, np.array([500.0, 0.0]), np.eye(2), np.zeros((2, 2)), 30.0)
    assert pace.speed_std_mps == learned
