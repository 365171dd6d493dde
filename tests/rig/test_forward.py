from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM
from bluerov_slam.rig.forward import TOLERANCE_MM, plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from rig.poses import HALF_TURN, reachable, unequal


def test_finds_every_reachable_pose_again_to_a_billionth_of_a_millimetre():
    points = reachable(100_000)
    found = plate_pose(servo_angles_rad(points, FO_SHIP_PLATFORM), FO_SHIP_PLATFORM)
    assert np.all(found.converged)
    assert np.max(found.residual_mm) <= TOLERANCE_MM
    radius = float(FO_SHIP_PLATFORM.plate_radius_mm)
    assert np.max(np.abs(found.set_point - points) * [1, 1, 1, radius, radius, radius]) <= 1e-9
    assert np.min(found.condition) >= 1.0
    assert np.max(found.condition) < 5.0


def test_finds_poses_beyond_the_axis_limits_too():
    """All that the servos reach by themselves, not axis by axis: from every corner of what six arms can do."""
    random = np.random.default_rng(5)
    points = random.uniform(-1.0, 1.0, (100_000, 6)) * [25.0, 25.0, 30.0, 0.6, 0.6, 0.6]
    angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
    kept = np.all(np.abs(angles) <= HALF_TURN, axis=-1)
    assert np.sum(kept) > 3000
    found = plate_pose(angles[kept], FO_SHIP_PLATFORM)
    assert np.all(found.converged)
    np.testing.assert_allclose(found.set_point, points[kept], atol=1e-9)


def test_one_pose_in_plain_sums_is_the_pose_in_arrays():
    made = unequal(2)
    points = reachable(100, share=0.9)
    angles = servo_angles_rad(points, made)
    many = plate_pose(angles, made)
    for i, row in enumerate(angles):
        one = plate_pose(row, made)
        assert one.converged
        assert one.converged.shape == ()
        assert one.residual_mm <= TOLERANCE_MM
        np.testing.assert_allclose(one.set_point, many.set_point[i], atol=1e-10)
        assert float(one.condition) == pytest.approx(float(many.condition[i]), rel=1e-9)


def test_a_start_nearby_and_any_leading_axes_are_taken():
    points = reachable(24).reshape(2, 3, 4, 6)
    angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
    found = plate_pose(angles, FO_SHIP_PLATFORM, points + 1e-3)
    assert found.converged.shape == (2, 3, 4)
    np.testing.assert_allclose(found.set_point, points, atol=1e-9)
    np.testing.assert_allclose(
        plate_pose(angles[0, 0, 0], FO_SHIP_PLATFORM, points[0, 0, 1]).set_point, points[0, 0, 0], atol=1e-9
    )


def test_one_pair_of_commands_makes_another_pose_of_each_rig_of_a_batch():
    angles = servo_angles_rad(np.zeros(6), FO_SHIP_PLATFORM)
    rods = FO_SHIP_PLATFORM.rod_mm + np.array([0.0, 1.0, 3.0])[:, None]
    found = plate_pose(angles, replace(FO_SHIP_PLATFORM, rod_mm=rods))
    height = found.set_point[:, 2]
    assert abs(height[0]) < 1e-9
    assert height[2] < 2.0 * height[1] < 0.0
    np.testing.assert_allclose(np.delete(found.set_point, 2, axis=1), 0.0, atol=1e-9)


def test_any_command_within_a_quarter_turn_has_one_assembly_however_it_is_approached():
    angles = np.random.default_rng(1).uniform(-HALF_TURN, HALF_TURN, (500, 6))
    at_once = plate_pose(angles, FO_SHIP_PLATFORM)
    assert np.all(at_once.converged)
    point = np.zeros((500, 6))
    home = servo_angles_rad(np.zeros(6), FO_SHIP_PLATFORM)
    for share in np.linspace(0.0, 1.0, 11):
        point = plate_pose(home + share * (angles - home), FO_SHIP_PLATFORM, point).set_point
    np.testing.assert_allclose(at_once.set_point, point, atol=1e-9)


def test_where_newton_fails_the_servos_are_turned_in_small_steps():
    """Arms of 45 mm on the same plates; from home Newton finds nothing for this command."""
    long_arms = replace(FO_SHIP_PLATFORM, arm_mm=np.full(6, 45.0))
    command = np.array([1.49, 0.8, -1.21, 1.38, 1.07, -0.18])
    found = plate_pose(command, long_arms)
    assert found.converged
    near = plate_pose(command, long_arms, found.set_point + 0.01)
    np.testing.assert_allclose(near.set_point, found.set_point, atol=1e-9)


def test_angles_that_fit_no_assembly_are_said_to_be_so():
    long_arms = replace(FO_SHIP_PLATFORM, arm_mm=np.full(6, 45.0))
    angles = np.array([0.34, 0.72, 0.14, 1.37, 0.99, -1.56])
    for command in (angles, np.tile(angles, (3, 1))):
        found = plate_pose(command, long_arms)
        assert not np.any(found.converged)
        assert np.all(found.residual_mm > 1e-3)
        assert np.all(np.isnan(found.set_point))
        assert np.all(np.isnan(found.condition))


@pytest.mark.parametrize("command", [np.full(6, np.nan), np.array([0.4, np.inf, 0.4, 0.4, 0.4, 0.4])])
def test_not_a_number_makes_no_pose(command):
    found = plate_pose(command, FO_SHIP_PLATFORM)
    assert not found.converged
    assert np.all(np.isnan(found.set_point))
    both = plate_pose(np.stack([command, servo_angles_rad(np.zeros(6), FO_SHIP_PLATFORM)]), FO_SHIP_PLATFORM)
    assert list(both.converged) == [False, True]
    np.testing.assert_allclose(both.set_point[1], 0.0, atol=1e-9)
