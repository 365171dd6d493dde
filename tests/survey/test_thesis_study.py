"""The thesis's real logs from end to end: targets, parameter file, report, command line."""

import json

import pytest
from click.testing import CliRunner

import real_data
from bluerov_slam.cli.isbl import command
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.survey import thesis_parameters, thesis_study


@pytest.fixture(scope="module")
def study():
    real_data.recording("isbl_thesis", "published_stats.json")
    return thesis_study.read_study(real_data.recording("isbl_thesis", "raw_logs.tar.gz").parents[1])


def test_the_shipped_file_is_what_its_parameters_write():
    assert thesis_parameters.as_text(thesis_parameters.shipped_parameters()) == thesis_parameters.shipped_text()


def test_says_where_the_logs_should_be(tmp_path):
    result = CliRunner().invoke(command, ["reproduce", "--data", str(tmp_path)])
    assert "the thesis's logs are needed" in str(result.exception)


def test_calibrate_knows_no_other_way():
    result = CliRunner().invoke(command, ["calibrate"])
    assert "--train-only" in str(result.exception)


@pytest.mark.long
def test_every_target_on_the_logs_is_met(study):
    rows = thesis_study.reproduced_rows(study) + thesis_study.held_out_rows(
        study, thesis_parameters.shipped_parameters()
    )
    judged = [row for row in rows if row.must is not None]
    assert len(judged) >= 16
    assert [row.name for row in judged if not row.met] == []
    assert [row.name for row in judged if row.aim is not None and not row.aim.met_by(row.interval.value)] == []


@pytest.mark.long
def test_the_shipped_parameters_come_out_of_the_first_halves_byte_for_byte(study):
    assert thesis_parameters.as_text(held_out.train(study.sessions)) == thesis_parameters.shipped_text()


@pytest.mark.long
def test_the_command_writes_table_and_report(tmp_path):
    data = real_data.recording("isbl_thesis", "raw_logs.tar.gz").parents[1]
    table, report = tmp_path / "table.json", tmp_path / "report.html"
    arguments = ["reproduce", "--data", str(data), "--json", str(table), "--report", str(report)]
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.output.count("Every target is met") == 1
    rows = json.loads(table.read_text())
    assert all({"id", "name", "value", "unit", "must", "aim", "met"} <= row.keys() for row in rows)
    assert all("real" in row["name"] for row in rows)
    assert len({row["id"] for row in rows}) == len(rows)
    page = report.read_text()
    assert page.count("<svg") == 4
    assert "published as iSBL-SF Kalman filter" in page
