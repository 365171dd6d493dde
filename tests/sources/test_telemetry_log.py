import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import (
    Event,
    GpsFix,
    PositionFix,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleRange,
    VehicleServoOutput,
)
from bluerov_slam.sources.telemetry_log import import_telemetry_log
from log_samples import START_UNIX_S, TelemetryLog
from real_data import recording

LATITUDE_DEG, LONGITUDE_DEG = 48.3861418, -124.6305732


@pytest.fixture
def log() -> TelemetryLog:
    made = TelemetryLog()
    made.heartbeat(0.0)
    made.attitude(0.0)
    return made


@pytest.fixture
def imported(tmp_path):
    def run(log: TelemetryLog):
        path = tmp_path / "dive.tlog"
        path.write_bytes(log.content)
        return import_telemetry_log(path)

    return run


def of(kind, result):
    return [record for record in result.records if isinstance(record, kind)]


def test_the_autopilots_messages_become_records_at_their_time(log, imported):
    log.pressure(0.5, 1215.0)
    log.add(mavlink.MAVLink_servo_output_raw_message(60_700_000, 0, *range(1500, 1508)), 0.7)
    cells = [15_200] + [65535] * 9
    log.add(mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, cells, 250, 0, 0, 80), 0.8)
    log.add(mavlink.MAVLink_distance_sensor_message(60_900, 20, 5000, 325, 1, 1, 25, 255), 0.9, (1, 194))
    log.add(mavlink.MAVLink_statustext_message(4, b"leak"), 1.0)
    result = imported(log)
    assert result.start_unix_s == START_UNIX_S
    assert result.start_is_utc
    assert result.records[0] == VehicleAttitude(
        0.0, 60_000, pytest.approx(0.01), pytest.approx(-0.02), pytest.approx(math.pi / 2), pytest.approx((0, 0, 0.1))
    )
    (depth,) = of(VehicleDepth, result)
    assert (depth.arrived_s, depth.pressure_pa, depth.temperature_degc) == (0.5, 121_500.0, 12.5)
    (servo,) = of(VehicleServoOutput, result)
    assert servo.pwm_us[:8] == tuple(range(1500, 1508))
    assert of(VehicleBattery, result)[0].voltage_v == 15.2
    assert of(VehicleRange, result) == [VehicleRange(pytest.approx(0.9), 60_900, 3.25, None)]
    assert [event.text for event in of(Event, result)] == ["autopilot: leak"]


def test_a_position_that_repeats_is_no_measurement(log, imported):
    for step in range(6):
        log.gps_input(1.0 + step, LATITUDE_DEG + (step // 3) * 1e-6, LONGITUDE_DEG)
    result = imported(log)
    fixes = of(PositionFix, result)
    assert [fix.measured_s for fix in fixes] == [1.0, 4.0]
    assert fixes[0].source == "gps_input"
    assert fixes[0].latitude_deg == pytest.approx(LATITUDE_DEG, abs=1e-9)
    assert fixes[0].covariance_ne_m2 is None
    assert result.report.left_out["GPS_INPUT positions that repeat the one before: nothing new was measured"] == 4


def test_a_frozen_position_is_named(log, imported):
    for step in range(30):
        log.gps_input(1.0 + step, LATITUDE_DEG, LONGITUDE_DEG)
    assert any("frozen; check the topside receiver" in note for note in imported(log).report.notes)


@pytest.mark.parametrize(
    ("fix", "hdop", "latitude_deg", "why"),
    [
        (0, 1.5, LATITUDE_DEG, "without a fix"),
        (3, 99.99, LATITUDE_DEG, "without a fix"),
        (3, math.nan, LATITUDE_DEG, "without a fix"),
        (3, 1.5, 0.0, "latitude 0, longitude 0"),
        (3, 1.5, 91.0, "outside the globe"),
    ],
)
def test_a_position_that_is_none_is_left_out_with_its_reason(log, imported, fix, hdop, latitude_deg, why):
    log.gps_input(1.0, latitude_deg, LONGITUDE_DEG if latitude_deg else 0.0, fix=fix, hdop=hdop)
    result = imported(log)
    assert not of(PositionFix, result)
    (reason,) = [reason for reason in result.report.left_out if "GPS_INPUT" in reason]
    assert why in reason


def test_only_a_stated_accuracy_becomes_a_covariance(log, imported):
    log.gps_input(1.0, LATITUDE_DEG, LONGITUDE_DEG, accuracy_m=2.0)
    (fix,) = of(PositionFix, imported(log))
    assert fix.covariance_ne_m2 == (4.0, 0.0, 4.0)


def test_the_echo_of_gps_input_is_not_taken_twice(log, imported):
    log.gps_input(1.0, LATITUDE_DEG, LONGITUDE_DEG)
    log.gps_raw(1.1, LATITUDE_DEG, LONGITUDE_DEG)
    assert [fix.source for fix in of(PositionFix, imported(log))] == ["gps_input"]


@pytest.mark.parametrize(("gps_type", "kind"), [(1, GpsFix), (14, PositionFix), (None, PositionFix)])
def test_what_feeds_the_autopilots_gps_decides_what_its_position_is(log, imported, gps_type, kind):
    if gps_type is not None:
        log.parameter(0.5, "GPS_TYPE", float(gps_type))
    log.gps_raw(1.0, LATITUDE_DEG, LONGITUDE_DEG)
    (fix,) = of((GpsFix, PositionFix), imported(log))
    assert isinstance(fix, kind)
    assert fix.longitude_deg == pytest.approx(LONGITUDE_DEG, abs=1e-9)
    if isinstance(fix, GpsFix):
        assert (fix.satellites, fix.hdop, fix.speed_mps) == (11, 1.2, 0.4)
        assert fix.course_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_a_step_of_the_ground_stations_clock_is_put_right_by_the_autopilots_time(log, imported, step_s):
    for second in range(1, 5):
        log.attitude(second)
    for second in range(5, 9):
        log.attitude(second + step_s, boot_s=60.0 + second)
    result = imported(log)
    assert [record.arrived_s for record in of(VehicleAttitude, result)] == pytest.approx(list(range(9)))
    assert any(f"set by {step_s:+.1f} s" in note for note in result.report.notes)


def test_a_pause_of_the_log_stays_a_pause(log, imported):
    log.heartbeat(1.0)
    log.heartbeat(100.0)
    log.attitude(100.5)
    result = imported(log)
    assert of(VehicleAttitude, result)[-1].arrived_s == pytest.approx(100.5)
    assert any("the log pauses for 99" in note for note in result.report.notes)


def test_a_restart_of_the_autopilot_is_named_and_time_goes_on(log, imported):
    log.attitude(1.0)
    log.attitude(2.0, boot_s=3.0)
    result = imported(log)
    assert [record.arrived_s for record in of(VehicleAttitude, result)] == pytest.approx([0.0, 1.0, 2.0])
    assert any("autopilot restarted" in note for note in result.report.notes)


def test_a_second_vehicle_is_not_mixed_in(log, imported):
    log.attitude(0.5)
    log.heartbeat(0.6, (2, 1))
    log.heartbeat(0.7)
    log.attitude(0.8, sender=(2, 1))
    result = imported(log)
    assert len(of(VehicleAttitude, result)) == 2
    assert any("2 autopilots" in note for note in result.report.notes)


def test_damage_is_stepped_over_and_counted(log, imported):
    good = log.content
    log.attitude(1.0)
    flipped = bytearray(log.content[len(good) :])
    flipped[25] ^= 0xFF
    log.content = good + b"\xfd\x00rubbish" + bytes(flipped)
    log.attitude(2.0)
    log.content = log.content[:-3]
    result = imported(log)
    assert len(of(VehicleAttitude, result)) == 1
    assert result.report.left_out["frames whose checksum is wrong"] == 1
    assert result.report.left_out["damaged bytes between the frames"] > 9


def test_a_log_without_a_vehicle_is_refused_with_its_cure(tmp_path):
    log = TelemetryLog()
    log.add(mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3), 0.0, (255, 190))
    path = tmp_path / "ground.tlog"
    path.write_bytes(log.content)
    with pytest.raises(RecordingError, match="recorded while the vehicle was connected"):
        import_telemetry_log(path)


@pytest.mark.data
def test_the_bench_log_of_a_real_vehicle():
    result = import_telemetry_log(recording("bluerov2_ardusub_logs", "bench_2023-04-18_11-03-34.tlog"))
    assert len(of(VehicleAttitude, result)) == 6210
    assert len(of(VehicleDepth, result)) == 627
    assert len(of(VehicleRange, result)) == 919
    assert not of((PositionFix, GpsFix), result)
    assert result.report.left_out["frames whose checksum is wrong"] == 1967
    assert {record.pwm_us[:6] for record in of(VehicleServoOutput, result)} == {(1500,) * 6}


@pytest.mark.data
def test_the_frozen_position_of_a_real_dive_is_taken_once():
    result = import_telemetry_log(recording("bluerov2_ardusub_logs", "surface_ugps_2023-05-04.tlog"))
    (fix,) = of(PositionFix, result)
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((48.3861418, -124.6305732), abs=1e-9)
    assert result.report.left_out["GPS_INPUT without a fix (fix type below 2, or hdop 99.99)"] == 75
    assert any("frozen" in note for note in result.report.notes)
    times = [record.arrived_s for record in of(VehicleAttitude, result)]
    assert sorted(times) == times
    assert times[-1] == pytest.approx(263.4, abs=0.5)
