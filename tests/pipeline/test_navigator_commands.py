import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.calibration import Calibration, MagnetometerCalibration, Provenance
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.vehicle_model import BLUEROV2, ThrustModel
from bluerov_slam.pipeline.navigator import (
    CalibrationProgress,
    Navigator,
    NavigatorAction,
    NavigatorCommand,
    SavedNavigation,
)
from bluerov_slam.records import EventLevel, GpsFix, ImuBurst, NavMode, Record
from pipeline.navigator_records import FIELD_COUNTS, LATITUDE_DEG, LONGITUDE_DEG, Bench
from pipeline.navigator_runs import Run, run


def progress_of(result: Run, kind: str) -> CalibrationProgress:
    return next(each for each in result.navigator.calibrations() if each.kind == kind)


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
    kinds = ("gyro", "accelerometer", "magnetometer", "thruster_field", "swing", "course_swing")
    assert states == dict.fromkeys(kinds, "none")
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
    swing = progress_of(result, "swing")
    assert swing.state == "ready", swing.instruction
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="swing")))
    assert result.said("Calibrated")
    made = SavedNavigation.from_json(result.navigator.save().to_json()).calibration["compass"]
    assert math.hypot(made["b_rad"], made["c_rad"]) == pytest.approx(190.0 / 1827.0, rel=0.15)


def with_magnetometer() -> Navigator:
    made = Provenance(0.0, "% of the field", "test", 0)
    scale = 1.0 / FIELD_COUNTS
    matrix = ((scale, 0.0, 0.0), (0.0, scale, 0.0), (0.0, 0.0, scale))
    calibration = Calibration(magnetometer=MagnetometerCalibration((0.0, 0.0, 0.0), matrix, FIELD_COUNTS, made))
    return Navigator(saved=SavedNavigation(at_s=-math.inf, calibration=calibration.to_json()))


def test_the_thrusters_field_is_measured_and_taken_off() -> None:
    """Each thruster alone for some seconds; its current turns the compass, and no more after the calibration."""
    bench = Bench()
    result = run(bench.records(20.0), navigator=with_magnetometer())
    begun = result.navigator.command(NavigatorCommand(NavigatorAction.START_CALIBRATION, kind="thruster_field"))
    assert "1, 2, 3, 4, 5, 6" in begun[0].text
    per_effort = np.random.default_rng(7).normal(0.0, 500.0, (6, 3))
    model = ThrustModel(BLUEROV2)

    def servos_at(at_s: float) -> tuple[int, ...]:
        which = int((at_s - 125.0) // 6.0)
        return tuple(1750 if k == which else 1500 for k in range(16))

    def running(record: Record) -> Record | list[Record] | None:
        if not isinstance(record, ImuBurst):
            return record
        pwm_us = servos_at(record.measured_s)
        disturbed = record.magnetic_field_raw + model.effort(pwm_us) @ per_effort
        burst = replace(record, magnetic_field_raw=np.rint(disturbed).astype(np.int16))
        return [bench.servos(record.measured_s, pwm_us), burst]

    result.feed(bench.records(48.0), running)
    progress = progress_of(result, "thruster_field")
    assert progress.state == "ready", progress.instruction
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="thruster_field")))
    assert result.said("Calibrated")
    made = result.navigator.save().calibration["thruster_field"]
    assert np.array(made["field_per_effort_frd"]) * FIELD_COUNTS == pytest.approx(per_effort, abs=60.0)


def test_the_thrusters_field_wants_a_magnetometer_that_is_calibrated() -> None:
    (event,) = Navigator().command(NavigatorCommand(NavigatorAction.START_CALIBRATION, kind="thruster_field"))
    assert event.level is EventLevel.WARNING
    assert "magnetometer first" in event.text


def test_driving_on_all_headings_under_gps_gives_a_b_and_c() -> None:
    """A compass that is turned by 6 degrees and pulled by hard iron, in a current; 0.6 m/s through the water."""
    bench = Bench(gps_std_m=0.3)
    iron = np.array([160.0, 0.0, 0.0])
    turned_rad, current = math.radians(6.0), np.array([0.15, -0.1])
    cos, sin = math.cos(turned_rad), math.sin(turned_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    result = run(bench.records(10.0))
    result.navigator.command(NavigatorCommand(NavigatorAction.START_CALIBRATION, kind="course_swing"))
    for leg in range(16):
        bench.heading_rad = 0.6 + leg * math.tau / 16.0
        speed = 0.6 * np.array([math.cos(bench.heading_rad), math.sin(bench.heading_rad)]) + current

        def leg_of(record: Record, speed: np.ndarray = speed) -> Record | list[Record] | None:
            if isinstance(record, GpsFix):
                course = math.atan2(speed[1], speed[0]) % math.tau
                return replace(record, speed_mps=float(np.hypot(*speed)), course_rad=course)
            if not isinstance(record, ImuBurst):
                return record
            field = np.rint(record.magnetic_field_raw @ turn.T + iron).astype(np.int16)
            pwm_us = (1370, 1370, 1630, 1630, *(1500,) * 12)
            return [bench.servos(record.measured_s, pwm_us), replace(record, magnetic_field_raw=field)]

        result.feed(bench.records(30.0), leg_of)
    progress = progress_of(result, "course_swing")
    assert progress.state == "ready", progress.instruction
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.FINISH_CALIBRATION, kind="course_swing")))
    assert result.said("Calibrated")
    assert progress_of(result, "swing").state == "done"
    made = result.navigator.save().calibration["compass"]
    assert abs(made["a_rad"]) == pytest.approx(turned_rad, abs=math.radians(1.0))
    assert math.hypot(made["b_rad"], made["c_rad"]) == pytest.approx(160.0 / 1827.0, rel=0.2)
