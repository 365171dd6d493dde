"""Demonstration moves: published ranges, a tool that stands still, a normal that meets the transmitter."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.rig.demo import axis_limits, circle, inverted_pairs, stand_still, track_transmitter
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, AxisLimits
from bluerov_slam.rig.limits import Limit, platform_margins
from bluerov_slam.rig.stack import stack_pose


def test_axis_limits_go_to_the_published_ends() -> None:
    points = axis_limits()
    assert np.array_equal(points.max(axis=(0, 1)), AxisLimits().array())
    assert np.array_equal(points.min(axis=(0, 1)), -AxisLimits().array())
    assert platform_margins(points, FO_SHIP_PLATFORM).allowed.all()


def test_inverted_pairs_keep_the_tool_in_place_along_axes_and_level_about_them() -> None:
    poses = stack_pose(inverted_pairs(), FO_SHIP)
    moved = poses.position_mm - poses.position_mm[0]
    assert np.abs(moved[:7]).max() < 1e-10  # x, y, z
    assert np.abs(poses.rotation - np.eye(3)).max() < 1e-12
    assert np.abs(moved[7:, :2]).max() < 1e-10
    # leaning platforms are lower: two of the four rises of 134 mm lean 15 degrees
    assert moved[7:, 2].max() == pytest.approx(2.0 * 134.0 * (1.0 - np.cos(np.radians(15.0))), abs=1e-9)


def test_the_tool_can_be_made_to_stand_still() -> None:
    points = stand_still(inverted_pairs())
    poses = stack_pose(points, FO_SHIP)
    assert np.abs(poses.position_mm - poses.position_mm[0]).max() < 1e-9
    assert platform_margins(points, FO_SHIP_PLATFORM).allowed.all()


def test_the_circle_is_one() -> None:
    points = circle(points=24)
    assert np.array_equal(points[0], np.zeros((4, 6)))
    assert np.allclose(np.hypot(points[1:-1, :, 3], points[1:-1, :, 4]), np.radians(15.0))
    assert points[1, 0, 3] == pytest.approx(np.radians(15.0))
    with pytest.raises(OutOfValidityError, match="degrees"):
        circle(15.0)


@pytest.mark.parametrize("place", [(2000.0, 0.0, -648.0), (1426.0, -305.0, -640.0), (2000.0, 300.0, -900.0)])
def test_the_normal_meets_the_transmitter(place: tuple[float, float, float]) -> None:
    pointing = track_transmitter(np.array(place))
    assert pointing.limit is None
    pose = stack_pose(pointing.set_points, FO_SHIP)
    sight = np.array(place) - pose.position_mm
    assert np.linalg.norm(np.cross(pose.rotation[:, 0], sight / np.linalg.norm(sight))) < 1e-6


def test_a_transmitter_above_tilts_the_array_up_and_one_on_the_right_turns_it_right() -> None:
    up, right = (
        track_transmitter(np.array([2000.0, 0.0, -1000.0])),
        track_transmitter(np.array([2000.0, 200.0, -648.0])),
    )
    assert up.set_points[0, 4] > 0.0
    assert right.set_points[0, 5] > 0.0


def test_a_transmitter_behind_is_not_reached_and_says_why() -> None:
    pointing = track_transmitter(np.array([500.0, 2000.0, -600.0]))
    assert pointing.limit is Limit.AXIS
    assert pointing.off_rad > 0.5
    assert platform_margins(pointing.set_points, FO_SHIP_PLATFORM).allowed.all()


def test_a_place_that_is_no_number_is_refused() -> None:
    with pytest.raises(OutOfValidityError, match="number"):
        track_transmitter(np.array([np.nan, 0.0, 0.0]))
