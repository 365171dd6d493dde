"""The cases I1... of `bluerov-slam isbl evaluate`: which there are, the jobs they need, and the rows they give.

A case lives in a module of its own that ends with `CASES = (AcousticCase(...), ...)`; naming the module below is all
that it takes. Simulated cells are drawn in blocks of DRAWS_PER_SEED, each block with its own seed, so that what comes
out does not depend on how many processes share the work.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.statistics import Interval, bootstrap, root_mean_square

MODULES = ("acoustic_timing", "acoustic_position", "acoustic_echo", "acoustic_solving", "acoustic_message")
"""Modules of this package, in the order of the table."""

DRAWS_PER_SEED = 50

ONE_SIDED = 0.95
"""A share that must not be above a limit is judged by this upper limit."""


@dataclass(frozen=True, slots=True)
class AcousticJob:
    """One block of draws of one cell; cells of real logs have one job of 0 draws."""

    case: str
    cell: str
    seed: int
    draws: int

    def __str__(self) -> str:
        return f"{self.case} {self.cell} seed {self.seed}"


@dataclass(frozen=True)
class AcousticCase:
    """A group of figures.

    Attributes:
        cells: What is run on its own; each cell's draws are the asked number times its factor in `more`.
        run: Gives what one job found, to be sent between processes. Its second argument holds the contents by name
            of the files in the folder `material` of the recordings; empty if no material is asked for.
        rows: Makes rows of what each cell's jobs found, in the order of their seeds.
        simulated: Whether draws are made at all.
    """

    id: str
    title: str
    cells: tuple[str, ...]
    run: Callable[[AcousticJob, Mapping[str, bytes]], Any]
    rows: Callable[[Mapping[str, Sequence[Any]]], list[Row]]
    simulated: bool = True
    material: str = ""
    more: Mapping[str, int] = field(default_factory=dict)


def all_cases() -> dict[str, AcousticCase]:
    """By id, in the order of the table."""
    found: dict[str, AcousticCase] = {}
    for name in MODULES:
        for case in importlib.import_module(f"bluerov_slam.evaluation.{name}").CASES:
            found[case.id] = case
    return found


def jobs_for(cases: Sequence[AcousticCase], draws: int, seed_base: int) -> list[AcousticJob]:
    """All jobs of some cases."""
    jobs: list[AcousticJob] = []
    for case in cases:
        for cell in case.cells:
            if not case.simulated:
                jobs.append(AcousticJob(case.id, cell, seed_base, 0))
                continue
            left = draws * case.more.get(cell, 1)
            for block in range(-(-left // DRAWS_PER_SEED)):
                jobs.append(AcousticJob(case.id, cell, seed_base + block, min(DRAWS_PER_SEED, left)))
                left -= DRAWS_PER_SEED
    return jobs


def table(cases: Sequence[AcousticCase], found: Sequence[tuple[AcousticJob, Any]]) -> list[Row]:
    """Rows of all cases; one without a single result has none."""
    rows: list[Row] = []
    for case in cases:
        own = sorted((each for each in found if each[0].case == case.id), key=lambda each: each[0].seed)
        cells = {cell: [outcome for job, outcome in own if job.cell == cell] for cell in case.cells}
        if own:
            rows += case.rows(cells)
    return rows


def skipped_row(case: AcousticCase, reason: str) -> Row:
    """In place of a case's rows where it cannot be run: no value, nothing judged."""
    nothing = float("nan")
    return Row(case.id, f"{case.title}: skipped, {reason}", Interval(nothing, nothing, nothing), "")


@dataclass(frozen=True, slots=True)
class JudgedRow(Row):
    """A row whose 95 % limit on the bad side is judged, not its value."""

    @property
    def met(self) -> bool | None:
        """Whether even the limit is what it must be."""
        if self.must is None:
            return None
        high = self.must.high is None or self.must.met_by(self.interval.high)
        low = self.must.low is None or self.must.met_by(self.interval.low)
        return high and low


def rms_row(
    place: str,
    name: str,
    errors: NDArray[np.float64],
    unit: str,
    must: float | None = None,
    aim: float | None = None,
    bound: float | None = None,
) -> JudgedRow:
    """Root mean square of errors (draws,) or (draws, k), draws being independent; `bound`: the least possible."""
    per_draw = np.sqrt(np.mean(np.square(errors.reshape(len(errors), -1)), axis=1))
    interval = bootstrap(per_draw, root_mean_square)
    ratio = None if bound is None else interval.value / bound
    return JudgedRow(place, name, interval, unit, _at_most(must), _at_most(aim), ratio)


def share_row(
    place: str,
    name: str,
    happened: NDArray[np.bool_],
    must_percent: float | None = None,
    aim_percent: float | None = None,
) -> JudgedRow:
    """Share of draws in which something happened, per cent, with exact (Clopper-Pearson) one-sided limits."""
    count, total = int(np.sum(happened)), len(happened)
    low, high = (100.0 * limit for limit in share_limits(count, total))
    interval = Interval(100.0 * count / total, low, high)
    return JudgedRow(place, name, interval, "%", _at_most(must_percent), _at_most(aim_percent))


def ratio_row(place: str, name: str, ratio: Interval, must: float) -> JudgedRow:
    """Something over its bound."""
    return JudgedRow(place, name, ratio, "1", _at_most(must), None, ratio.value)


def share_limits(count: int, total: int) -> tuple[float, float]:
    """Lower and upper one-sided 95 % limits of a probability of which `count` of `total` were seen.

    Source: Clopper and Pearson (1934), doi:10.1093/biomet/26.4.404. Check: 0 of 1000 -> 0.002991.
    """
    return _limit(count, total, upper=False), _limit(count, total, upper=True)


def _limit(count: int, total: int, upper: bool) -> float:
    if count == (total if upper else 0):
        return 1.0 if upper else 0.0
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        # Upper: P(at most count) falls to 5 % there; lower: P(at least count) rises to 5 %.
        at_most = _binomial_at_most(count if upper else count - 1, total, middle)
        above = at_most < 1.0 - ONE_SIDED if upper else 1.0 - at_most > 1.0 - ONE_SIDED
        low, high = (low, middle) if above else (middle, high)
    return 0.5 * (low + high)


def _binomial_at_most(count: int, total: int, probability: float) -> float:
    if probability <= 0.0:
        return 1.0
    if probability >= 1.0:
        return float(count >= total)
    numbers = np.arange(count + 1)
    steps = np.log(np.maximum(total - numbers[:-1], 1)) - np.log(numbers[1:])
    choices = np.concatenate(([0.0], np.cumsum(steps)))
    terms = choices + numbers * np.log(probability) + (total - numbers) * np.log1p(-probability)
    return float(min(1.0, np.sum(np.exp(terms))))


def _at_most(limit: float | None) -> Target | None:
    return None if limit is None else Target(high=limit)
