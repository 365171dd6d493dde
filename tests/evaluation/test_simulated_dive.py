"""Short dives through the whole chain, bytes included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.evaluation.baselines import baselines
from bluerov_slam.evaluation.dive_bounds import dive_bound
from bluerov_slam.evaluation.navigation_cases import Job, run_dive
from bluerov_slam.evaluation.simulated_dive import Dive, figures, navigate, simulate
from bluerov_slam.evaluation.trajectory import ate_m
from bluerov_slam.records import VehicleMotionDelta
from bluerov_slam.simulation.dive_plan import DivePlan

SHORT = DivePlan("short", conditions="calm", afloat_first_s=60.0, legs=2, leg_m=30.0, spacing_m=10.0, dvl=True)


@pytest.fixture(scope="module")
def dive() -> Dive:
    return simulate(SHORT, seed=7, board=None)


def test_the_navigator_follows_a_short_dive(dive: Dive) -> None:
    run = navigate(dive)
    found = figures(dive, run.causal, run.origin_deg)
    assert found.epochs > 0.95 * (dive.truth.end_s - dive.truth.track_start_s)
    assert found.ate_m < 5.0
    assert found.heading_rms_rad < np.radians(6.0)
    assert set(run.nis) >= {"compass", "depth", "gps", "thrust", "dvl"}


def test_what_is_left_out_is_not_heard(dive: Dive) -> None:
    assert "dvl" not in navigate(dive, without=(VehicleMotionDelta,)).nis


def test_smoothing_gives_every_second_again_and_no_worse(dive: Dive) -> None:
    run = navigate(dive, smooth=True)
    assert run.smoothed is not None
    causal, smoothed = (figures(dive, each, run.origin_deg) for each in (run.causal, run.smoothed))
    assert abs(smoothed.epochs - causal.epochs) <= 2
    assert smoothed.ate_m < causal.ate_m + 0.5


def test_the_same_seed_is_the_same_dive(dive: Dive) -> None:
    again = navigate(simulate(SHORT, seed=7, board=None)).causal
    np.testing.assert_array_equal(again.position_ned_m, navigate(dive).causal.position_ned_m)


def test_baselines_start_at_the_first_fix_and_the_rubber_band_follows_the_fixes(dive: Dive) -> None:
    paths = baselines(dive.records, dive.truth.origin_deg)
    under_gps = np.arange(dive.truth.track_start_s, 60.0)
    truth = dive.truth.track(under_gps).position_ned_m[:, :2]
    assert ate_m(paths.at(paths.rubber_band_ne_m, under_gps), truth) < 5.0
    np.testing.assert_array_equal(paths.constant_ne_m[0], paths.thruster_ne_m[0])


def test_the_bound_knows_the_instruments(dive: Dive) -> None:
    pytest.importorskip("scipy", reason="SciPy is not installed: pip install 'bluerov-slam[survey]'")
    fixes = dive.gps_times_s()
    with_dvl = dive_bound(SHORT, dive.truth, fixes)
    without = dive_bound(replace(SHORT, dvl=False), dive.truth, fixes)
    assert with_dvl.end_m < without.end_m
    assert dive_bound(replace(SHORT, dvl=False), dive.truth, fixes[:5]).end_m > without.end_m
    assert 0.5 < with_dvl.ate_m < 3.0  # one GPS error over a minute and a half


@pytest.mark.long
@pytest.mark.parametrize("kind", ["N2", "N34"])
def test_whole_dives_stay_inside_their_targets(kind: str) -> None:
    """Four seeds: not the verdict of thirty, but no seed may be lost."""
    outcomes = [outcome for seed in range(4) for outcome in run_dive(Job(kind, "hard", seed), None)]
    for outcome in outcomes:
        limit = {"N2": 20.0, "N3": 3.0, "N4": 1.0}[outcome.case]
        assert outcome.judged.end_percent < limit, (outcome.case, outcome.seed)
        assert outcome.judged.position_nees < 20.0, (outcome.case, outcome.seed)
