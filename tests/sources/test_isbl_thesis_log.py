"""The reader of the thesis's serial logs: what lines can look like, and the 27 real logs where they are present."""

import csv
import gzip
from collections import Counter

import numpy as np
import pytest

import real_data
from bluerov_slam.errors import RecordingError
from bluerov_slam.sources.isbl_thesis_log import LineKind, parse_thesis_log, read_thesis_logs

NAME = "test_x1426_y-152_z-694_d_g"
VALUES = (
    "46.91, 47.05, -427.19; 44.80, 46.25, -413.85; 110.00, 98.61, -619.72; 110.00, 116.78, -631.04; 26.76, -2.13, 2.56;"
)
CENSUS = {
    LineKind.WHOLE: 23734,
    LineKind.CUT: 73,
    LineKind.GARBAGE: 2948,
    LineKind.AXIS: 7,
    LineKind.DISCARD: 1132,
    LineKind.BUTTON: 4,
    LineKind.BOOT: 697,
    LineKind.BLANK: 168,
}


def parsed(*lines, end="\r\n"):
    census = Counter()
    return parse_thesis_log(NAME, end.join(lines) + end, census), census


def test_reads_every_number_of_a_line():
    log, _ = parsed(f"A, 25.00: {VALUES}")
    rows = log.rows
    assert (log.test, log.motion, log.transmitter_mm) == (4, "gradual", (1426.0, -152.0, -694.0))
    assert (rows.axis[0], rows.setpoint[0], rows.line[0], rows.whole[0]) == ("A", 25.0, 1, True)
    np.testing.assert_array_equal(rows.acoustic_mm, [[46.91, 47.05, -427.19]])
    np.testing.assert_array_equal(rows.fused_mm, [[44.80, 46.25, -413.85]])
    np.testing.assert_array_equal(rows.raw_mm, [[110.00, 98.61, -619.72]])
    np.testing.assert_array_equal(rows.true_mm, [[110.00, 116.78, -631.04]])
    np.testing.assert_array_equal(rows.attitude_deg, [[26.76, -2.13, 2.56]])


@pytest.mark.parametrize("front", ["", "4.00", ".00", ", 3.00", " 12.00", "-12.00", "A, 2"])
def test_a_line_without_its_front_keeps_its_numbers_but_no_set_point(front):
    whole = front == "A, 2"
    log, census = parsed(f"{front}: {VALUES}")
    assert census[LineKind.WHOLE if whole else LineKind.CUT] == 1
    assert log.rows.whole[0] == whole
    assert np.isnan(log.rows.setpoint[0]) != whole
    assert log.rows.raw_mm[0, 1] == 98.61


def test_tells_what_stands_between_the_data():
    log, census = parsed(
        "ets Jul 29 2019 12:21:46", "", f"A, 25: {VALUES}", "DISCARD", f"A, 24: {VALUES}", "..4.40;", "Z"
    )
    assert census == Counter(
        {
            LineKind.BOOT: 1,
            LineKind.BLANK: 2,
            LineKind.WHOLE: 2,
            LineKind.DISCARD: 1,
            LineKind.GARBAGE: 1,
            LineKind.AXIS: 1,
        }
    )
    assert log.rows.after_discard.tolist() == [False, True]
    assert log.rows.line.tolist() == [3, 5]


def test_a_press_of_the_button_begins_a_segment():
    log, _ = parsed(f"A, 25: {VALUES}", "BUTTON PRESSED, 3", f"X, 25: {VALUES}")
    assert log.rows.segment.tolist() == [1, 2]


def test_a_lone_carriage_return_ends_a_line():
    log, census = parsed("..4.40;", f"A, 25: {VALUES}", end="\r")
    assert (len(log.rows), census[LineKind.GARBAGE]) == (1, 1)


@pytest.mark.parametrize("name", ["notes", "test_x1_y2_z3_s"])
def test_refuses_a_log_of_an_unknown_test(name):
    with pytest.raises(RecordingError):
        parse_thesis_log(name, f"A, 25: {VALUES}\n", Counter())


def test_refuses_a_log_without_data_and_a_folder_without_logs(tmp_path):
    with pytest.raises(RecordingError, match="no line of data"):
        parse_thesis_log(NAME, "DISCARD\n", Counter())
    with pytest.raises(RecordingError, match="no log"):
        read_thesis_logs(tmp_path)
    (tmp_path / "broken.tar.gz").write_bytes(b"no archive")
    with pytest.raises(RecordingError, match="cannot be read"):
        read_thesis_logs(tmp_path / "broken.tar.gz")


def test_the_real_logs_hold_what_the_census_says():
    found = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz"))
    assert len(found.logs) == 27
    assert found.census == CENSUS


def test_the_real_logs_agree_with_the_tidy_table_in_every_value():
    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    tidy = {}
    with gzip.open(real_data.recording("isbl_thesis", "estimates.csv.gz"), "rt") as file:
        for line in csv.DictReader(file):
            tidy.setdefault(line["log"], []).append(line)
    assert sorted(tidy) == [log.name for log in logs]
    for log in logs:
        lines, rows = tidy[log.name], log.rows
        assert [int(line["line"]) for line in lines] == rows.line.tolist()
        assert [int(line["segment"]) for line in lines] == rows.segment.tolist()
        assert [line["well_formed"] == "1" for line in lines] == rows.whole.tolist()
        assert [line["after_discard"] == "1" for line in lines] == rows.after_discard.tolist()
        assert [line["axis"] for line in lines] == rows.axis.tolist()
        assert {(int(line["test"]), line["motion"], line["truth_ok"] == "1") for line in lines} == {
            (log.test, log.motion, log.truth_valid)
        }
        columns = (
            ("kf_isbl", rows.acoustic_mm), ("kf_sf", rows.fused_mm), ("raw", rows.raw_mm), ("true", rows.true_mm),
        )  # fmt: skip
        for name, values in columns:
            told = [[float(line[f"{name}_{axis}"]) for axis in "xyz"] for line in lines]
            np.testing.assert_array_equal(values, told)
        angles = [[float(line[f"{name}_deg"]) for name in ("roll", "pitch", "yaw")] for line in lines]
        np.testing.assert_array_equal(rows.attitude_deg, angles)
        np.testing.assert_array_equal(rows.setpoint, [float(line["setpoint"] or "nan") for line in lines])
