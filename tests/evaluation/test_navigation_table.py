"""The table says what the outcomes say: medians, ratios, verdicts."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from bluerov_slam.evaluation.held_out_fixes import GivenFixes, HeldOut
from bluerov_slam.evaluation.navigation_cases import (
    DiveOutcome,
    HeadingOutcome,
    HeldOutOutcome,
    Job,
    SnapirOutcome,
    jobs_for,
)
from bluerov_slam.evaluation.navigation_run import SensorNis
from bluerov_slam.evaluation.navigation_table import Row, Target, table
from bluerov_slam.evaluation.simulated_dive import PathFigures
from bluerov_slam.evaluation.snapir_case import SnapirFigures

PATH = PathFigures(20.0, 60.0, 6.0, 12.0, (1.0, 2.0, 3.0), 0.02, 0.95, 0.93, 2.0, 6.6, 1961)
DIVE = DiveOutcome(
    "N2",
    "hard",
    0,
    PATH,
    PATH,
    30.0,
    2.0,
    66.0,
    2.0,
    {"constant speed": (300.0, 500.0), "thrusters": (200.0, 400.0), "rubber band": (25.0, 350.0)},
    {"gps": SensorNis(400, 3, 800.0, 800), "compass": SensorNis(9000, 0, 900.0, 9000)},
    0,
    {10.0: 3.0, 60.0: 2.4},
)


def rows_of(cases: list[str], outcomes: list[object]) -> dict[str, Row]:
    return {row.id: row for row in table(cases, outcomes)}  # type: ignore[arg-type]


def with_end(metres: float, seed: int) -> DiveOutcome:
    return replace(DIVE, seed=seed, judged=replace(PATH, end_m=metres, end_percent=metres / 10.0))


def test_dead_reckoning_is_judged_by_the_median_and_compared_with_its_bound() -> None:
    rows = rows_of(["N2"], [with_end(metres, seed) for seed, metres in enumerate((30.0, 60.0, 150.0))])
    assert rows["N2.hard"].interval.value == pytest.approx(6.0)
    assert rows["N2.hard"].met is True
    ratio = math.sqrt((30.0**2 + 60.0**2 + 150.0**2) / 3.0) / 66.0
    assert rows["N2.hard"].bound_ratio == pytest.approx(ratio)
    assert rows["N2.hard.ratio"].interval.value == pytest.approx(ratio)
    assert rows["N2.hard.ratio"].met is True
    assert rows["N2.hard.ate"].met is None


def test_an_error_far_below_the_bound_is_a_bug() -> None:
    rows = rows_of(["N2"], [with_end(20.0, seed) for seed in range(30)])
    assert rows["N2.hard"].met is True
    assert rows["N2.hard.ratio"].met is False
    assert rows_of(["N2"], [with_end(140.0, seed) for seed in range(30)])["N2.hard.ratio"].met is False


def test_the_rubber_band_has_to_be_beaten_on_each_dive() -> None:
    smoothed = replace(DIVE, case="N3")
    assert rows_of(["N3"], [smoothed])["N3.gain"].interval.value == pytest.approx(20.0)
    assert rows_of(["N3"], [smoothed])["N3.gain"].met is True
    worse = replace(smoothed, judged=replace(PATH, ate_m=24.0))
    assert rows_of(["N3"], [worse])["N3.gain"].met is False
    assert rows_of(["N3"], [worse])["N3"].met is False


def test_consistency_wants_the_band_filled_and_every_sensor_s_nis_right() -> None:
    few = replace(DIVE, case="N4", judged=replace(PATH, pose_in_band=0.79, position_nees=1.0, epochs=1961))
    odd = {"prior": SensorNis(9000, 0, 90.0, 9000), **DIVE.nis}
    rows = rows_of(["N6"], [replace(DIVE, nis=odd), few, replace(DIVE, conditions="still")])
    assert rows["N6"].interval.value == pytest.approx(86.0)
    assert rows["N6"].met is False
    assert rows["N6.mean"].interval.value == pytest.approx(1.1)
    assert rows["N6.position"].interval.value == pytest.approx(95.0)
    assert rows["N6.position"].met is True
    assert rows["N6.position.mean"].interval.value == pytest.approx(0.75)
    assert rows["N6.N2.hard"].interval.value == pytest.approx(93.0)
    assert rows["N6.N4.hard"].met is None, "told to find the cause; the verdict is on all of them"
    assert "N6.nis.prior" not in rows
    assert "N6.N2.still" not in rows
    assert rows["N6.nis.gps"].interval.value == pytest.approx(1.0)
    assert rows["N6.nis.gps"].met is True
    assert rows["N6.nis.compass"].met is False


def test_pure_inertial_needs_a_mean_inside_the_band() -> None:
    rows = rows_of(["N1"], [replace(DIVE, seed=seed) for seed in range(30)])
    assert rows["N1.10s"].met is True
    assert rows["N1.60s"].met is True
    confident = [replace(DIVE, seed=seed, inertial={10.0: 9.0, 60.0: 3.0}) for seed in range(30)]
    assert rows_of(["N1"], confident)["N1.10s"].met is False
    lost = [replace(DIVE, seed=seed, inertial={10.0: 3.0}) for seed in range(30)]
    assert rows_of(["N1"], lost)["N1.60s"].met is False


def test_heading_after_the_swing() -> None:
    rows = rows_of(["N5"], [HeadingOutcome(0, math.radians(1.5), math.radians(3.0))])
    assert rows["N5"].met is True
    assert rows["N5"].interval.value == pytest.approx(1.5)
    assert rows["N5.before"].interval.value == pytest.approx(3.0)


def test_errors_of_the_real_tracks_count_by_their_stated_sigma() -> None:
    found = SnapirFigures(0.4, 0.1, 0.7, 0.3, 0.01, 0.006, 0.02, 0.009)
    rows = rows_of(["N7"], [SnapirOutcome(1, 0, found)])
    assert rows["N7"].met is True
    assert rows["N7.heading"].met is True
    assert rows["N7.scale"].met is False


def held(ours_m: float, baseline_m: float, nis: float = 1.0, outlier: bool = False) -> HeldOut:
    return HeldOut(0, 3.0, ours_m, baseline_m, nis, outlier)


def test_predictions_count_by_their_rms_and_not_by_outliers() -> None:
    fixes = [held(1.0, 2.0), held(1.0, 2.0), held(4.0, 4.0), held(90.0, 1.0, outlier=True)]
    rows = rows_of(["N8"], [HeldOutOutcome("2022a", 10.0, fixes, GivenFixes(10, 9, 100, 2))])
    by_rms = 100.0 * (1.0 - math.sqrt(18.0 / 24.0))
    assert rows["N8.2022.10s"].interval.value == pytest.approx(by_rms)
    assert rows["N8.2022.10s"].met is False
    assert rows["N8.2022.10s.median_gain"].interval.value == pytest.approx(50.0)
    assert rows["N8.2022.10s.median_gain"].must is None
    assert rows["N8.2022.10s.median"].interval.value == pytest.approx(1.0)
    assert rows["N8.2022.outliers"].met is True
    assert rows["N8.2022.refused"].interval.value == pytest.approx(2.0)
    assert rows["N8.2022.10s.inside"].met is False  # all of them: the ellipse is too large


def test_a_log_without_any_prediction_is_a_failure_not_a_gap() -> None:
    rows = rows_of(["N8"], [HeldOutOutcome("2024", 5.0, [], GivenFixes(0, 0, 100, 100))])
    assert rows["N8.2024.5s"].met is False
    assert rows["N8.2024.5s"].as_json()["value"] is None


def test_json_has_the_agreed_keys_and_is_json() -> None:
    row = rows_of(["N2"], [DIVE])["N2.hard"].as_json()
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert {"id", "name", "value", "unit", "must", "aim", "bound_ratio", "met"} <= set(row)
    assert row["must"] == "<= 10"


def test_targets_read_as_they_are_judged() -> None:
    assert str(Target(low=30.0)) == ">= 30"
    assert str(Target(0.7, 1.4)) == "0.7..1.4"
    assert not Target(0.7, 1.4).met_by(1.5)
    assert not Target(high=1.0).met_by(math.nan)


def test_cases_share_their_dives() -> None:
    assert jobs_for(["N3", "N4"], [5]) == [Job("N34", "hard", 5)]
    assert jobs_for(["N1"], [5]) == [Job("N2", "hard", 5)]
    assert len(jobs_for(["N2"], range(4))) == 12
    assert len(jobs_for(["N6"], range(4))) == 12
    assert len(jobs_for(["N8"], [1])) == 9
    assert {job.part for job in jobs_for(["N7"], [1, 2, 3])} == {str(track) for track in range(1, 11)}
