"""Logs in the thesis's line format: the 27 real ones come back as they were, and a missing point has no line."""

import re
import tarfile
from collections import Counter

import numpy as np
import pytest

import real_data
from bluerov_slam.rig.collection import Discard, Keep, Point, Pressed, Result
from bluerov_slam.sinks.isbl_thesis_log import ThesisLogWriter, data_line, lines_of_rows
from bluerov_slam.sources.isbl_thesis_log import LineKind, parse_thesis_log

NAME = "test_x1426_y0_z-694_d_g"
WHOLE_SETPOINTS = "test_x1426_y0_z-694_s"


def point(**changes):
    fields = {
        "session": NAME,
        "number": 1,
        "axis": "B",
        "label": -7.0,
        "set_point": np.zeros(6),
        "published_truth_mm": np.array((110.004, -0.001, -648.376)),
        "after_discard": False,
        "result": Result(
            np.array((1.0, 2.0, 3.0)), np.array((4.0, 5.0, 6.0)), np.array((7.0, 8.0, 9.0)), np.radians((0.5, -7.25, 1))
        ),
    }
    return Point(**(fields | changes))


@pytest.mark.data
def test_the_real_logs_come_back_line_by_line():
    with tarfile.open(real_data.recording("isbl_thesis", "raw_logs.tar.gz")) as archive:
        logs = {
            member.name.split("/")[-1].removesuffix(".log"): archive.extractfile(member).read().decode("latin-1")
            for member in archive
            if member.name.endswith(".log")
        }
    assert len(logs) == 27
    lines = 0
    for name, text in logs.items():
        rows = parse_thesis_log(name, text, Counter()).rows
        written = list(lines_of_rows(rows, 0 if name == WHOLE_SETPOINTS else 2))
        original = re.split("\r\n|\n|\r", text)
        data = [original[number - 1] for number in rows.line[rows.whole]]
        assert [line for line in written if line != "DISCARD"] == data, name
        again = parse_thesis_log(name, "\n".join(written), Counter()).rows
        kept = rows.where(rows.whole)
        for field in ("axis", "setpoint", "acoustic_mm", "fused_mm", "raw_mm", "true_mm", "attitude_deg"):
            np.testing.assert_array_equal(getattr(again, field), getattr(kept, field))
        np.testing.assert_array_equal(again.after_discard, kept.after_discard)
        lines += len(data)
    assert lines == 23734


def test_what_is_collected_can_be_read_again(tmp_path):
    writer = ThesisLogWriter(tmp_path / f"{NAME}.log", "simulated")
    for action in (Discard(), Keep(point(label=17.0)), Keep(point()), Keep(point(result=None, missing="silent"))):
        writer.take(action)
    writer.take(Pressed(3))
    writer.take(Keep(point(label=-8.0)))
    writer.close()
    census = Counter()
    rows = parse_thesis_log(NAME, (tmp_path / f"{NAME}.log").read_text(encoding="ascii"), census).rows
    assert (census[LineKind.WHOLE], census[LineKind.DISCARD], census[LineKind.BOOT]) == (3, 1, 1)
    assert census[LineKind.GARBAGE] == 0
    assert rows.setpoint.tolist() == [17.0, -7.0, -8.0]
    assert rows.after_discard.tolist() == [True, False, False]
    assert rows.segment.tolist() == [1, 1, 2]
    np.testing.assert_allclose(rows.attitude_deg[0], (0.5, -7.25, 1.0))
    np.testing.assert_allclose(rows.true_mm[0], (110.0, 0.0, -648.38))


def test_a_number_that_is_none_has_no_line():
    groups = [(0.0, 0.0, 0.0)] * 4
    with pytest.raises(ValueError, match="numbers only"):
        data_line("A", 1.0, [*groups, (0.0, float("nan"), 0.0)])


def test_a_log_is_never_overwritten(tmp_path):
    path = tmp_path / "a.log"
    ThesisLogWriter(path).close()
    with pytest.raises(FileExistsError):
        ThesisLogWriter(path)
