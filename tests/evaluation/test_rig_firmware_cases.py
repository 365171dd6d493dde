"""R9: what the firmware's angles and counts become in the table, and what is said where there are none."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.cli.main import cli
from bluerov_slam.errors import LinkError
from bluerov_slam.evaluation.rig_cases import RigFirmware, RigRun, all_cases
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM
from bluerov_slam.rig.platform import servo_angles_rad

COUNTS = {"ik_six_legs_mean": 20_000.0, "ik_six_legs_worst": 24_000.0}


def rows_of(angles_rad, counts=lambda: COUNTS):
    rows = all_cases()["R9"].run(RigRun(seed=7, effort=0.05, firmware=RigFirmware(angles_rad, counts)))
    return {row.id: row for row in rows}


def off_by(degrees):
    return lambda points: servo_angles_rad(points, FO_SHIP_PLATFORM) + np.radians(degrees)


def test_the_largest_difference_of_any_servo_is_judged() -> None:
    assert rows_of(off_by(0.009))["R9"].met is True
    worse = rows_of(off_by(0.011))
    assert worse["R9"].met is False
    assert worse["R9"].interval.value == pytest.approx(0.011, rel=1e-6)
    assert worse["R9.rms"].interval.value == pytest.approx(0.011, rel=1e-6)


def test_all_set_points_can_be_reached_and_a_refusal_is_a_miss() -> None:
    asked = []

    def one_refused(points):
        asked.append(points)
        angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
        angles[0] = np.nan
        return angles

    rows = rows_of(one_refused)
    assert np.isfinite(servo_angles_rad(asked[0], FO_SHIP_PLATFORM)).all()
    assert rows["R9.refused"].interval.value == pytest.approx(100.0 / len(asked[0]))
    assert rows["R9.refused"].met is False
    assert rows["R9"].met is True


def test_nothing_but_refusals_is_no_difference_of_zero() -> None:
    rows = rows_of(lambda points: np.full(points.shape, np.nan))
    assert np.isnan(rows["R9"].interval.value)
    assert rows["R9"].met is False


def test_the_time_is_an_estimate_from_the_counts() -> None:
    rows = rows_of(off_by(0.0))
    assert rows["R9.instructions"].interval.value == 20_000.0
    assert rows["R9.instructions_worst"].interval.value == 24_000.0
    assert rows["R9.time"].interval.value == pytest.approx(125.0)  # 20 000 x 1.5 cycles at 240 MHz
    assert "estimate" in rows["R9.time"].name
    assert [rows[name].must for name in ("R9.instructions", "R9.time")] == [None, None]


def test_what_was_not_measured_is_null_with_the_reason() -> None:
    def fails(*_):
        raise LinkError("there is no program; build it")

    rows = rows_of(fails, fails)
    assert set(rows) == {"R9", "R9.instructions"}
    for row in rows.values():
        assert row.as_json()["value"] is None
        assert "not measured: there is no program; build it" in row.name
    assert rows["R9"].met is False


def test_the_command_says_how_to_get_what_is_missing(tmp_path) -> None:
    file = tmp_path / "r9.json"
    told = CliRunner().invoke(
        cli, ["rig", "evaluate", "--cases", "R9", "--firmware", str(tmp_path / "build"), "--json", str(file)]
    )
    assert told.exit_code == 0, told.output
    rows = {row["id"]: row for row in json.loads(file.read_text())}
    assert rows["R9"]["value"] is None
    assert "make firmware" in rows["R9"]["name"]
    assert "try_all" in rows["R9.instructions"]["name"]
    assert "Not met: R9" in told.output
