"""Intervals, bands and limits against textbook values and sampled errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.evaluation.statistics import (
    bootstrap,
    lowest_credible_ratio,
    mean_band,
    nees,
    root_mean_square,
    share_in_band,
    total_dof,
)


def test_bootstrap_interval_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    intervals = [bootstrap(rng.normal(3.0, 1.0, 30).tolist()) for _ in range(300)]
    covered = np.mean([each.low <= 3.0 <= each.high for each in intervals])
    assert 0.90 <= covered <= 0.99


def test_bootstrap_takes_other_statistics() -> None:
    got = bootstrap([3.0, 4.0], root_mean_square)
    assert got.value == pytest.approx(math.sqrt(12.5))
    assert (got.low, got.high) == (3.0, 4.0)


def test_nees_of_honest_errors_fills_the_band() -> None:
    rng = np.random.default_rng(2)
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    errors = rng.multivariate_normal((0.0, 0.0), covariance, 20_000)
    squared = nees(errors, np.broadcast_to(covariance, (20_000, 2, 2)))
    assert squared.mean() == pytest.approx(2.0, rel=0.03)
    assert share_in_band(squared, 2) == pytest.approx(0.95, abs=0.006)
    assert share_in_band(nees(2.0 * errors, np.broadcast_to(covariance, (20_000, 2, 2))), 2) < 0.70
    assert share_in_band(nees(0.2 * errors, np.broadcast_to(covariance, (20_000, 2, 2))), 2) < 0.75


def test_band_of_a_mean_of_thirty_runs() -> None:
    # Tables: chi-square with 60 degrees of freedom lies between 40.482 and 83.298 in 95 % of cases.
    assert mean_band(2, 30) == pytest.approx((40.482 / 60, 83.298 / 60), rel=1e-4)


def test_lowest_credible_ratio_of_thirty_circles() -> None:
    assert lowest_credible_ratio(60.0) == pytest.approx(math.sqrt(40.482 / 60), rel=1e-4)


def test_degrees_of_freedom_of_unequal_squares() -> None:
    assert total_dof([5.0] * 30, [2.0] * 30) == pytest.approx(60.0)
    assert total_dof([100.0] + [0.001] * 29, [2.0] * 30) == pytest.approx(2.0, rel=1e-2)
