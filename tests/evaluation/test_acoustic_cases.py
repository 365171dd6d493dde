"""The registry of acoustic cases: blocks of seeds, exact limits, rows judged by them, and every case run small."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.evaluation import acoustic_cases as cases
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.statistics import Interval

OURS = ("I1", "I2", "I3", "I4", "I5")


def test_cases_have_ids_of_their_own_and_cells() -> None:
    known = cases.all_cases()
    assert set(OURS) <= set(known)
    assert all(case.cells and case.id == name for name, case in known.items())
    listed = [case.id for name in cases.MODULES for case in _module(name)]
    assert len(listed) == len(set(listed))


def _module(name: str) -> tuple[AcousticCase, ...]:
    import importlib

    found: tuple[AcousticCase, ...] = importlib.import_module(f"bluerov_slam.evaluation.{name}").CASES
    return found


def test_draws_come_in_blocks_each_with_its_seed() -> None:
    known = cases.all_cases()
    jobs = cases.jobs_for([known["I2"]], 120, 1000)
    first = [job for job in jobs if job.cell == known["I2"].cells[0]]
    assert [(job.seed, job.draws) for job in first] == [(1000, 50), (1001, 50), (1002, 20)]
    more = [job for job in cases.jobs_for([known["I1"]], 50, 1000) if job.cell == "5 slips"]
    assert sum(job.draws for job in more) == 200


def test_limits_of_shares_are_exact() -> None:
    assert cases.share_limits(0, 1000)[1] == pytest.approx(0.002991, abs=1e-6)
    assert cases.share_limits(0, 3000)[1] < 0.001
    low, high = cases.share_limits(5, 10)  # tables: 0.2224 and 0.7776
    assert low == pytest.approx(0.2224, abs=1e-4)
    assert high == pytest.approx(0.7776, abs=1e-4)
    assert cases.share_limits(10, 10)[1] == 1.0


def test_a_row_is_judged_by_its_limit_not_by_its_value() -> None:
    few = cases.share_row("x", "none of few", np.zeros(100, dtype=bool), 1.0)
    assert few.interval.value == 0.0
    assert few.met is False
    assert cases.share_row("x", "none of many", np.zeros(1000, dtype=bool), 1.0).met is True
    wide = cases.JudgedRow("x", "x", Interval(0.9, 0.8, 1.2), "1", cases.Target(high=1.0))
    assert wide.met is False
    errors = np.random.default_rng(0).standard_normal((4000, 2))
    row = cases.rms_row("x", "x", errors, "mm", 1.05, bound=1.0)
    assert row.met is True
    assert row.bound_ratio == pytest.approx(1.0, abs=0.03)
    assert row.as_json()["must"] == "<= 1.05"


def test_a_case_without_results_has_no_rows() -> None:
    assert cases.table([cases.all_cases()["I2"]], []) == []


@pytest.mark.parametrize("name", OURS)
def test_every_case_runs_and_gives_its_rows(name: str) -> None:
    case = cases.all_cases()[name]
    jobs = [AcousticJob(name, cell, 7, 3) for cell in case.cells]
    rows = cases.table([case], [(job, case.run(job, {})) for job in jobs])
    assert rows
    assert all(isinstance(row, Row) and row.id.startswith(name) for row in rows)
    assert len({row.id for row in rows}) == len(rows)
    assert any(row.must is not None for row in rows)
    assert all(np.isfinite(row.interval.value) for row in rows)


def test_the_same_seed_gives_the_same_figures() -> None:
    case = cases.all_cases()["I5"]
    job = AcousticJob("I5", case.cells[0], 3, 2)
    first, second = case.run(job, {}), case.run(job, {})
    assert first.errors_m["joint"] == pytest.approx(second.errors_m["joint"], abs=0.0)
