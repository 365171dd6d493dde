from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, FO_SHIP_SERVOS
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servos import angle_range_rad, angles_of, counts_of, in_range, resolution_rad
from rig.poses import stacks


def test_a_level_arm_stands_at_the_middle_and_its_offset():
    np.testing.assert_array_equal(counts_of(np.zeros((4, 6)), FO_SHIP_SERVOS), 300.0 + FO_SHIP_SERVOS.offset_counts)


def test_a_quarter_turn_is_two_hundred_counts_and_every_second_servo_is_mirrored():
    moved = counts_of(np.full((4, 6), np.radians(45.0)), FO_SHIP_SERVOS) - counts_of(np.zeros((4, 6)), FO_SHIP_SERVOS)
    np.testing.assert_array_equal(moved, np.tile([-100.0, 100.0], (4, 3)))
    assert FO_SHIP_SERVOS.counts_per_rad == pytest.approx(127.3, abs=0.05)


def test_angles_come_back_to_half_a_count():
    gain = 1.0 + 0.05 * np.random.default_rng(0).standard_normal((4, 6))
    calibration = replace(FO_SHIP_SERVOS, gain=gain)
    angles = servo_angles_rad(stacks(500, share=0.6), FO_SHIP_PLATFORM)
    counts = counts_of(angles, calibration)
    back = angles_of(counts, calibration)
    assert np.array_equal(counts, np.rint(counts), equal_nan=True)
    reached = np.isfinite(counts)
    assert np.mean(reached) > 0.95
    assert np.nanmax(np.abs(back - angles) / resolution_rad(calibration)) <= 0.5 + 1e-9
    np.testing.assert_array_equal(counts_of(back, calibration), counts)


def test_a_gain_stretches_about_the_level_arm():
    stretched = replace(FO_SHIP_SERVOS, gain=np.full((4, 6), 1.1))
    angle = np.full((4, 6), 0.5)
    np.testing.assert_allclose(
        counts_of(angle, stretched) - FO_SHIP_SERVOS.offset_counts - 300.0,
        np.tile([-1.0, 1.0], (4, 3)) * np.rint(0.5 * 1.1 * 400.0 / np.pi),
    )


def test_a_servo_does_not_go_beyond_its_stops_nor_to_nowhere():
    lowest, highest = angle_range_rad(FO_SHIP_SERVOS)
    step = resolution_rad(FO_SHIP_SERVOS)
    assert np.all(np.isfinite(counts_of(lowest, FO_SHIP_SERVOS)))
    assert np.all(np.isfinite(counts_of(highest, FO_SHIP_SERVOS)))
    assert np.all(np.isnan(counts_of(lowest - step, FO_SHIP_SERVOS)))
    assert np.all(np.isnan(counts_of(highest + step, FO_SHIP_SERVOS)))
    assert np.all(np.isnan(counts_of(np.full((4, 6), np.nan), FO_SHIP_SERVOS)))
    assert np.all(np.isnan(angles_of(np.full((4, 6), 99.0), FO_SHIP_SERVOS)))
    assert np.all(highest - lowest == pytest.approx(np.pi))
    np.testing.assert_array_equal(
        in_range(np.array([99.0, 100.0, 500.0, 501.0, np.nan]), FO_SHIP_SERVOS), [0, 1, 1, 0, 0]
    )


def test_an_offset_of_nineteen_counts_is_eight_and_a_half_degrees():
    """The published offsets are large against one count (0.45 degrees): they are the horns' splines, not noise."""
    lowest, highest = angle_range_rad(FO_SHIP_SERVOS)
    middle = np.degrees(0.5 * (lowest + highest))[0, 3]
    assert middle == pytest.approx(19.0 * 0.45)
