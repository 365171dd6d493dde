"""Bad input, one kind at a time: the filter survives, says which sensor it ignores and why, and grows less certain."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bluerov_slam.pipeline.navigator import Navigator, NavigatorAction, NavigatorCommand
from bluerov_slam.pipeline.navigator_gps import GpsGate
from bluerov_slam.pipeline.navigator_options import GpsOptions, ImuOptions, NavigatorOptions
from bluerov_slam.pipeline.navigator_sensors import SensorBook
from bluerov_slam.records import (
    EventLevel,
    FixType,
    GpsFix,
    ImuBurst,
    NavMode,
    NavState,
    Record,
    SensorSample,
    SensorTrust,
    VehicleMotionDelta,
)
from pipeline.navigator_records import M_PER_DEG, Bench, ctd_sample, moved
from pipeline.navigator_runs import Run, run


def healthy(state: NavState) -> bool:
    """Every number that is stated is one, and no variance is negative."""
    pose = state.pose_covariance
    if pose is None:
        return True
    known = pose[~np.isnan(pose)]
    velocity = state.velocity_covariance_m2ps2
    return bool(
        np.isfinite(known).all()
        and np.diag(pose)[2:].min() >= 0.0
        and np.isfinite(velocity).all()
        and np.diag(velocity).min() > 0.0
        and all(math.isfinite(value) for value in state.position_ned_m or ())
    )


def std_m(state: NavState) -> float:
    return math.sqrt(state.pose_covariance[0, 0] + state.pose_covariance[1, 1])


def settled(bench: Bench | None = None, seconds: float = 20.0) -> tuple[Bench, Run]:
    bench = bench or Bench()
    return bench, run(bench.records(seconds))


def only(kind: type, change: Callable[[Any], Record | None]) -> Callable[[Record], Record | None]:
    return lambda record: change(record) if isinstance(record, kind) else record


def drop(kind: type) -> Callable[[Record], Record | None]:
    return only(kind, lambda record: None)


def test_a_silent_imu_is_named_and_the_uncertainty_grows_until_it_is_back() -> None:
    bench, result = settled()
    before = std_m(result.last)
    bench_rest = bench.records(20.0)
    result.feed(bench_rest, lambda record: None if isinstance(record, ImuBurst | GpsFix) else record)
    assert healthy(result.last)
    assert std_m(result.last) > 2.0 * before
    assert result.last.pose_covariance[5, 5] > 0.2
    sensor = result.sensor("imu")
    assert sensor.trust is SensorTrust.IGNORED
    assert "fallen silent" in sensor.reason
    assert "5 V" in sensor.reason
    result.feed(bench.records(10.0))
    assert result.sensor("imu").trust is SensorTrust.USED
    assert result.said("attitude was found anew")
    assert result.last.mode is NavMode.AIDED
    assert std_m(result.last) < 5.0


def test_a_frozen_imu_is_ignored_after_a_second() -> None:
    bench, result = settled()
    frozen = bench.imu(bench.start_s)

    def freeze(record: ImuBurst) -> ImuBurst:
        return replace(
            record,
            acceleration_mps2=frozen.acceleration_mps2[[0] * 4],
            angular_rate_radps=frozen.angular_rate_radps[[0] * 4],
        )

    result.feed(bench.records(5.0), only(ImuBurst, freeze))
    assert healthy(result.last)
    assert result.sensor("imu").trust is SensorTrust.IGNORED
    assert "exactly the same values" in result.sensor("imu").reason
    assert result.said("exactly the same values")


def test_a_saturated_gyro_is_said_and_forgiven() -> None:
    bench, result = settled()

    def saturate(record: ImuBurst) -> ImuBurst:
        return replace(record, angular_rate_radps=np.full((4, 3), math.radians(2000.0)))

    result.feed(bench.records(2.0), only(ImuBurst, saturate))
    assert healthy(result.last)
    assert result.sensor("imu").trust is SensorTrust.IGNORED
    assert "end of its range" in result.sensor("imu").reason
    result.feed(bench.records(10.0))
    assert result.sensor("imu").trust is SensorTrust.USED
    assert abs(result.last.position_ned_m[0]) < 6.0


@pytest.mark.parametrize("field", ["acceleration_mps2", "angular_rate_radps"])
def test_nan_of_the_imu_never_reaches_the_filter(field: str) -> None:
    bench, result = settled()
    result.feed(bench.records(3.0), only(ImuBurst, lambda record: replace(record, **{field: np.full((4, 3), np.nan)})))
    assert healthy(result.last)
    assert "not numbers" in result.sensor("imu").reason
    result.feed(bench.records(10.0))
    assert healthy(result.last)
    assert result.sensor("imu").trust is SensorTrust.USED


def test_nan_everywhere_else_is_refused_too() -> None:
    bench, result = settled()
    nan = math.nan

    def poison(record: Record) -> list[Record]:
        if isinstance(record, GpsFix):
            return [replace(record, latitude_deg=nan), bench.fix(record.measured_s, (nan, 0.0, 1.0))]
        if isinstance(record, SensorSample):
            delta = VehicleMotionDelta(
                record.arrived_s, record.device_ms * 1000, 0.1, (0.0,) * 3, (nan, 0.0, 0.0), 90.0
            )
            water = ctd_sample(record.measured_s, temperature_degc=nan, salinity_psu=35.0, depth_m=3.0)
            return [replace(record, pressure_pa=nan), delta, water]
        return [record]

    result.feed(bench.records(6.0), poison)
    assert healthy(result.last)
    for name in ("gps", "depth", "dvl"):
        assert result.sensor(name).trust is SensorTrust.IGNORED, name
        assert "not numbers" in result.sensor(name).reason
    assert result.sensor("position").trust is SensorTrust.IGNORED


@pytest.mark.parametrize(("roll_deg", "words"), [(180.0, "upside down"), (90.0, "on its side")])
def test_an_imu_mounted_the_wrong_way_is_detected_and_said(roll_deg: float, words: str) -> None:
    cosine, sine = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])

    def turned(record: ImuBurst) -> ImuBurst:
        return replace(
            record,
            acceleration_mps2=record.acceleration_mps2 @ turn.T,
            angular_rate_radps=record.angular_rate_radps @ turn.T,
            magnetic_field_raw=np.rint(record.magnetic_field_raw @ turn.T).astype(np.int16),
        )

    wrong = run(Bench().records(5.0), only(ImuBurst, turned))
    assert wrong.last.mode is NavMode.STARTING
    assert wrong.sensor("imu").trust is SensorTrust.IGNORED
    assert words in wrong.sensor("imu").reason
    assert "settings" in wrong.sensor("imu").reason
    cure = Navigator(NavigatorOptions(imu=ImuOptions(mounting_rpy_deg=(roll_deg, 0.0, 0.0))))
    cured = run(Bench().records(10.0), only(ImuBurst, turned), cure)
    assert cured.last.mode is NavMode.AIDED
    assert cured.sensor("imu").trust is SensorTrust.USED


def test_repeated_and_time_travelling_bursts_are_refused() -> None:
    bench, result = settled()
    stuck = bench.start_s

    result.feed(bench.records(3.0), only(ImuBurst, lambda record: replace(record, measured_s=stuck)))
    assert healthy(result.last)
    assert "same time stamp" in result.sensor("imu").reason
    result.feed(bench.records(10.0))
    result.feed(bench.records(2.0), only(ImuBurst, lambda record: replace(record, measured_s=record.arrived_s + 5.0)))
    assert healthy(result.last)
    assert "future" in result.sensor("imu").reason
    assert result.last.measured_s < bench.start_s + 1.0
    result.feed(bench.records(10.0))
    result.feed(bench.records(2.0), only(ImuBurst, lambda record: replace(record, measured_s=record.arrived_s - 60.0)))
    assert "late" in result.sensor("imu").reason
    result.feed(bench.records(10.0))
    assert result.sensor("imu").trust is SensorTrust.USED


def test_a_magnetometer_next_to_a_motor_is_not_believed() -> None:
    bench, result = settled(seconds=30.0)
    heading = heading_deg(result.last)

    def beside_a_motor(record: ImuBurst) -> ImuBurst:
        return replace(
            record, magnetic_field_raw=(record.magnetic_field_raw + np.array([9000, -7000, 4000])).astype(np.int16)
        )

    result.feed(bench.records(10.0), only(ImuBurst, beside_a_motor))
    sensor = result.sensor("compass")
    assert sensor.trust is SensorTrust.IGNORED
    assert "stronger or weaker" in sensor.reason
    assert abs(heading_deg(result.last) - heading) < 3.0
    result.feed(bench.records(5.0))
    assert result.sensor("compass").trust is SensorTrust.USED


def test_a_magnetometer_that_stays_the_same_while_the_vehicle_turns_is_not_believed() -> None:
    bench, result = settled()
    stuck = bench.imu(bench.start_s).magnetic_field_raw

    def turning(record: ImuBurst) -> ImuBurst:
        rate = record.angular_rate_radps + np.array([0.0, 0.0, math.radians(15.0)])
        return replace(record, angular_rate_radps=rate, magnetic_field_raw=stuck)

    result.feed(bench.records(6.0), only(ImuBurst, turning))
    assert result.sensor("compass").trust is SensorTrust.IGNORED
    assert "while the vehicle turns" in result.sensor("compass").reason


def test_a_saturated_magnetometer_and_one_without_a_field_are_named() -> None:
    bench, result = settled()
    full = np.full((4, 3), 32767, np.int16)
    result.feed(bench.records(1.0), only(ImuBurst, lambda record: replace(record, magnetic_field_raw=full)))
    assert "end of its range" in result.sensor("compass").reason
    none = np.zeros((4, 3), np.int16)
    result.feed(bench.records(1.0), only(ImuBurst, lambda record: replace(record, magnetic_field_raw=none)))
    assert "no field at all" in result.sensor("compass").reason


def test_gps_at_zero_zero_is_refused() -> None:
    def null_island(record: GpsFix) -> GpsFix:
        return replace(record, latitude_deg=0.0, longitude_deg=0.0)

    result = run(Bench().records(10.0), only(GpsFix, null_island))
    assert result.last.mode is NavMode.ATTITUDE
    assert "0 N 0 E" in result.sensor("gps").reason
    # The codec has already taken the position of a claimed fix at exactly 0, 0 away.
    claimed = run(Bench().records(10.0), only(GpsFix, lambda record: replace(record, latitude_deg=None)))
    assert "0 N 0 E" in claimed.sensor("gps").reason


def test_a_jump_of_a_kilometre_is_refused_and_forgotten_when_it_comes_back() -> None:
    bench, result = settled()
    result.feed(bench.records(10.0), only(GpsFix, lambda record: moved(record, 1000.0, 0.0)))
    assert abs(result.last.position_ned_m[0]) < 20.0
    assert result.last.reset_counter == 0
    assert result.sensor("gps").trust is SensorTrust.IGNORED
    assert "jumped" in result.sensor("gps").reason
    result.feed(bench.records(10.0))
    assert result.last.mode is NavMode.AIDED
    assert result.sensor("gps").trust is SensorTrust.USED


def test_a_jump_of_a_kilometre_that_stays_is_believed_after_a_while_with_a_reset() -> None:
    bench, result = settled()
    before = std_m(result.last)
    result.feed(bench.records(15.0), only(GpsFix, lambda record: moved(record, 1000.0, 0.0)))
    assert abs(result.last.position_ned_m[0]) < 20.0
    assert std_m(result.last) > before
    result.feed(bench.records(15.0), only(GpsFix, lambda record: moved(record, 1000.0, 0.0)))
    assert result.last.position_ned_m[0] == pytest.approx(1000.0, abs=10.0)
    assert result.last.reset_counter >= 1
    assert result.said("stayed there although")
    assert any(event.level is EventLevel.WARNING for event in result.events)
    assert result.last.distance_m < 100.0  # the jump is no path


def test_gps_is_not_used_under_water_nor_without_a_fix_nor_when_poor() -> None:
    bench, result = settled(Bench(depth_m=0.0))
    bench.depth_m = 3.0
    result.feed(bench.records(15.0))
    assert result.sensor("gps").trust is SensorTrust.WAITING
    assert "Under water" in result.sensor("gps").reason
    assert result.last.depth_m == pytest.approx(3.0, abs=0.1)
    bench, result = settled()
    result.feed(bench.records(3.0), only(GpsFix, lambda record: replace(record, fix=FixType.NONE)))
    assert "no fix yet" in result.sensor("gps").reason
    result.feed(bench.records(3.0), only(GpsFix, lambda record: replace(record, hdop=12.0)))
    assert "badly" in result.sensor("gps").reason


def test_a_receiver_that_repeats_one_position_while_the_vehicle_moves_is_frozen() -> None:
    bench = Bench()
    book = SensorBook()
    gate = GpsGate(GpsOptions(), book["gps"])
    stuck = bench.gps(100.0)

    def reports(metres_per_s: float) -> list[bool]:
        taken = []
        for k in range(40):
            fix = replace(stuck, measured_s=bench.start_s + k, arrived_s=bench.start_s + k + 0.2)
            taken.append(gate.frame(fix, 0.0, metres_per_s * k) is not None)
        bench.start_s += 40.0
        return taken

    assert all(reports(0.0)[3:])  # moored, or on a bench: such a receiver may hold still
    moving = reports(1.0)
    assert not any(moving[20:])
    assert "although the vehicle moves" in book["gps"].view(bench.start_s).reason


def test_a_frozen_and_an_impossible_pressure_are_named_and_depth_grows_uncertain() -> None:
    bench, result = settled()
    result.feed(bench.records(12.0), only(SensorSample, lambda record: replace(record, pressure_pa=101_900.0)))
    assert result.sensor("depth").trust is SensorTrust.IGNORED
    assert "single digit" in result.sensor("depth").reason
    result.feed(bench.records(2.0), only(SensorSample, lambda record: replace(record, pressure_pa=9.9e6)))
    assert "cannot measure" in result.sensor("depth").reason or "outside what" in result.sensor("depth").reason
    result.feed(bench.records(8.0), drop(SensorSample))
    assert result.sensor("depth").trust is SensorTrust.IGNORED
    assert healthy(result.last)


def test_impossible_fixes_are_refused() -> None:
    bench, result = settled()
    wrong = [
        replace(bench.fix(bench.start_s), latitude_deg=95.0),
        bench.fix(bench.start_s + 0.1, (-1.0, 0.0, 1.0)),
        bench.fix(bench.start_s + 0.2, (1.0, 5.0, 1.0)),
        replace(bench.fix(bench.start_s + 0.3), latitude_deg=0.0, longitude_deg=0.0),
    ]
    result.feed(wrong)
    assert result.navigator.statistics["sensors"]["position"]["refused"] == 4
    result.feed(bench.records(1.0))
    assert result.sensor("position").trust is SensorTrust.IGNORED


def test_an_outlier_among_fixes_is_rejected_and_the_rest_used() -> None:
    bench = Bench()

    def acoustic(record: Record) -> list[Record]:
        if not isinstance(record, GpsFix):
            return [record]
        fix = bench.fix(record.measured_s, (1.0, 0.0, 1.0))
        wild = round(record.measured_s) % 7 == 0
        return [replace(fix, latitude_deg=fix.latitude_deg + 60.0 / M_PER_DEG) if wild else fix]

    result = run(bench.records(60.0), acoustic)
    assert result.sensor("position").rejected >= 7
    assert result.sensor("position").accepted >= 45
    assert result.sensor("position").trust is SensorTrust.USED
    assert abs(result.last.position_ned_m[0]) < 3.0


def test_impossible_pwm_is_named_and_stale_pwm_not_used() -> None:
    bench, result = settled()

    def servos(pwm_us: tuple[int, ...]) -> Callable[[Record], list[Record]]:
        return lambda record: (
            [record, bench.servos(record.measured_s, pwm_us)] if isinstance(record, SensorSample) else [record]
        )

    result.feed(bench.records(5.0), servos((1500,) * 16))
    assert result.sensor("thrust").trust is SensorTrust.WAITING
    result.feed(bench.records(12.0), servos((1460, 1460, 1540, 1540) + (1500,) * 12))
    assert result.sensor("thrust").trust is SensorTrust.USED
    used = result.sensor("thrust").accepted
    result.feed(bench.records(3.0), servos((5000,) * 16))
    assert "impossible" in result.sensor("thrust").reason
    result.feed(bench.records(8.0))
    assert result.sensor("thrust").accepted == used
    assert "does not report" in result.sensor("thrust").reason


def test_a_dvl_that_lost_the_bottom_is_named() -> None:
    bench, result = settled()

    def dvl(confidence: float) -> Callable[[Record], list[Record]]:
        def add(record: Record) -> list[Record]:
            if not isinstance(record, SensorSample):
                return [record]
            delta = tuple(0.001 * bench.rng.standard_normal(3))
            return [
                record,
                VehicleMotionDelta(record.arrived_s, record.device_ms * 1000, 0.1, (0.0,) * 3, delta, confidence),
            ]

        return add

    result.feed(bench.records(10.0), dvl(90.0))
    assert result.sensor("dvl").trust is SensorTrust.USED
    assert np.hypot(*result.last.velocity_ned_mps[:2]) < 0.05
    result.feed(bench.records(3.0), dvl(0.0))
    assert "lost the bottom" in result.sensor("dvl").reason
    result.feed(bench.records(60.0), drop(GpsFix))
    assert std_m(result.last) > 1.0


def test_when_everything_but_the_clock_is_gone_nothing_is_stated_any_more() -> None:
    bench, result = settled()

    def nothing(record: Record) -> Record | None:
        if isinstance(record, SensorSample):
            return replace(record, pressure_pa=None, depth_ok=False)
        return None

    result.feed(bench.records(50.0), nothing)
    assert result.last.position_ned_m is not None
    assert std_m(result.last) > 15.0
    result.feed(bench.records(15.0), nothing)
    assert result.last.position_ned_m is None
    assert result.last.quaternion_ned_frd is None
    result.feed(bench.records(10.0))
    assert result.last.mode is NavMode.AIDED


def test_an_old_burst_that_comes_again_changes_nothing() -> None:
    records = list(Bench().records(20.0))
    twice = [each for record in records for each in ((record, record) if isinstance(record, ImuBurst) else (record,))]
    once, repeated = run(records), run(twice)
    assert np.allclose(once.last.position_ned_m, repeated.last.position_ned_m, atol=1e-9)


def test_still_on_deck_the_gyro_s_bias_is_learned() -> None:
    bench = Bench()

    def on_deck(record: Record) -> list[Record]:
        if isinstance(record, SensorSample):
            return [record, ctd_sample(record.measured_s, conductivity_s_per_m=0.0)]
        return [] if isinstance(record, GpsFix) else [record]

    result = run(bench.records(30.0), on_deck)
    assert np.abs(result.last.angular_rate_frd_radps).max() < 0.004
    assert np.hypot(*result.last.velocity_ned_mps[:2]) < 0.05
    assert math.sqrt(result.last.velocity_covariance_m2ps2[0, 0]) < 0.05


def test_a_depth_that_starts_under_water_says_how_little_it_knows() -> None:
    surface, deep = run(Bench().records(10.0)), run(Bench(depth_m=20.0).records(10.0))
    assert deep.last.depth_m == pytest.approx(20.0, abs=0.5)
    assert deep.last.depth_std_m > 2.0 * surface.last.depth_std_m


def test_zero_depth_and_refused_commands() -> None:
    bench, result = settled(Bench(depth_m=0.0))
    bench.depth_m = 0.4
    result.feed(bench.records(10.0))
    assert result.last.depth_m == pytest.approx(0.4, abs=0.1)
    result.take(result.navigator.command(NavigatorCommand(NavigatorAction.ZERO_DEPTH)))
    result.feed(bench.records(5.0))
    assert result.last.depth_m == pytest.approx(0.0, abs=0.05)
    assert result.last.depth_std_m < 0.1
    (refused,) = Navigator().command(NavigatorCommand(NavigatorAction.ZERO_DEPTH))
    assert refused.level is EventLevel.WARNING
    assert "No pressure" in refused.text


def heading_deg(state: NavState) -> float:
    w, x, y, z = state.quaternion_ned_frd
    return math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
