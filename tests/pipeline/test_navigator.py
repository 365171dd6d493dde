import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import euler_from_rotation, rotation_from_quaternion
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.pipeline.navigator_options import GpsOptions, NavigatorOptions
from bluerov_slam.records import (
    GpsFix,
    ImuBurst,
    LinkBytes,
    NavMode,
    NavState,
    Record,
    SensorSample,
    SensorTrust,
    VehicleAttitude,
)
from pipeline.navigator_records import DECLINATION_RAD, Bench, moved, sensor_sample
from pipeline.navigator_runs import Run, run

CHI2_95_2DOF = 5.991


def heading_rad(state: NavState) -> float:
    assert state.quaternion_ned_frd is not None
    return euler_from_rotation(rotation_from_quaternion(state.quaternion_ned_frd))[2]


def horizontal_error_m(bench: Bench, state: NavState) -> np.ndarray:
    """Estimate minus truth, north and east."""
    assert state.origin_deg is not None
    assert state.position_ned_m is not None
    north, east, _ = LocalFrame(*state.origin_deg).to_ned_m(*bench.place(state.measured_s))
    return np.array([state.position_ned_m[0] - north, state.position_ned_m[1] - east])


def same(a: NavState, b: NavState) -> bool:
    """Also beyond the digits that are printed."""
    arrays = [(one.pose_covariance, one.velocity_covariance_m2ps2) for one in (a, b)]
    plain = [replace(one, pose_covariance=None, velocity_covariance_m2ps2=None) for one in (a, b)]
    return plain[0] == plain[1] and all(
        (x is None and y is None) or (x is not None and y is not None and x.tobytes() == y.tobytes())
        for x, y in zip(*arrays, strict=True)
    )


def test_a_vehicle_on_the_bench_stays_within_its_stated_error() -> None:
    inside = []
    for seed in range(8):
        bench = Bench(seed=seed)
        result = run(bench.records(90.0))
        for state in result.states[200::40]:
            error = horizontal_error_m(bench, state)
            assert state.pose_covariance is not None
            inside.append(error @ np.linalg.solve(state.pose_covariance[:2, :2], error) < CHI2_95_2DOF)
            assert abs(state.depth_m or 0.0) < 2.0 * (state.depth_std_m or 0.0)
            speed = np.hypot(*state.velocity_ned_mps[:2])
            assert speed < 3.5 * math.sqrt(np.trace(state.velocity_covariance_m2ps2[:2, :2]))
    assert np.mean(inside) > 0.9


def test_the_attitude_is_there_after_a_second_and_true_north_with_the_first_position() -> None:
    bench = Bench()
    result = run(bench.records(10.0))
    first = next(state for state in result.states if state.quaternion_ned_frd is not None)
    assert first.measured_s - result.states[0].measured_s < 1.6
    assert first.mode is NavMode.ATTITUDE
    assert first.position_ned_m is None
    assert math.isnan(first.pose_covariance[0, 0])
    assert math.degrees(heading_rad(first)) == pytest.approx(math.degrees(bench.heading_rad - DECLINATION_RAD), abs=2.0)
    assert result.last.mode is NavMode.AIDED
    assert math.degrees(heading_rad(result.last)) == pytest.approx(math.degrees(bench.heading_rad), abs=2.0)
    assert math.sqrt(result.last.pose_covariance[5, 5]) > math.radians(5.0)  # never calibrated, and it says so


def test_modes_follow_the_fixes() -> None:
    bench = Bench()
    navigator = Navigator()
    result = run(bench.records(1.0), navigator=navigator)
    assert result.states[0].mode is NavMode.STARTING
    result.feed(bench.records(20.0))
    assert result.last.mode is NavMode.AIDED
    result.feed(bench.records(20.0), lambda record: None if isinstance(record, GpsFix) else record)
    assert result.last.mode is NavMode.DEAD_RECKONING
    assert result.last.last_fix_s == pytest.approx(120.4, abs=0.2)


def test_the_same_records_give_the_same_states_bit_for_bit() -> None:
    records = list(Bench(north_mps=0.4).records(40.0))
    first, second = run(records), run(records)
    assert len(first.states) == len(second.states) > 150
    assert all(same(a, b) for a, b in zip(first.states, second.states, strict=True))
    assert first.events == second.events


def test_a_replay_that_resumes_from_a_save_in_the_middle_is_deterministic() -> None:
    records = list(Bench(north_mps=0.4).records(40.0))
    saved = run(records[: len(records) // 2]).navigator.save()
    halves = [run(records[len(records) // 2 :], navigator=Navigator(saved=saved)) for _ in range(2)]
    assert all(same(a, b) for a, b in zip(halves[0].states, halves[1].states, strict=True))


def test_position_velocity_and_distance_follow_a_vehicle_under_gps() -> None:
    bench = Bench(north_mps=0.5, east_mps=-0.3, gps_std_m=0.8)
    result = run(bench.records(120.0))
    error = horizontal_error_m(bench, result.last)
    assert np.hypot(*error) < 5.0
    assert result.last.velocity_ned_mps[0] == pytest.approx(0.5, abs=0.25)
    assert result.last.distance_m == pytest.approx(0.583 * 115, rel=0.25)


def test_a_late_fix_lands_where_it_belongs() -> None:
    """Half a second more of delay changes nothing but what half an IMU interval of motion is, 25 mm a fix."""
    bench = Bench(north_mps=1.0)
    records = list(bench.records(30.0))

    def late(record: Record) -> Record:
        return replace(record, arrived_s=record.measured_s + 0.7) if isinstance(record, GpsFix) else record

    delayed = sorted((late(record) for record in records), key=lambda record: record.arrived_s)
    rest = [record for record in bench.records(2.0) if not isinstance(record, GpsFix)]
    on_time, too_late = run([*records, *rest]), run([*delayed, *rest])
    difference = np.subtract(on_time.last.position_ned_m, too_late.last.position_ned_m)
    assert np.abs(difference).max() < 0.12
    assert too_late.navigator.statistics["filter"]["replayed_slots"] > 100


def test_angles_alone_are_enough_where_no_burst_comes() -> None:
    bench = Bench()

    def old_firmware(record: Record) -> Record | None:
        if isinstance(record, ImuBurst):
            return None
        if isinstance(record, SensorSample):
            roll, pitch, yaw = 0.05 + 1e-4 * bench.rng.standard_normal(3)
            return replace(
                record,
                roll_rad=roll,
                pitch_rad=pitch,
                yaw_rad=yaw + bench.heading_rad - DECLINATION_RAD,
                acceleration_frd_mps2=(0.5, 0.4, -9.8),
                imu_alive=True,
            )
        return record

    result = run(bench.records(40.0), old_firmware)
    assert result.last.mode is NavMode.AIDED
    assert math.degrees(heading_rad(result.last)) == pytest.approx(math.degrees(bench.heading_rad + 0.05), abs=2.0)
    assert result.sensor("imu").trust is SensorTrust.USED
    assert result.sensor("compass").trust is SensorTrust.WAITING
    assert "own heading" in result.sensor("compass").reason


def test_the_autopilot_s_attitude_serves_only_where_the_link_has_no_imu() -> None:
    bench = Bench()
    boot = [0]

    def autopilot(record: Record) -> list[Record]:
        boot[0] += 100
        roll = 0.02 + 1e-4 * float(bench.rng.standard_normal())
        attitude = VehicleAttitude(record.arrived_s, boot[0], roll, 0.0, 2.0, (0.0, 0.0, 0.0))
        return [record, attitude] if isinstance(record, SensorSample) else [record]

    both = run(bench.records(20.0), autopilot)
    assert math.degrees(heading_rad(both.last)) == pytest.approx(math.degrees(bench.heading_rad), abs=10.0)

    def without_imu(record: Record) -> list[Record]:
        return [] if isinstance(record, ImuBurst) else autopilot(record)

    boot[0] = 0
    alone = run(Bench().records(20.0), without_imu)
    assert math.degrees(heading_rad(alone.last)) == pytest.approx(math.degrees(2.0), abs=2.0)
    assert alone.last.mode is NavMode.AIDED


def test_outside_fixes_place_the_vehicle_where_there_is_no_gps() -> None:
    bench = Bench(north_mps=0.2)

    def acoustic(record: Record) -> list[Record]:
        if isinstance(record, GpsFix):
            return [bench.fix(record.measured_s)]
        return [record]

    result = run(bench.records(60.0), acoustic)
    assert result.last.mode is NavMode.AIDED
    assert result.sensor("position").accepted > 50
    assert np.hypot(*horizontal_error_m(bench, result.last)) < 2.0


def test_many_fixes_with_one_error_do_not_make_it_sure() -> None:
    """Five fixes a second that all share one offset of 2 m: the stated error must not shrink below it."""
    bench, jitter = Bench(), np.random.default_rng(2)

    def acoustic(record: Record) -> list[Record]:
        if isinstance(record, GpsFix):
            return []
        if isinstance(record, SensorSample) and round(record.measured_s * 10) % 2 == 0:
            fix = bench.fix(record.measured_s)
            jitter_m = 0.03 * float(jitter.standard_normal())
            return [record, replace(fix, latitude_deg=fix.latitude_deg + (2.0 + jitter_m) / 111_195.0)]
        return [record]

    result = run(bench.records(60.0), acoustic)
    assert result.sensor("position").accepted > 200
    assert math.sqrt(result.last.pose_covariance[0, 0]) > 0.7


def test_gps_of_an_old_firmware_comes_out_of_sensors() -> None:
    bench = Bench()
    newest: list[GpsFix] = []

    def old_firmware(record: Record) -> Record | None:
        if isinstance(record, GpsFix):
            newest[:] = [record]
            return None
        if isinstance(record, SensorSample) and newest:
            fix = newest[0]
            return replace(
                record, gps_alive=True, gps_latitude_deg=fix.latitude_deg, gps_longitude_deg=fix.longitude_deg
            )
        return record

    result = run(bench.records(30.0), old_firmware)
    assert result.last.mode is NavMode.AIDED
    assert 20 <= result.sensor("gps").accepted <= 31  # each of the receiver's reports once
    assert np.hypot(*horizontal_error_m(bench, result.last)) < 4.0


def test_every_update_is_heard_by_whoever_listens() -> None:
    navigator = Navigator()
    heard: list[str] = []
    navigator.on_update = lambda result: heard.append(result.sensor)
    run(Bench().records(10.0), navigator=navigator)
    assert {"compass", "depth", "gps"} <= set(heard)


def test_smoothing_gives_every_part_of_the_track_again_and_better() -> None:
    bench = Bench(north_mps=0.5)
    navigator = Navigator()
    navigator.keep_for_smoothing()
    result = run(bench.records(60.0), navigator=navigator)
    smoothed = navigator.smoothed()
    assert len(smoothed) > 100
    middle = smoothed[len(smoothed) // 2]
    nearest = min(result.states, key=lambda state: abs(state.measured_s - middle.measured_s))
    assert np.trace(middle.velocity_covariance_m2ps2) < np.trace(nearest.velocity_covariance_m2ps2)
    assert np.hypot(*horizontal_error_m(bench, middle)) < 4.0


def test_nothing_is_stated_once_all_has_been_silent_for_long() -> None:
    bench = Bench()
    result = run(bench.records(20.0))
    assert result.navigator.expire(result.last.arrived_s + 30.0) == []
    before = result.navigator.save()
    (state,) = result.navigator.expire(result.last.arrived_s + 61.0)
    assert isinstance(state, NavState)
    assert state.mode is NavMode.STARTING
    assert state.position_ned_m is None
    assert state.pose_covariance is None
    assert result.navigator.save() == before


def test_records_it_does_not_know_are_passed_over() -> None:
    assert Navigator().feed(LinkBytes(b"", 3.0)) == []
    assert Navigator().feed(replace(sensor_sample(5.0), arrived_s=math.nan)) == []


def test_options_reach_the_filter() -> None:
    sure = Navigator(NavigatorOptions(gps=GpsOptions(std_m_per_hdop=0.2)))
    precise, usual = (run(Bench(gps_std_m=0.05).records(30.0), navigator=each) for each in (sure, Navigator()))
    assert precise.last.pose_covariance[0, 0] < 0.2 * usual.last.pose_covariance[0, 0]


def test_a_jump_of_the_position_counts_up_the_reset_counter() -> None:
    bench = Bench()
    result = run(bench.records(30.0))
    assert result.last.reset_counter == 0
    drifted = Run(result.navigator)
    drifted.feed(bench.records(120.0), lambda record: None if isinstance(record, GpsFix) else record)
    drifted.feed(bench.records(8.0), lambda record: moved(record, 15.0, 0.0) if isinstance(record, GpsFix) else record)
    assert drifted.last.reset_counter >= 1


def test_thrusters_that_drive_a_vehicle_far_too_slowly_are_told_in_words_and_trusted_less() -> None:
    bench = Bench(heading_rad=0.0, north_mps=0.3, gps_std_m=0.3)
    ahead = (1400, 1400, 1600, 1600, 1500, 1500) + (0,) * 10

    def driven(records: Iterable[Record]) -> Iterator[Record]:
        for record in records:
            yield record
            if isinstance(record, ImuBurst):
                yield bench.servos(record.arrived_s, ahead)

    result = run(driven(bench.records(30.0)))
    assert result.sensor("thrust").reason == ""
    filter_ = result.navigator._core.timeline.filter
    usual_std = filter_.std("thrust_scale")[0]
    filter_.estimate.block("thrust_scale")[0] = -0.5  # as if a propeller had been lost for long
    result.feed(driven(bench.records(6.0)))
    thrust = result.sensor("thrust")
    assert thrust.trust is SensorTrust.USED
    assert "% slower than they should" in thrust.reason
    assert thrust.reason in [event.text for event in result.events]
    assert filter_.std("thrust_scale")[0] > 1.1 * usual_std
    filter_.estimate.block("thrust_scale")[0] = 0.1
    result.feed(driven(bench.records(6.0)))
    assert result.sensor("thrust").reason == ""


def test_no_tilt_is_stated_more_surely_than_its_sensor_can_know() -> None:
    result = run(Bench().records(120.0))
    covariance = result.last.pose_covariance
    assert covariance is not None
    assert covariance[3, 3] > math.radians(0.1) ** 2
    assert covariance[4, 4] > math.radians(0.1) ** 2
