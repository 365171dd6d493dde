"""The cases R1...: each runs small and gives rows with ids of its own, the same for the same seed."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import real_data
from bluerov_slam.cli.main import cli
from bluerov_slam.evaluation.rig_cases import RigRun, all_cases, figure
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

SMALL = RigRun(seed=7, effort=0.01)
QUICK = ("R1", "R4", "R5", "R6", "R7", "R8", "R11")
WITHOUT_FEW = {"R7", "R8"}
"""Judged by a limit that a handful of draws cannot keep."""


def test_ids_are_those_of_their_cases_and_in_order() -> None:
    known = all_cases()
    assert set(QUICK) <= set(known)
    numbers = [int(name[1:]) for name in known]
    assert numbers == sorted(numbers)


@pytest.mark.parametrize("name", QUICK)
def test_every_case_gives_finite_rows_of_its_own(name: str) -> None:
    rows = all_cases()[name].run(SMALL)
    assert rows
    assert len({row.id for row in rows}) == len(rows)
    assert all(np.isfinite(row.interval.value) for row in rows)
    assert any(row.must is not None for row in rows)
    assert [row.id for row in rows if row.met is False and row.id not in WITHOUT_FEW] == []


def test_the_servo_test_names_a_stuck_servo_in_drawn_rigs() -> None:
    rows = {row.id: row for row in all_cases()["R10"].run(SMALL)}
    assert rows["R10.stuck0"].interval.value == rows["R10.stuck9"].interval.value == 0.0


def test_the_zero_test_names_a_servo_far_off_in_drawn_rigs_and_accuses_no_good_one() -> None:
    rows = {row.id: row.interval.value for row in all_cases()["R13"].run(SMALL)}
    clean = ("R13.none", "R13.again.none", "R13.20", "R13.again.10", "R13.10.wrong", "R13.again.5.wrong")
    assert {name: rows[name] for name in clean} == dict.fromkeys(clean, 0.0)
    assert rows["R13.2"] == 100.0


def test_the_truth_of_the_real_logs_is_that_of_the_kinematics() -> None:
    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    rows = all_cases()["R3"].run(RigRun(logs=logs))
    assert all(row.met for row in rows)


def test_the_same_seed_gives_the_same_figures() -> None:
    first, second = (all_cases()["R11"].run(SMALL) for _ in range(2))
    assert [row.interval.value for row in first] == [row.interval.value for row in second]


def test_a_figure_is_judged_on_the_side_of_its_limit() -> None:
    assert figure("x", "x", 1.0, "mm", high=1.0).met is True
    assert figure("x", "x", 1.1, "mm", high=1.0).met is False
    assert figure("x", "x", 99.0, "%", low=99.5).met is False
    assert figure("x", "x", float("nan"), "%", low=0.0).met is False
    assert figure("x", "x", 1.0, "mm").met is None


def test_the_command_writes_the_table_as_json(tmp_path) -> None:
    file = tmp_path / "rig.json"
    told = CliRunner().invoke(cli, ["rig", "evaluate", "--cases", "R5,r6", "--json", str(file)])
    assert told.exit_code == 0, told.output
    assert "Every target is met" in told.output
    rows = json.loads(file.read_text())
    assert {"id", "name", "value", "unit", "must", "aim", "met"} <= set(rows[0])
    assert rows[0]["id"] == "R5"


def test_what_is_missing_or_unknown_is_told(tmp_path) -> None:
    told = CliRunner().invoke(cli, ["rig", "evaluate", "--cases", "R3", "--data", str(tmp_path)])
    assert "R3 is left out" in told.output
    (tmp_path / "isbl_thesis").mkdir()
    (tmp_path / "isbl_thesis" / "raw_logs.tar.gz").write_text("no archive")
    damaged = CliRunner().invoke(cli, ["rig", "evaluate", "--cases", "R3", "--data", str(tmp_path)])
    assert "a tar archive: file could not be opened successfully; fetch it again" in str(damaged.exception)
    full = CliRunner().invoke(cli, ["rig", "evaluate", "--cases", "R6", "--json", "/dev/full"])
    assert "Give --json another place" in str(full.exception)
    for effort in ("nan", "inf", "1e9", "0"):
        assert CliRunner().invoke(cli, ["rig", "evaluate", "--effort", effort]).exit_code == 2
    wrong = CliRunner().invoke(cli, ["rig", "evaluate", "--cases", "R99"])
    assert "R99 is none of R1" in str(wrong.exception)
