import json
from dataclasses import replace

import numpy as np
import pytest

import real_data
from bluerov_slam.acoustics.thesis_log import ThesisLog, ThesisRows, error_mm, joined
from bluerov_slam.evaluation import thesis_table
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs


def log_of(errors_mm, name="test_x2645_y0_z-682_s", **columns):
    """A log whose three estimates are all off by `errors_mm` (n, 3)."""
    count = len(errors_mm)
    zeros = np.zeros((count, 3))
    rows = ThesisRows(
        line=np.arange(count),
        whole=np.ones(count, dtype=bool),
        after_discard=np.zeros(count, dtype=bool),
        segment=np.ones(count, dtype=int),
        axis=np.full(count, "A"),
        setpoint=np.zeros(count),
        acoustic_mm=errors_mm,
        fused_mm=errors_mm,
        raw_mm=errors_mm,
        true_mm=zeros,
        attitude_deg=zeros,
    )
    return ThesisLog(name, 2, "stationary", (2645.0, 0.0, -682.0), replace(rows, **columns))


def test_three_passes_peel_outliers_that_hide_behind_each_other():
    errors = np.zeros((400, 3))
    errors[:, 1] = np.tile([1.0, -1.0], 200)
    errors[0, 1], errors[1, 1], errors[2, 1] = 1e6, 1e3, 8.0
    rows = log_of(errors).rows
    assert [len(thesis_table.without_outliers(rows, passes)) for passes in range(5)] == [400, 399, 398, 397, 397]


def test_rows_without_truth_and_cut_rows_are_not_scored():
    log = log_of(np.zeros((4, 3)), whole=np.array([True, False, True, True]))
    log = replace(log, rows=replace(log.rows, after_discard=np.array([False, False, True, False])))
    assert thesis_table.scored_rows(log).line.tolist() == [0, 3]
    still = log_of(np.zeros((4, 3)), name="test_x1426_y0_z-694_s")
    assert len(thesis_table.scored_rows(still)) == 0


def test_a_summary_is_of_lengths_not_of_signed_errors():
    found = thesis_table.summary(np.array([[3.0, 4.0], [-3.0, -4.0], [0.0, 10.0]]))
    assert (found.mean_mm, found.median_mm) == (20.0 / 3.0, 5.0)
    assert found.rmse_mm == pytest.approx(np.sqrt(50.0))


@pytest.fixture(scope="module")
def real_logs():
    return read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs


def test_all_156_published_cells_come_out_of_the_raw_logs(real_logs):
    published = json.loads(real_data.recording("isbl_thesis", "published_stats.json").read_text())
    cells, largest = thesis_table.largest_difference_mm(thesis_table.published_table(real_logs), published)
    assert cells == 156
    assert largest <= 1e-9


def test_the_counts_of_the_text_are_the_recipe_with_five_passes(real_logs):
    told = json.loads(real_data.recording("isbl_thesis", "published_stats.json").read_text())["text_counts"]
    counts = thesis_table.counts_by_motion(real_logs, thesis_table.TEXT_PASSES)
    assert {name: counts[name] for name in ("stationary", "rapid", "gradual")} | {"total": counts["all"]} == {
        name: told[name] for name in ("stationary", "rapid", "gradual", "total")
    }


def test_without_removal_by_truth_the_errors_are_larger(real_logs):
    rows = joined([thesis_table.scored_rows(log) for log in real_logs])
    found = thesis_table.summary(error_mm(rows.fused_mm, rows))
    assert found.count == 22401
    assert (round(found.rmse_mm, 1), round(found.median_mm, 1), round(found.p95_mm)) == (80.7, 48.9, 165)
