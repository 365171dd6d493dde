"""`bluerov-slam evaluate navigation` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from bluerov_slam.cli.evaluate import Task, run_task
from bluerov_slam.cli.main import cli
from bluerov_slam.errors import ConfigError, ExpectedError
from bluerov_slam.evaluation.navigation_cases import Job, SnapirOutcome
from real_data import recording

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'bluerov-slam[survey]'")


@pytest.mark.data
def test_writes_the_table_of_a_case_on_real_data(tmp_path: Path) -> None:
    folder = recording("auv_dvl_gt_snapir").parent
    out = tmp_path / "table.json"
    arguments = ["evaluate", "navigation", "--cases", "N7", "--seeds", "1", "--jobs", "1", "--data", str(folder)]
    result = CliRunner().invoke(cli, [*arguments, "--json", str(out)])
    assert result.exit_code == 0, result.output
    rows = {row["id"]: row for row in json.loads(out.read_text())}
    assert rows["N7"]["must"] == "<= 0.55"
    assert rows["N7"]["value"] < rows["N7.plain"]["value"]
    assert "N7.heading" in result.output
    assert "[10/10] N7" in result.output


def test_real_cases_are_left_out_with_a_reason_where_their_data_is_not(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["evaluate", "navigation", "--cases", "N7,N8", "--data", str(tmp_path)])
    assert result.exit_code == 0
    assert "N7 is left out: it needs the recordings in" in result.output
    assert "N8 is left out" in result.output


def test_an_unknown_case_is_named() -> None:
    result = CliRunner().invoke(cli, ["evaluate", "navigation", "--cases", "N2,N9"])
    assert isinstance(result.exception, ConfigError)
    assert isinstance(result.exception, ExpectedError)
    assert "N9" in str(result.exception)


def test_tuning_seeds_are_called_no_test(tmp_path: Path) -> None:
    arguments = ["evaluate", "navigation", "--cases", "N8", "--seed-base", "5", "--data", str(tmp_path)]
    assert "the figures are no test" in CliRunner().invoke(cli, arguments).output


@pytest.mark.data
def test_a_worker_finds_its_data_by_itself() -> None:
    folder = recording("auv_dvl_gt_snapir").parent
    (outcome,) = run_task(Task(Job("N7", "3", 1000), "reference", str(folder)))
    assert isinstance(outcome, SnapirOutcome)
    assert outcome.track == 3
