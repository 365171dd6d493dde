"""`bluerov-slam isbl evaluate` from the outside."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from bluerov_slam.cli.isbl import command
from bluerov_slam.cli.isbl_evaluate import Task, run_task
from bluerov_slam.errors import ConfigError
from bluerov_slam.evaluation.acoustic_cases import AcousticJob, jobs_for, table
from bluerov_slam.survey import thesis_study
from bluerov_slam.survey.acoustic_evaluation import every_case
from bluerov_slam.survey.batch import BatchError
from real_data import recording

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'bluerov-slam[survey]'")


def test_a_case_runs_and_the_logs_are_named_where_they_are_not(tmp_path: Path) -> None:
    out = tmp_path / "table.json"
    arguments = ["evaluate", "--cases", "I5,I20,I21", "--draws", "2", "--jobs", "1", "--data", str(tmp_path)]
    result = CliRunner().invoke(command, [*arguments, "--json", str(out)], catch_exceptions=False)
    rows = {row["id"]: row for row in json.loads(out.read_text())}
    assert rows["I20"]["value"] is rows["I20"]["met"] is rows["I21"]["value"] is None
    assert "skipped" in rows["I20"]["name"]
    assert str(tmp_path / "isbl_thesis") in rows["I21"]["name"]
    assert all({"id", "name", "value", "unit", "must", "aim", "met"} <= row.keys() for row in rows.values())
    assert any(name.startswith("I5") for name in rows)
    assert "[1/" in result.output


def test_the_report_has_every_row_and_the_plots_of_every_case(tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    cases = "I1,I4,I5,I6,I9,I20"
    arguments = ["evaluate", "--cases", cases, "--draws", "2", "--jobs", "1", "--data", str(tmp_path)]
    result = CliRunner().invoke(
        command, [*arguments, "--json", str(tmp_path / "rows.json"), "--report", str(out)], catch_exceptions=False
    )
    assert f"Wrote {out}" in result.output
    page = out.read_text()
    # I1 timing and bands, I5 scatter, range and surface, one plot each of I4, I6 and I9.
    assert page.count("<svg") == 2 + 3 + 3
    assert all(f">{row['id']}<" in page for row in json.loads((tmp_path / "rows.json").read_text()))
    assert "Only 2 draws" in page
    assert "skipped" in page
    assert 'src="http' not in page
    assert not re.search(r">-?nan[ <]", page)


def test_a_report_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    arguments = [
        "evaluate",
        "--cases",
        "I20",
        "--data",
        str(tmp_path),
        "--report",
        str(tmp_path / "no" / "report.html"),
    ]
    result = CliRunner().invoke(command, arguments)
    assert isinstance(result.exception, ConfigError)
    assert "report.html" in str(result.exception)


def test_every_case_has_an_id_of_the_list() -> None:
    listed = (Path(__file__).resolve().parents[2] / "docs" / "acoustics.md").read_text(encoding="utf-8")
    assert [name for name in every_case() if f"| {name} |" not in listed] == []


def test_an_unknown_case_and_a_scheduler_that_is_none_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    result = CliRunner().invoke(command, ["evaluate", "--cases", "I5,I99"])
    assert isinstance(result.exception, ConfigError)
    assert "I99" in str(result.exception)
    monkeypatch.setattr("bluerov_slam.survey.batch._CONNECT_TIMEOUT_S", 0.5)
    result = CliRunner().invoke(command, ["evaluate", "--cases", "I5", "--scheduler", "tcp://127.0.0.1:1"])
    assert isinstance(result.exception, BatchError)


@pytest.mark.long
def test_rows_of_the_logs_are_those_of_the_commands() -> None:
    data = recording("isbl_thesis", "raw_logs.tar.gz").parent
    case = every_case()["I20"]
    (job,) = jobs_for([case], 1000, 1000)
    assert job == AcousticJob("I20", "logs", 1000, 0)
    rows = table([case], [(job, run_task(Task(job, str(data))))])
    assert rows == thesis_study.reproduced_rows(thesis_study.read_study(data.parent))
