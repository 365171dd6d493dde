"""The thesis's real logs from end to end: targets, parameter file, report, command line."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from click.testing import CliRunner

import real_data
from bluerov_slam.acoustics import thesis_log
from bluerov_slam.cli.isbl import command
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.evaluation import thesis_training as training
from bluerov_slam.evaluation.thesis_halves import session_of
from bluerov_slam.survey import thesis_parameters, thesis_report, thesis_study


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


@pytest.fixture(scope="module", params=thesis_log.MOTIONS)
def part(request, study):
    """The shortest log of a kind of motion, as it is and parted."""
    log = min((log for log in study.scored_logs if log.motion == request.param), key=lambda log: len(log.rows))
    return log, session_of(log)


def spoilt(log, first_row, names):
    """The same log with other numbers in some columns from a row on."""
    rng = np.random.default_rng(4)
    columns = {name: getattr(log.rows, name).copy() for name in names}
    for column in columns.values():
        column[first_row:] += rng.normal(0.0, 300.0, column[first_row:].shape)
    return replace(log, rows=replace(log.rows, **columns))


def test_nothing_that_training_gets_depends_on_the_second_half(part):
    """Neither on its truth nor on its measurements: not even the period of the transmitter and the replay."""
    log, session = part
    names = ("acoustic_mm", "fused_mm", "raw_mm", "true_mm", "attitude_deg")
    first = session_of(spoilt(log, session.measured.second_from, names)).first
    for had, has in zip(flat(session.first), flat(first), strict=True):
        np.testing.assert_array_equal(had, has)
    level = 1
    calibrations = [training.calibrated(each, each.scored, level) for each in (session.first, first)]
    np.testing.assert_array_equal(*(each.coefficients_mm for each in calibrations))
    assert len({str(training.blindly_tuned([each], log.motion, str, rounds=1)) for each in (session.first, first)}) == 1


def test_no_estimate_depends_on_any_truth_of_the_second_half(part):
    log, session = part
    other = session_of(spoilt(log, session.measured.second_from, ("true_mm",)))
    parameters = thesis_parameters.shipped_parameters()
    for estimates in (held_out.estimates, held_out.blind_estimates):
        for smoothed in (False, True):
            for anew in (False, True):
                found = [
                    estimates([each.measured], parameters, smoothed=smoothed, anew=anew)[log.name]
                    for each in (session, other)
                ]
                np.testing.assert_array_equal(*found)
    assert np.abs(session.second.error_mm(found[0]) - other.second.error_mm(found[0])).max() > 100.0


def flat(half):
    return [*(getattr(half.measured, f.name) for f in fields(half.measured)), half.true_mm, half.scored]


_MISSED = "slip lattice smoothed, stationary, started anew in the second half: RMSE (real)"
"""The one target that is not reached (docs/isbl-thesis.md)."""


@pytest.mark.long
def test_every_target_on_the_logs_but_one_is_met(study):
    rows = thesis_study.reproduced_rows(study) + thesis_study.held_out_rows(
        study, thesis_parameters.shipped_parameters()
    )
    judged = [row for row in rows if row.must is not None]
    assert len(judged) >= 16
    assert [row.name for row in judged if not row.met] == [_MISSED]
    missed_aims = [row.name for row in judged if row.aim is not None and not row.aim.met_by(row.interval.value)]
    assert missed_aims == [_MISSED]


@pytest.mark.long
def test_the_shipped_parameters_come_out_of_the_first_halves_byte_for_byte(study):
    assert (
        thesis_parameters.as_text(training.train([each.first for each in study.sessions]))
        == thesis_parameters.shipped_text()
    )


@pytest.mark.long
def test_the_reports_of_the_halves_stand_alone(study):
    parameters = thesis_parameters.shipped_parameters()
    rows = thesis_study.held_out_rows(study, parameters)
    page = thesis_report.held_out_report(study, rows, parameters)
    assert page.count("<svg") == 4
    assert all(f">{row.id}<" in page for row in rows)
    assert "not met: I21.21" in page
    page = thesis_report.training_report(study, parameters, True)
    assert page.count("<svg") == 3
    assert all(session.name in page for session in study.sessions)
    assert "byte for byte" in page
    assert "differ" in thesis_report.training_report(study, parameters, False)


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
