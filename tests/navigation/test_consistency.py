"""Windows of NIS and bands of chi-square."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.navigation.consistency import NisStatistics, NisWindow, band, normalised_squared_error, share_inside
from bluerov_slam.navigation.ekf import UpdateResult


def result(nis: float, dof: int = 2, sensor: str = "gps") -> UpdateResult:
    return UpdateResult(sensor, 0.0, np.zeros(dof), np.eye(dof), nis, dof, 1.0, True)


def test_the_band_of_six_degrees_of_freedom():
    assert band(6) == pytest.approx((1.237, 14.449), abs=1e-3)


def test_normalised_squared_error():
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    error = np.array([1.0, -2.0])
    assert normalised_squared_error(error, covariance) == pytest.approx(error @ np.linalg.inv(covariance) @ error)
    assert math.isnan(normalised_squared_error(error, np.diag([1.0, -1.0])))


def test_share_inside():
    random = np.random.default_rng(1)
    values = random.chisquare(6, 20_000)
    assert share_inside(values, 6) == pytest.approx(0.95, abs=0.005)
    assert share_inside(4.0 * values, 6) < 0.4
    assert math.isnan(share_inside([], 6))
    assert share_inside([math.nan, 6.0], 6) == 0.5


def test_a_window_of_right_errors_is_in_its_band_and_one_of_wrong_errors_is_not():
    random = np.random.default_rng(4)
    right, small, large = NisWindow(), NisWindow(), NisWindow()
    for nis in random.chisquare(2, 400):
        right.add(result(nis))
        small.add(result(nis / 2.0))
        large.add(result(nis * 2.0))
    low, high = right.band
    assert 0.7 < low < right.ratio < high < 1.4
    assert small.ratio < low
    assert large.ratio > high
    assert right.count == 200


def test_a_window_forgets():
    window = NisWindow(3)
    for nis in (100.0, 1.0, 2.0, 3.0):
        window.add(result(nis, 1))
    assert window.ratio == pytest.approx(2.0)
    assert window.count == 3


def test_values_of_different_size_count_by_their_degrees_of_freedom():
    window = NisWindow()
    window.add(result(3.0, 3))
    window.add(result(5.0, 1))
    assert window.ratio == pytest.approx(2.0)
    assert window.band == pytest.approx((band(4)[0] / 4, band(4)[1] / 4))


def test_the_median_does_not_mind_an_outlier():
    window = NisWindow()
    for nis in np.random.default_rng(3).chisquare(2, 100):
        window.add(result(nis))
    for _ in range(5):
        window.add(result(5000.0))
    assert window.ratio > 50.0
    assert window.median_ratio == pytest.approx(1.0, abs=0.3)


def test_an_empty_window_says_nothing():
    window = NisWindow()
    assert (window.ratio, window.band, window.median_ratio, window.count) == (None, None, None, 0)
    window.add(result(1.0))
    window.clear()
    assert window.ratio is None


def test_one_window_per_sensor():
    statistics = NisStatistics()
    statistics.add(result(1.0, 1, "depth"))
    statistics.add(result(4.0, 2, "gps"))
    statistics.add(result(3.0, 1, "depth"))
    assert statistics.windows["depth"].ratio == pytest.approx(2.0)
    assert statistics.windows["gps"].count == 1
    assert list(statistics.windows) == ["depth", "gps"]
