import math

import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.records import PositionFix
from bluerov_slam.sources.acoustic_csv import import_acoustic_folder
from log_samples import csv_text
from real_data import recording

START_S = 1_733_436_754.0
BOAT_DEG = (48.68, -123.19)
ACOUSTIC = ("timestamp", "position_valid", "x", "y", "z", "std")


def write(folder, acoustic, *, yaw_deg=90.0, until_s=10):
    seconds = range(until_s)
    tables = {
        "dive_g2_acoustic.csv": csv_text(ACOUSTIC, [(START_S + row[0], *row[1:]) for row in acoustic]),
        "dive_g2_orientation.csv": csv_text(("timestamp", "yaw"), [(START_S + s, yaw_deg) for s in seconds]),
        "dive_g2_position.csv": csv_text(("timestamp", "lat", "lon"), [(START_S + s, *BOAT_DEG) for s in seconds]),
    }
    for name, text in tables.items():
        (folder / name).write_text(text)


def test_forward_and_starboard_turn_with_the_antenna(tmp_path):
    write(tmp_path, [(1.0, True, 10.0, 5.0, 3.0, 1.5)])
    result = import_acoustic_folder(tmp_path)
    (fix,) = result.records
    assert isinstance(fix, PositionFix)
    north_m, east_m, _ = LocalFrame(*BOAT_DEG).to_ned_m(fix.latitude_deg, fix.longitude_deg)
    # Heading east: forward is east, starboard is south.
    assert (north_m, east_m) == pytest.approx((-5.0, 10.0), abs=1e-6)
    assert fix.covariance_ne_m2 == (2.25, 0.0, 2.25)
    assert fix.depth_m == 3.0
    assert result.start_unix_s == START_S + 1.0


def test_what_is_invalid_repeated_or_without_reference_is_left_out(tmp_path):
    rows = [
        (1.0, True, 1.0, 1.0, 1.0, 1.0),
        (1.2, True, 1.0, 1.0, 1.0, 1.0),
        (1.4, False, 2.0, 1.0, 1.0, 1.0),
        (1.6, True, 3.0, 1.0, 1.0, 100),
        (1.8, True, "nan", 1.0, 1.0, 1.0),
        (30.0, True, 4.0, 1.0, 1.0, 1.0),
        (31.0, True, 5.0, 1.0),
    ]
    write(tmp_path, rows)
    result = import_acoustic_folder(tmp_path)
    assert len(result.records) == 1
    assert sum(result.report.left_out.values()) == 6
    assert result.report.left_out["positions without antenna heading or boat position at their time"] == 1


def test_a_folder_that_is_not_whole_is_refused_with_its_cure(tmp_path):
    write(tmp_path, [(1.0, False, 1.0, 1.0, 1.0, 1.0)])
    with pytest.raises(RecordingError, match="was the locator in the water"):
        import_acoustic_folder(tmp_path)
    (tmp_path / "dive_g2_position.csv").unlink()
    with pytest.raises(RecordingError, match=r"no file \*_g2_position.csv"):
        import_acoustic_folder(tmp_path)


@pytest.mark.data
def test_the_real_dive_of_2024_goes_out_a_hundred_metres_and_back():
    folder = recording("bluerov2_ugps_dive", "2024-12-05_22-12-34_g2_acoustic.csv").parent
    result = import_acoustic_folder(folder)
    assert len(result.records) == 1723
    frame = LocalFrame(48.684828, -123.192064)
    away = [math.hypot(*frame.to_ned_m(fix.latitude_deg, fix.longitude_deg)[:2]) for fix in result.records]
    assert 80.0 < max(away) < 110.0
    assert away[0] < 5.0
    assert away[-1] < 5.0
    assert all(fix.covariance_ne_m2 is not None for fix in result.records)
