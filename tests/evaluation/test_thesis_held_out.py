"""That second halves are held out, on a made-up session; the real logs are in tests/survey/test_thesis_study.py."""

from dataclasses import fields, replace

import numpy as np
import pytest

from acoustics.slip_samples import CELLS_MM, RANGE_MM, cell_probability, slipped_fixes
from bluerov_slam.acoustics.slip_lattice import LatticeSettings
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.evaluation import thesis_training as training
from bluerov_slam.evaluation.thesis_halves import FirstHalf, Measured, SecondTruth, Session, second_half_errors_mm
from bluerov_slam.evaluation.thesis_held_out import Blind, Parameters

SETTINGS = LatticeSettings(0.01, 0.01)
ROWS, SECOND_FROM = 400, 202


@pytest.fixture
def session():
    rng = np.random.default_rng(3)
    truth = np.tile([0.0, -648.0], (ROWS, 1))
    attitude = rng.normal(0.0, 0.5, (ROWS, 3))
    bias = np.array([40.0, -12.0]) + np.outer(attitude[:, 2], [-30.0, 0.0])
    raw = slipped_fixes(truth, cell_probability([0.5, 0.2, 0.2, 0.1]), rng) + bias
    scored = np.setdiff1d(np.arange(ROWS), [0, 50, 260])
    moved = np.zeros((ROWS, 2))
    measured = Measured(
        "made up", "stationary", raw, raw, attitude, np.full(ROWS, 3.0), moved, SECOND_FROM, RANGE_MM, CELLS_MM
    )
    early, late = scored[scored < SECOND_FROM], scored[scored >= SECOND_FROM]
    return Session(
        FirstHalf(cut(measured, SECOND_FROM), truth[:SECOND_FROM], early), measured, SecondTruth(late, truth[late])
    )


def cut(measured, stop):
    names = ("raw_mm", "fused_mm", "attitude_deg", "interval_s", "displacement_mm")
    return replace(measured, **{name: getattr(measured, name)[:stop] for name in names})


def parameters_of(session):
    calibration = held_out.rounded(training.calibrated(session.first, session.first.scored, 2))
    return Parameters({"stationary": SETTINGS}, {session.name: calibration}, {"stationary": Blind(SETTINGS, 20.0)})


def test_what_a_filter_gets_holds_no_truth():
    assert not [field.name for field in fields(Measured) if "true" in field.name or "scored" in field.name]


def test_quarters_part_the_rows_of_the_first_half_that_have_truth(session):
    early, later = session.first.quarter(0), session.first.quarter(1)
    assert max(early) < min(later) < max(later) < SECOND_FROM
    assert set(early) | set(later) == set(session.first.scored)
    assert len(session.first.true_mm) == len(session.first.measured.raw_mm) == SECOND_FROM


def test_scores_a_still_platform_by_what_the_first_half_taught(session):
    parameters = parameters_of(session)
    for anew in (False, True):
        for smoothed in (False, True):
            positions = held_out.estimates([session.measured], parameters, smoothed=smoothed, anew=anew)
            error = second_half_errors_mm([session], positions)
            assert len(error) == len(session.second.rows)
            assert np.median(np.linalg.norm(error, axis=1)) < 4.0
    raw = second_half_errors_mm([session], {session.name: session.measured.raw_mm})
    assert np.median(np.linalg.norm(raw, axis=1)) > 30.0


def test_started_anew_it_knows_nothing_of_the_first_half(session):
    other = replace(session.measured, raw_mm=session.measured.raw_mm.copy())
    other.raw_mm[:SECOND_FROM] += 300.0
    parameters = parameters_of(session)
    found = [
        held_out.estimates([each], parameters, smoothed=True, anew=True)[each.name]
        for each in (session.measured, other)
    ]
    np.testing.assert_array_equal(found[0], found[1])
    assert np.isnan(found[0][:SECOND_FROM]).all()


@pytest.mark.parametrize("row", [SECOND_FROM + 1, 300])
@pytest.mark.parametrize("anew", [False, True])
def test_a_causal_estimate_knows_no_later_fix(session, row, anew):
    later = replace(
        session.measured,
        **{
            name: np.vstack([getattr(session.measured, name)[:row], getattr(session.measured, name)[row:] + 50.0])
            for name in ("raw_mm", "attitude_deg", "displacement_mm")
        },
    )
    parameters = parameters_of(session)
    for estimates in (held_out.estimates, held_out.blind_estimates):
        found = [
            estimates([each], parameters, smoothed=False, anew=anew)[session.name] for each in (session.measured, later)
        ]
        np.testing.assert_array_equal(found[0][:row], found[1][:row])
        assert not np.array_equal(found[0][row:], found[1][row:])


def test_the_file_gives_back_the_parameters(session):
    parameters = parameters_of(session)
    assert held_out.as_json(held_out.from_json(held_out.as_json(parameters))) == held_out.as_json(parameters)


def test_the_baseline_takes_its_bias_from_the_first_half_only(session):
    found = held_out.baselines([session.measured], {session.name: session.first})
    left = found["logged iSBL-SF less session bias"][session.name][session.first.scored]
    np.testing.assert_allclose((left - session.first.true_mm[session.first.scored]).mean(axis=0), 0.0, atol=1e-9)
