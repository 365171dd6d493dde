"""The published table of the thesis (figures 6.18, 6.19) from its raw logs, and what the rows say without its recipe.

Recipe, found from the published numbers: lines that lost their first characters and lines after a DISCARD are dropped;
the stationary log of test 1 is left out; in each log, three times, every row is dropped in which any of the nine
differences (three estimates times x, y, z) lies more than four standard deviations from its mean; then the logs are
pooled, mean and population standard deviation. Two things about it are not good practice and are therefore stated
beside it, never instead: outliers are found with the truth, and mean and standard deviation of signed errors are no
position error.

The counts in the thesis's text (21,572) are the same recipe with five passes instead of three.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.acoustics.thesis_log import TESTS_MM, ThesisLog, ThesisRows, error_mm, joined

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bluerov_slam.acoustics.thesis_log import Floats

PASSES, TEXT_PASSES = 3, 5
_OUTLIER_SIGMAS = 4.0

ESTIMATES = ("acoustic", "fused", "raw")
ACTUAL_LABELS = {
    "acoustic": "filter on acoustic fixes (iSBL)",
    "fused": "filter on acoustic fixes and dead reckoning (iSBL-SF)",
    "raw": "raw acoustic fixes",
}
PUBLISHED_LABELS = {
    "acoustic": "iSBL-SF Kalman filter",
    "fused": "iSBL Kalman filter",
    "raw": "iSBL raw position estimates",
}
_PUBLISHED_KEYS = dict(zip(ESTIMATES, ("triplet_1", "triplet_2", "triplet_3"), strict=True))
_GROUPS = ("stationary", "rapid", "gradual", "all")


@dataclass(frozen=True, slots=True)
class Cell:
    """Mean and population standard deviation of estimate less truth, mm; y and z."""

    y_mean: float
    y_std: float
    z_mean: float
    z_std: float


@dataclass(frozen=True, slots=True)
class TableRow:
    """A line of the published table: a test ("1" to "9"), a motion or "all"."""

    group: str
    count: int
    cells: dict[str, Cell]


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Errors across the line of sight (y and z together), mm."""

    count: int
    rmse_mm: float
    mean_mm: float
    median_mm: float
    p95_mm: float


def scored_rows(log: ThesisLog) -> ThesisRows:
    """Rows that can be held against the truth: none of a log without truth, none after a DISCARD, no cut line."""
    keep = log.rows.whole & ~log.rows.after_discard & log.truth_valid
    return log.rows.where(keep)


def without_outliers(rows: ThesisRows, passes: int = PASSES) -> ThesisRows:
    """The published removal, which knows the truth."""
    for _ in range(passes):
        differences = np.hstack([estimate(rows, name) - rows.true_mm for name in ESTIMATES])
        deviation = np.abs(differences - differences.mean(axis=0))
        rows = rows.where(~np.any(deviation > _OUTLIER_SIGMAS * differences.std(axis=0), axis=1))
    return rows


def published_table(logs: Sequence[ThesisLog], passes: int = PASSES) -> list[TableRow]:
    """The thirteen lines: tests 1 to 9, stationary, rapid, gradual, all."""
    kept = {log.name: without_outliers(scored_rows(log), passes) for log in logs if log.truth_valid}
    groups = [(str(test), [log for log in logs if log.test == test]) for test in range(1, len(TESTS_MM) + 1)]
    groups += [(group, [log for log in logs if group in (log.motion, "all")]) for group in _GROUPS]
    return [
        _row(name, joined([kept[log.name] for log in members if log.name in kept]))
        for name, members in groups
        if any(log.name in kept for log in members)
    ]


def largest_difference_mm(table: Sequence[TableRow], published: Mapping[str, Any]) -> tuple[int, float]:
    """(cells compared, largest difference) to the published numbers (`published_stats.json`)."""
    lines = {str(line["test"]): line for line in published["tests"]}
    lines |= {name.lower(): line for name, line in published["groups"].items()}
    differences = [
        abs(getattr(row.cells[estimate], key) - lines[row.group][_PUBLISHED_KEYS[estimate]][key])
        for row in table
        for estimate in ESTIMATES
        for key in ("y_mean", "y_std", "z_mean", "z_std")
    ]
    counts = [abs(row.count - lines[row.group]["n"]) for row in table]
    return len(differences), max(max(differences), float(max(counts)))


def estimate(rows: ThesisRows, name: str) -> Floats:
    """One of the three logged positions by its name in `ESTIMATES`."""
    found: Floats = {"acoustic": rows.acoustic_mm, "fused": rows.fused_mm, "raw": rows.raw_mm}[name]
    return found


def summary(errors_mm: Floats) -> ErrorSummary:
    """Of errors (n, 2)."""
    length = np.hypot(errors_mm[:, 0], errors_mm[:, 1])
    return ErrorSummary(
        count=len(length),
        rmse_mm=float(np.sqrt(np.mean(length**2))),
        mean_mm=float(np.mean(length)),
        median_mm=float(np.median(length)),
        p95_mm=float(np.quantile(length, 0.95)),
    )


def counts_by_motion(logs: Sequence[ThesisLog], passes: int) -> Counter[str]:
    """Rows that the recipe keeps, for the counts of the thesis's text."""
    return Counter({row.group: row.count for row in published_table(logs, passes) if row.group in _GROUPS})


def _row(group: str, rows: ThesisRows) -> TableRow:
    cells = {}
    for name in ESTIMATES:
        error = error_mm(estimate(rows, name), rows)
        (y_mean, z_mean), (y_std, z_std) = error.mean(axis=0), error.std(axis=0)
        cells[name] = Cell(float(y_mean), float(y_std), float(z_mean), float(z_std))
    return TableRow(group, len(rows), cells)
