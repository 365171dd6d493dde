import math

import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import (
    GpsFix,
    PositionFix,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleRange,
    VehicleServoOutput,
)
from bluerov_slam.sources.dataflash_log import import_dataflash_log
from log_samples import DataflashLog
from real_data import recording


@pytest.fixture
def log() -> DataflashLog:
    made = DataflashLog()
    for step in range(5):
        at_s = 100.0 + step * 0.1
        made.add("IMU", at_s, 0, 0.01, 0.02, 0.03, 0.0, 0.0, -9.8)
        made.add("ATT", at_s + 0.01, 0.0, 1.0, 0.0, -2.0, 0.0, 270.0, 0.0, 0.0)
        made.add("BARO", at_s + 0.02, 0, 0.0, 99_800.0, 45.0, 0.0, 1)
        made.add("BARO", at_s + 0.02, 1, 0.0, 130_000.0, 12.0, 0.0, 1)
    return made


@pytest.fixture
def imported(tmp_path):
    def run(log: DataflashLog):
        path = tmp_path / "00000001.BIN"
        path.write_bytes(log.content)
        return import_dataflash_log(path)

    return run


def of(kind, result):
    return [record for record in result.records if isinstance(record, kind)]


def test_attitude_pressure_and_time_are_the_autopilots(log, imported):
    result = imported(log)
    attitudes = of(VehicleAttitude, result)
    assert [record.arrived_s for record in attitudes] == pytest.approx([0.01, 0.11, 0.21, 0.31, 0.41])
    first = attitudes[0]
    assert first.boot_ms == 100_010
    assert (first.roll_rad, first.pitch_rad) == pytest.approx((math.radians(1.0), math.radians(-2.0)))
    assert first.yaw_rad == pytest.approx(-math.pi / 2)
    assert first.angular_rate_frd_radps == pytest.approx((0.01, 0.02, 0.03))
    assert result.start_unix_s is None
    assert any("no date" in note for note in result.report.notes)


def test_only_the_external_sensor_is_a_depth(log, imported):
    result = imported(log)
    assert {record.pressure_pa for record in of(VehicleDepth, result)} == {130_000.0}
    assert result.report.left_out["internal air pressures (barometer instance 0)"] == 5


def test_an_unhealthy_pressure_is_left_out(log, imported):
    log.add("BARO", 101.0, 1, 0.0, 90_000.0, 12.0, 0.0, 0)
    assert 90_000.0 not in {record.pressure_pa for record in of(VehicleDepth, imported(log))}


def test_without_a_gyro_the_rates_are_unknown(imported):
    log = DataflashLog()
    log.add("ATT", 5.0, 0.0, 1.0, 0.0, -2.0, 0.0, 270.0, 0.0, 0.0)
    (attitude,) = of(VehicleAttitude, imported(log))
    assert all(math.isnan(rate) for rate in attitude.angular_rate_frd_radps)


@pytest.mark.parametrize(("gps_type", "kind"), [(1.0, GpsFix), (14.0, PositionFix)])
def test_positions_thrusters_battery_and_height(log, imported, gps_type, kind):
    log.add("PARM", 99.0, "GPS_TYPE", gps_type)
    log.add("GPS", 101.0, 0, 3, 0, 0, 11, 0.9, 48.1, -4.5, 2.0, 0.3, 90.0, 0.0, 1)
    log.add("GPS", 101.2, 0, 1, 0, 0, 0, 99.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1)
    log.add("RCOU", 101.3, *range(1500, 1508))
    log.add("BAT", 101.4, 0, 15.5, -11.2, 255)
    log.add("RFND", 101.5, 0, 3.2, 4, 25)
    log.add("RFND", 101.6, 0, 0.1, 2, 25)
    log.add("CTUN", 101.7, 0.5)
    result = imported(log)
    (fix,) = of((GpsFix, PositionFix), result)
    assert isinstance(fix, kind)
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((48.1, -4.5))
    assert of(VehicleServoOutput, result)[0].pwm_us == (*range(1500, 1508), *[0] * 8)
    assert of(VehicleBattery, result)[0] == VehicleBattery(pytest.approx(1.4), 15.5, None, None)
    assert of(VehicleRange, result)[0].distance_m == pytest.approx(3.2)
    assert len(of(VehicleRange, result)) == 1
    assert result.report.left_out["entries of 1 kinds that navigation has no use for"] == 1


def test_damage_and_a_cut_end_are_stepped_over(log, imported):
    intact = len(imported(log).records)
    log.content = log.content + b"rubbish that is no entry"
    for step in range(41):
        log.add("ATT", 102.0 + 0.1 * step, 0.0, 1.0, 0.0, -2.0, 0.0, 270.0, 0.0, 0.0)
    log.content = log.content[:-5]
    result = imported(log)
    assert len(result.records) == intact + 40
    assert result.report.left_out["damaged places in the file"] >= 1


def test_one_wrong_time_takes_nothing_with_it(log, imported):
    log.add("RCOU", 9_000_000.0, *[1500] * 8)
    log.add("ATT", 101.0, 0.0, 1.0, 0.0, -2.0, 0.0, 270.0, 0.0, 0.0)
    result = imported(log)
    assert not of(VehicleServoOutput, result)
    assert of(VehicleAttitude, result)[-1].arrived_s == pytest.approx(1.0)
    assert result.report.left_out["entries whose time is out of order"] == 1


def test_a_log_of_nothing_useful_is_refused_with_its_cure(tmp_path):
    log = DataflashLog()
    path = tmp_path / "empty.BIN"
    path.write_bytes(log.content)
    with pytest.raises(RecordingError, match="without a single entry"):
        import_dataflash_log(path)
    path.write_bytes(b"\xa3\x95" + bytes(3000))
    with pytest.raises(RecordingError, match="dataflash log"):
        import_dataflash_log(path)


@pytest.mark.data
def test_a_real_log_gives_water_pressure_and_attitude():
    result = import_dataflash_log(recording("bluerov2_ardusub_logs", "static_ekf3.BIN"))
    depths = [record.pressure_pa for record in of(VehicleDepth, result)]
    assert len(depths) == len(of(VehicleAttitude, result)) == 237
    # The air inside has 99.8 kPa, the outside sensor of this vehicle 97.8.
    assert 97_000.0 < min(depths) <= max(depths) < 98_500.0
    assert not of((PositionFix, GpsFix), result)
    assert all(math.isfinite(r) for a in of(VehicleAttitude, result) for r in a.angular_rate_frd_radps)
