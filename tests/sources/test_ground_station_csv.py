import math

import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import PositionFix, VehicleAttitude, VehicleBattery, VehicleDepth, VehicleRange
from bluerov_slam.sources.ground_station_csv import import_ground_station_csv
from log_samples import csv_text
from real_data import recording

COLUMNS = (
    "Timestamp", "roll", "pitch", "heading", "rollRate", "pitchRate", "yawRate", "altitudeRelative", "altitudeTuning",
    "battery0.voltage", "battery0.current", "distanceSensor.rotationPitch270", "gps.lat", "gps.lon", "gps.hdop",
    "gps.lock",
)  # fmt: skip
FOOT_M = 0.3048


def row(second: int, **changes: object) -> list[object]:
    depth_m = 0.2 * second
    values: dict[str, object] = {
        "Timestamp": f"2022-08-15 09:{second // 60:02d}:{second % 60:02d}.500", "roll": 1.0, "pitch": -2.0,
        "heading": 270, "rollRate": 0.0, "pitchRate": 0.0, "yawRate": 0.0, "altitudeRelative": -depth_m,
        "altitudeTuning": -depth_m, "battery0.voltage": "--.--", "battery0.current": 1.5,
        "distanceSensor.rotationPitch270": "--.--", "gps.lat": 47.6 + second * 1e-6, "gps.lon": -122.3,
        "gps.hdop": 1.0, "gps.lock": 3,
    }  # fmt: skip
    return [(values | changes)[name] for name in COLUMNS]


@pytest.fixture
def imported(tmp_path):
    def run(rows, columns=COLUMNS, **options):
        path = tmp_path / "log.csv"
        path.write_text(csv_text(columns, rows))
        return import_ground_station_csv(path, **options)

    return run


def of(kind, result):
    return [record for record in result.records if isinstance(record, kind)]


def test_a_row_becomes_attitude_depth_battery_and_position(imported):
    result = imported([row(second) for second in range(30)])
    attitude = of(VehicleAttitude, result)[5]
    assert attitude.arrived_s == pytest.approx(5.0)
    assert attitude.boot_ms == 5000
    assert (attitude.roll_rad, attitude.pitch_rad) == pytest.approx((math.radians(1.0), math.radians(-2.0)))
    assert attitude.yaw_rad == pytest.approx(-math.pi / 2)
    assert of(VehicleDepth, result)[5] == VehicleDepth(pytest.approx(5.0), 5000, None, pytest.approx(1.0), None)
    assert of(VehicleBattery, result)[0] == VehicleBattery(0.0, None, 1.5, None)
    fix = of(PositionFix, result)[5]
    assert (fix.latitude_deg, fix.longitude_deg, fix.covariance_ne_m2) == (pytest.approx(47.600005), -122.3, None)
    assert not of(VehicleRange, result)


@pytest.mark.parametrize(("unit_m", "said"), [(1.0, None), (FOOT_M, "in feet"), (1.8288, "left out")])
def test_the_unit_of_the_depth_is_found_out(imported, unit_m, said):
    rows = [
        row(second, altitudeRelative=0.4 - 0.2 * second / unit_m, **{"distanceSensor.rotationPitch270": 3.0 / unit_m})
        for second in range(30)
    ]
    result = imported(rows)
    notes = " ".join(result.report.notes)
    if said == "left out":
        assert not of((VehicleDepth, VehicleRange), result)
    else:
        depths = of(VehicleDepth, result)
        assert depths[20].depth_m - depths[10].depth_m == pytest.approx(2.0)
        assert of(VehicleRange, result)[0].distance_m == pytest.approx(3.0)
    assert said is None or said in notes


def test_a_log_that_stays_at_the_surface_shows_no_unit(imported):
    rows = [row(second, altitudeRelative=-0.1, altitudeTuning=-0.1) for second in range(30)]
    assert any("metres are assumed" in note for note in imported(rows).report.notes)


def test_turn_rates_are_taken_where_there_are_any_and_unknown_elsewhere(imported):
    still = imported([row(second) for second in range(3)])
    assert all(math.isnan(rate) for rate in of(VehicleAttitude, still)[0].angular_rate_frd_radps)
    turning = imported([row(0, yawRate=10.0), row(1)])
    assert of(VehicleAttitude, turning)[0].angular_rate_frd_radps[2] == pytest.approx(math.radians(10.0))


def test_what_is_missing_is_left_out_and_counted(imported):
    rows = [
        row(0, roll="--.--"),
        row(1, **{"gps.lat": "--.--"}),
        row(2, **{"gps.lock": 0}),
        row(3, **{"gps.hdop": 99.99}),
        row(4, **{"gps.lat": 0.0, "gps.lon": 0.0}),
        row(5, Timestamp="--:--"),
        row(6)[:-4],
        row(7),
        row(8, **{"gps.lat": 47.600007}),
    ]
    result = imported(rows)
    assert len(of(VehicleAttitude, result)) == 6
    assert [fix.measured_s for fix in of(PositionFix, result)] == pytest.approx([0.0, 7.0])
    left_out = result.report.left_out
    assert left_out["rows without an attitude (--.--)"] == 1
    assert left_out["rows without a position (--.--)"] == 1
    assert left_out["positions without a lock"] == 2
    assert left_out["positions at latitude 0, longitude 0: no fix"] == 1
    assert left_out["positions that repeat the one before: nothing new was measured"] == 1
    assert left_out["rows without a readable Timestamp"] == 1
    assert left_out["rows of log.csv that are not whole"] == 1


def test_a_clock_that_is_set_back_takes_no_time(imported):
    rows = [row(10), row(11), row(2), row(3)]
    result = imported(rows)
    assert [record.arrived_s for record in of(VehicleAttitude, result)] == pytest.approx([0.0, 1.0, 1.0, 2.0])
    assert any("clock was set by -9.0 s" in note for note in result.report.notes)


def test_the_date_needs_the_zone(imported):
    rows = [row(0), row(1)]
    local = imported(rows)
    assert not local.start_is_utc
    assert any("--utc-offset" in note for note in local.report.notes)
    dated = imported(rows, utc_offset_h=-7.0)
    assert dated.start_is_utc
    assert dated.start_unix_s == local.start_unix_s + 7 * 3600


def test_a_table_without_the_columns_is_refused_with_its_cure(imported):
    with pytest.raises(RecordingError, match=r"no column heading; export the whole log"):
        imported([("2022-08-15 09:00:00", 1, 2)], ("Timestamp", "roll", "pitch"))
    with pytest.raises(RecordingError, match="without a row"):
        imported([])
    with pytest.raises(RecordingError, match=r"every row is empty"):
        imported([("2022-08-15 09:00:00", "--.--", "--.--", "--.--")], ("Timestamp", "roll", "pitch", "heading"))


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "rows", "fixes", "deepest_m"),
    [("qgc_2022-08-15_09-56-00.csv", 2594, 1536, 6.52), ("qgc_2022-08-15_11-57-51.csv", 2678, 1627, 8.20)],
)
def test_the_real_dives_of_2022_are_in_feet(name, rows, fixes, deepest_m):
    result = import_ground_station_csv(recording("bluerov2_ugps_dive", name))
    assert len(of(VehicleAttitude, result)) == rows
    assert len(of(PositionFix, result)) == fixes
    assert max(record.depth_m for record in of(VehicleDepth, result)) == pytest.approx(deepest_m, abs=0.01)
    assert any("in feet" in note for note in result.report.notes)
