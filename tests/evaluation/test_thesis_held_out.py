"""That second halves are held out, on a made-up session; the real scores are in tests/survey/test_thesis_study.py."""

from dataclasses import replace

import numpy as np
import pytest

from acoustics.slip_samples import CELLS_MM, RANGE_MM, cell_probability, slipped_fixes
from bluerov_slam.acoustics.slip_lattice import LatticeSettings
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.evaluation.thesis_held_out import Blind, Parameters, Session

SETTINGS = LatticeSettings(0.01, 0.01)


@pytest.fixture
def session():
    rng = np.random.default_rng(3)
    truth = np.tile([0.0, -648.0], (400, 1))
    attitude = rng.normal(0.0, 0.5, (400, 3))
    bias = np.array([40.0, -12.0]) + np.outer(attitude[:, 2], [-30.0, 0.0])
    raw = slipped_fixes(truth, cell_probability([0.5, 0.2, 0.2, 0.1]), rng) + bias
    scored = np.ones(400, dtype=bool)
    scored[[0, 50, 260]] = False
    return Session(
        "made up",
        "stationary",
        raw,
        truth,
        raw,
        attitude,
        np.full(400, 3.0),
        np.zeros((400, 2)),
        scored,
        RANGE_MM,
        CELLS_MM,
    )


def parameters_of(session):
    calibration = held_out.rounded(held_out._calibrated(session, session.half(0), 2))
    return Parameters({"stationary": SETTINGS}, {session.name: calibration}, {"stationary": Blind(SETTINGS, 20.0)})


def test_halves_and_quarters_part_the_rows_that_have_truth(session):
    first, second = session.half(0), session.half(1)
    assert not set(first) & set(second)
    assert set(first) | set(second) == set(np.flatnonzero(session.scored))
    assert max(first) < min(second)
    assert set(session.quarter(0)) | set(session.quarter(1)) == set(first)


def test_nothing_of_the_second_half_reaches_the_parameters(session):
    spoilt = replace(session, true_mm=session.true_mm.copy(), raw_mm=session.raw_mm.copy())
    later = slice(session.half(1)[0], None)
    spoilt.true_mm[later] += 500.0
    spoilt.raw_mm[later] -= 77.0
    assert held_out.as_json(parameters_of(spoilt)) == held_out.as_json(parameters_of(session))
    tuned = [held_out._blindly_tuned([each], "stationary", lambda _: None) for each in (session, spoilt)]
    assert tuned[0] == tuned[1]


def test_scores_a_still_platform_by_what_the_first_half_taught(session):
    parameters = parameters_of(session)
    for anew in (False, True):
        for smoothed in (False, True):
            positions = held_out.estimates([session], parameters, smoothed=smoothed, anew=anew)
            error = held_out.second_half_errors_mm([session], positions)
            assert len(error) == len(session.half(1))
            assert np.median(np.linalg.norm(error, axis=1)) < 4.0
    raw = held_out.second_half_errors_mm([session], {session.name: session.raw_mm})
    assert np.median(np.linalg.norm(raw, axis=1)) > 30.0


def test_started_anew_it_knows_nothing_of_the_first_half(session):
    other = replace(session, raw_mm=session.raw_mm.copy())
    other.raw_mm[: session.half(1)[0]] += 300.0
    parameters = parameters_of(session)
    found = [held_out.estimates([each], parameters, smoothed=True, anew=True)[each.name] for each in (session, other)]
    np.testing.assert_array_equal(found[0], found[1])
    assert np.isnan(found[0][: session.half(1)[0]]).all()


def test_the_file_gives_back_the_parameters(session):
    parameters = parameters_of(session)
    assert held_out.as_json(held_out.from_json(held_out.as_json(parameters))) == held_out.as_json(parameters)


def test_the_baseline_takes_its_bias_from_the_first_half_only(session):
    found = held_out.baselines([session])["logged iSBL-SF less session bias"][session.name]
    np.testing.assert_allclose((found - session.true_mm)[session.half(0)].mean(axis=0), 0.0, atol=1e-9)
