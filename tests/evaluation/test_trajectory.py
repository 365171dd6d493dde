"""Errors of paths whose errors are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.evaluation.trajectory import (
    aligned_ate_m,
    ate_m,
    dead_reckoned,
    end_error_m,
    end_error_percent,
    path_length_m,
    relative_error_m,
    rubber_band,
)

SECONDS = np.arange(201.0)
LINE = np.column_stack((SECONDS, 0.0 * SECONDS))
NO_TURN = np.zeros(201)


def turned(path: np.ndarray, angle_rad: float) -> np.ndarray:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return path @ np.array([[cos, -sin], [sin, cos]]).T


def test_a_shifted_path_is_wrong_by_the_shift_until_it_is_aligned() -> None:
    shifted = LINE + np.array([3.0, 4.0])
    assert ate_m(shifted, LINE) == pytest.approx(5.0)
    assert end_error_m(shifted, LINE) == pytest.approx(5.0)
    assert end_error_percent(shifted, LINE) == pytest.approx(2.5)
    assert aligned_ate_m(shifted, LINE) == pytest.approx(0.0, abs=1e-9)


def test_alignment_takes_out_a_rotation_but_not_a_scale() -> None:
    bent = np.column_stack((SECONDS, 0.01 * SECONDS**1.5))
    assert aligned_ate_m(turned(bent, 1.2) + np.array([7.0, -2.0]), bent) == pytest.approx(0.0, abs=1e-9)
    assert aligned_ate_m(1.1 * LINE, LINE) == pytest.approx(ate_m(0.1 * (LINE - (100, 0)), 0.0 * LINE))


def test_relative_error_sees_the_scale_of_a_segment() -> None:
    for segment_m in (10.0, 50.0, 100.0):
        assert relative_error_m(1.02 * LINE, LINE, NO_TURN, segment_m) == pytest.approx(0.02 * segment_m)


def test_relative_error_does_not_charge_a_constant_heading_error_again() -> None:
    angle = math.radians(5.0)
    assert relative_error_m(turned(LINE, angle), LINE, NO_TURN + angle, 50.0) == pytest.approx(0.0, abs=1e-9)
    blind = relative_error_m(turned(LINE, angle), LINE, NO_TURN, 50.0)
    assert blind == pytest.approx(50.0 * 2.0 * math.sin(angle / 2.0))


def test_relative_error_of_a_path_shorter_than_the_segment_is_unknown() -> None:
    assert relative_error_m(LINE, LINE, NO_TURN, 500.0) is None


def test_rubber_band_removes_a_drift_that_is_linear_in_time() -> None:
    drifting = LINE + np.outer(SECONDS, (0.1, -0.2))
    ends = np.array([0.0, 200.0])
    np.testing.assert_allclose(rubber_band(SECONDS, drifting, ends, LINE[[0, 200]]), LINE, atol=1e-9)


def test_rubber_band_holds_the_last_misfit() -> None:
    pulled = rubber_band(SECONDS, LINE, np.array([50.0]), np.array([[53.0, 1.0]]))
    np.testing.assert_allclose(pulled, LINE + np.array([3.0, 1.0]))


def test_dead_reckoning_drives_a_circle() -> None:
    at_s = np.linspace(0.0, 100.0, 2001)
    heading = 2.0 * math.pi * at_s / 100.0
    velocity = np.column_stack((np.full(2001, 0.5), np.zeros(2001)))
    path = dead_reckoned(at_s, heading, velocity, np.array([10.0, 20.0]))
    assert path_length_m(path) == pytest.approx(50.0, rel=1e-5)
    np.testing.assert_allclose(path[-1], (10.0, 20.0), atol=1e-9)
    np.testing.assert_allclose(path[1000], (10.0, 20.0 + 50.0 / math.pi), atol=1e-3)
    sideways = dead_reckoned(at_s[:2], np.zeros(2), np.array([[0.0, 1.0]] * 2), np.zeros(2))
    np.testing.assert_allclose(sideways[-1], (0.0, 0.05), atol=1e-12)
