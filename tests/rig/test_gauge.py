"""The go/no-go gauge: the published angle, every root of its equation, and what passing says of one servo."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.rig.gauge import (
    GaugePair,
    largest_misalignment_rad,
    misalignment_branches,
    servo_error_polygon,
    servo_errors,
    worst_case,
)


def published_equation(between_rad: float, pair: GaugePair) -> float:
    """Equations 2.14 to 2.17 as they are printed."""
    x2 = pair.servo_spacing_mm / 2 - pair.horn_length_mm * math.cos(between_rad / 2)
    x1 = (pair.channel_length_mm / 2 - x2) * math.sin(between_rad / 2) / math.cos(between_rad / 2)
    x3 = pair.horn_width_mm / (2 * math.cos(between_rad / 2))
    return pair.horn_width_mm / 2 + x1 + x3 - pair.channel_width_mm


def test_gives_the_published_angle() -> None:
    assert round(math.degrees(largest_misalignment_rad()), 1) == 3.7


def test_every_root_solves_the_published_equation_and_none_is_left_out() -> None:
    pair = GaugePair()
    roots = misalignment_branches(pair)
    assert all(published_equation(root.between_horns_rad, pair) == pytest.approx(0.0, abs=1e-9) for root in roots)
    grid = np.linspace(-2.0 * math.pi + 1e-4, 2.0 * math.pi - 1e-4, 20001)
    poles = np.abs(np.cos(grid / 2)) < 0.05  # the printed form divides by the cosine
    values = np.array([published_equation(angle, pair) for angle in grid])
    crossings = (np.sign(values[1:]) != np.sign(values[:-1])) & ~poles[1:] & ~poles[:-1]
    assert np.sum(crossings) == len(roots) == 4


def test_only_the_smallest_root_is_physical() -> None:
    roots = misalignment_branches()
    assert [root.physical for root in roots] == [True, False, False, False]
    assert len({root.reason for root in roots}) == 4


def test_the_published_corner_is_the_worst_of_all() -> None:
    angle, pair = worst_case()
    assert angle == largest_misalignment_rad()
    assert pair == GaugePair()
    random = np.random.default_rng(0)
    for width, length, spacing in random.uniform([7.5, 24.5, 57.0], [7.8, 25.5, 59.0], (200, 3)):
        assert largest_misalignment_rad(GaugePair(width, length, spacing)) <= angle


def test_horns_wider_than_the_channel_never_fit() -> None:
    wide = GaugePair(horn_width_mm=7.9)
    assert math.isnan(largest_misalignment_rad(wide))
    assert len(servo_error_polygon(wide)) == 0


def fits(first_rad: float, second_rad: float, pair: GaugePair) -> bool:
    """Whether some tilt of the gauge brings all of both horns between its walls, by trying."""
    enters, ends = 0.5 * pair.channel_length_mm, 0.5 * pair.servo_spacing_mm - pair.horn_length_mm
    out = 0.5 * pair.servo_spacing_mm
    along = np.array([-enters, -ends, ends, enters])
    heights = np.array(
        [first_rad * (out - enters), first_rad * (out - ends), second_rad * (out - ends), second_rad * (out - enters)]
    )
    tilted = heights - np.linspace(-0.15, 0.15, 6001)[:, None] * along
    return bool(np.min(np.ptp(tilted, axis=1)) <= pair.channel_width_mm - pair.horn_width_mm)


def test_the_polygon_is_what_some_tilt_of_the_gauge_lets_pass() -> None:
    pair = GaugePair()
    corners = servo_error_polygon(pair)
    assert len(corners) == 8
    assert all(fits(*(0.999 * corner), pair) for corner in corners)
    assert not any(fits(*(1.002 * corner), pair) for corner in corners)


def test_a_v_is_the_published_case_and_opposite_errors_are_seen_better() -> None:
    errors = servo_errors()
    assert 2.0 * errors.alike_rad == pytest.approx(largest_misalignment_rad(), rel=0.006)
    assert errors.one_servo_rad == pytest.approx(errors.alike_rad)
    assert math.degrees(errors.opposite_rad) == pytest.approx(0.66, abs=0.01)


def test_a_gauge_held_off_the_middle_lets_one_servo_be_further_off() -> None:
    assert servo_errors(slide_mm=5.0).one_servo_rad > 1.3 * servo_errors().one_servo_rad


def test_the_spread_of_what_passes_is_that_of_random_servos() -> None:
    pair = GaugePair()
    tried = np.random.default_rng(1).uniform(-0.05, 0.05, (4000, 2))
    passed = np.array([servo for servo in tried if fits(servo[0], servo[1], pair)])
    expected = servo_errors(pair).covariance_rad2
    assert np.cov(passed.T) == pytest.approx(expected, rel=0.1)
