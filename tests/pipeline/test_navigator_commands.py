import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.navigator import Navigator, NavigatorAction, NavigatorCommand, SavedNavigation
from bluerov_slam.records import EventLevel, GpsFix, ImuBurst, NavMode, Record
from pipeline.navigator_records import LATITUDE_DEG, LONGITUDE_DEG, Bench
from pipeline.navigator_runs import Run, run


def no_gps(record: Record) -> Record | None:
    return None if isinstance(record, GpsFix) else record


def saved_in_mid_dive() -> tuple[Bench, Run, SavedNavigation]:
    bench = Bench()
    result = run(bench.records(30.0))
    result.feed(bench.records(10.0), no_gps)
    return bench, result, result.navigator.save()


def test_a_save_survives_json() -> None:
    _, _, saved = saved_in_mid_dive()
    assert SavedNavigation.from_json(json.loads(json.dumps(saved.to_json()))) == saved


def test_a_restart_in_mid_dive_goes_on_less_certain_than_before() -> None:
    bench, before, saved = saved_in_mid_dive()
    bench.start_s += 20.0  # nobody looked for so long
    after = run(bench.records(5.0), no_gps, Navigator(saved=saved))
    assert after.said("Going on from the position of")
    assert after.last.mode is NavMode.DEAD_RECKONING
    assert after.last.origin_deg == before.last.origin_deg
    moved = np.subtract(after.last.position_ned_m, before.last.position_ned_m)
    assert np.abs(moved).max() < 15.0
    added = after.last.pose_covariance[0, 0] - before.last.pose_covariance[0, 0]
    assert math.sqrt(added) > 0.5 * 20.0 * 0.6
    assert after.last.reset_counter > before.last.reset_counter
    assert after.last.depth_m == pytest.approx(0.0, abs=0.3)
    after.feed(bench.records(15.0))
    assert after.last.mode is NavMode.AIDED


def test_a_restart_under_water_keeps_the_zero_of_the_depth() -> None:
    bench = Bench()
    result = run(bench.records(20.0))
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.ZERO_DEPTH)))
    bench.depth_m = 10.0
    result.feed(bench.records(20.0), no_gps)
    assert result.last.depth_m == pytest.approx(10.0, abs=0.1)
    after = run(bench.records(5.0), no_gps, Navigator(saved=result.navigator.save()))
    # The air weighed 575 Pa more than the standard atmosphere.
    assert after.last.depth_m == pytest.approx(result.last.depth_m, abs=0.02)


def test_the_same_restart_twice_is_the_same() -> None:
    bench, _, saved = saved_in_mid_dive()
    records = list(bench.records(5.0))
    states = [run(records, navigator=Navigator(saved=saved)).states for _ in range(2)]
    assert [state.position_ned_m for state in states[0]] == [state.position_ned_m for state in states[1]]


def test_the_stated_age_counts_where_the_clock_started_anew() -> None:
    bench, _, saved = saved_in_mid_dive()
    bench.start_s = 7.0
    young = run(bench.records(5.0), no_gps, Navigator(saved=saved, saved_age_s=30.0))
    assert young.said("Going on")
    bench.start_s = 7.0
    unknown = run(bench.records(5.0), no_gps, Navigator(saved=saved))
    assert unknown.last.mode is NavMode.ATTITUDE
    assert unknown.said("not used")


def test_an_old_save_is_not_taken_up_and_it_is_said() -> None:
    bench, _, saved = saved_in_mid_dive()
    bench.start_s += 7200.0
    result = run(bench.records(5.0), no_gps, Navigator(saved=saved))
    assert result.last.mode is NavMode.ATTITUDE
    assert result.said("120 minutes old and is not used")


@pytest.mark.parametrize(
    "damage",
    [
        {"version": 99},
        {"at_s": "yesterday"},
        {"values": [1.0, 2.0]},
        {"quaternion_ned_frd": [1.0, math.nan, 0.0, 0.0]},
        {"calibration": "none"},
        {"covariance": None, "values": [math.inf] * 30},
    ],
)
def test_a_broken_save_is_not_taken_up_and_it_is_said(damage: dict[str, object]) -> None:
    bench, _, saved = saved_in_mid_dive()
    broken = saved.to_json() | damage
    assert SavedNavigation.from_json(broken) is None
    result = run(bench.records(5.0), no_gps, Navigator(saved=broken))
    assert result.last.mode is NavMode.ATTITUDE
    assert result.said("damaged")


def test_a_covariance_that_is_none_is_not_taken_up() -> None:
    bench, _, saved = saved_in_mid_dive()
    wrong = replace(saved, covariance=tuple(-value for value in saved.covariance))
    result = run(bench.records(5.0), no_gps, Navigator(saved=wrong))
    assert result.last.mode is NavMode.ATTITUDE
    assert result.said("damaged")


def test_the_origin_can_be_set_here_and_elsewhere() -> None:
    bench = Bench()
    result = run(bench.records(20.0))
    place = LocalFrame(*result.last.origin_deg).to_geodetic(*result.last.position_ned_m)
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.SET_ORIGIN)))
    result.feed(bench.records(1.0))
    assert np.hypot(*result.last.position_ned_m[:2]) < 1.0
    north_of_it = NavigatorCommand(NavigatorAction.SET_ORIGIN, LATITUDE_DEG + 0.001, LONGITUDE_DEG)
    result.take(result.navigator.command(north_of_it))
    result.feed(bench.records(1.0))
    again = LocalFrame(*result.last.origin_deg).to_geodetic(*result.last.position_ned_m)
    assert result.last.position_ned_m[0] < -100.0
    assert np.allclose(again[:2], place[:2], atol=2e-5)
    assert result.last.reset_counter == 2


def test_an_origin_without_any_fix_places_the_vehicle_there() -> None:
    bench = Bench()
    result = run(bench.records(5.0), no_gps)
    (refused,) = result.navigator.command(NavigatorCommand(NavigatorAction.SET_ORIGIN))
    assert refused.level is EventLevel.WARNING
    result.navigator.command(NavigatorCommand(NavigatorAction.SET_ORIGIN, LATITUDE_DEG, LONGITUDE_DEG))
    result.feed(bench.records(2.0), no_gps)
    assert result.last.mode is NavMode.DEAD_RECKONING
    assert math.sqrt(result.last.pose_covariance[0, 0]) == pytest.approx(5.0, abs=1.0)


def test_reset_forgets_the_position_and_keeps_the_calibrations() -> None:
    bench = Bench()
    result = run(bench.records(5.0))
    command = result.navigator.command
    command(NavigatorCommand(NavigatorAction.START_CALIBRATION, kind="gyro"))
    result.feed(bench.records(13.0))
    (done,) = command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="gyro", unix_s=1.79e9))
    assert done.level is EventLevel.INFO
    command(NavigatorCommand(NavigatorAction.RESET))
    result.feed(bench.records(0.5))
    assert result.last.mode is NavMode.STARTING
    assert result.last.position_ned_m is None
    gyro = next(each for each in result.navigator.calibrations() if each.kind == "gyro")
    assert (gyro.state, gyro.made_unix_s) == ("done", 1.79e9)
    result.feed(bench.records(10.0))
    assert np.abs(result.last.angular_rate_frd_radps).max() < 0.004


def test_calibrations_run_are_saved_and_come_back() -> None:
    bench = Bench()
    result = run(bench.records(3.0))
    states = {each.kind: each.state for each in result.navigator.calibrations()}
    assert states == dict.fromkeys(("gyro", "accelerometer", "magnetometer", "swing"), "none")
    command = result.navigator.command
    command(NavigatorCommand(NavigatorAction.START_CALIBRATION, kind="gyro"))
    result.feed(bench.records(5.0))
    running = result.navigator.calibrations()[0]
    assert running.state == "running"
    assert 0.2 < running.progress < 0.8
    (early,) = command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="gyro"))
    assert early.level is EventLevel.WARNING
    assert "still seconds" in early.text
    result.feed(bench.records(8.0))
    assert result.navigator.calibrations()[0].state == "ready"
    command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="gyro"))
    saved = result.navigator.save()
    again = Navigator(saved=SavedNavigation(at_s=-math.inf, calibration=saved.calibration))
    assert again.calibrations()[0].state == "done"
    assert again.calibrations()[0].residual == pytest.approx(result.navigator.calibrations()[0].residual)
    again.command(NavigatorCommand(NavigatorAction.CLEAR_CALIBRATION, kind="gyro"))
    assert again.calibrations()[0].state == "none"


@pytest.mark.parametrize(
    ("action", "kind"),
    [
        (NavigatorAction.START_CALIBRATION, "sonar"),
        (NavigatorAction.FINISH_CALIBRATION, "gyro"),
        (NavigatorAction.CANCEL_CALIBRATION, "swing"),
        (NavigatorAction.CLEAR_CALIBRATION, "nothing"),
    ],
)
def test_what_cannot_be_done_is_refused_in_words(action: NavigatorAction, kind: str) -> None:
    (event,) = Navigator().command(NavigatorCommand(action, kind=kind))
    assert event.level is EventLevel.WARNING
    assert kind in event.text


def test_a_swing_gives_the_deviation_to_the_filter() -> None:
    """Two turns on the spot with hard iron that pulls the compass by up to 6 degrees."""
    bench = Bench(gps_std_m=0.3)
    iron = np.array([190.0, 0.0, 0.0])
    result = run(bench.records(20.0))
    result.navigator.command(NavigatorCommand(NavigatorAction.START_CALIBRATION, kind="swing"))
    turn_radps = math.radians(12.0)

    def turning(record: Record) -> Record | None:
        if not isinstance(record, ImuBurst):
            return record
        bench.heading_rad = 0.6 + turn_radps * (record.measured_s - 120.0)
        real = bench.imu(record.measured_s)
        rate = real.angular_rate_radps + np.array([0.0, 0.0, turn_radps])
        fields = []
        for k in range(4):
            bench.heading_rad = 0.6 + turn_radps * (record.measured_s + 0.05 * k - 120.0)
            fields.append(bench.imu(record.measured_s).magnetic_field_raw[0] + iron)
        return replace(real, angular_rate_radps=rate, magnetic_field_raw=np.rint(fields).astype(np.int16))

    result.feed(bench.records(64.0), turning)
    swing = result.navigator.calibrations()[3]
    assert swing.state == "ready", swing.instruction
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="swing")))
    assert result.said("Calibrated")
    made = SavedNavigation.from_json(result.navigator.save().to_json()).calibration["compass"]
    assert math.hypot(made["b_rad"], made["c_rad"]) == pytest.approx(190.0 / 1827.0, rel=0.15)
