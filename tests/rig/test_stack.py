import numpy as np
import pytest

import real_data
from bluerov_slam.geometry.platform_stack import TIP_MM, rotations, stack_tip_mm
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.platform import joints_mm
from bluerov_slam.rig.stack import equal_platforms_pose, plate_poses, stack_jacobian, stack_pose
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs
from rig.poses import derivative, stacks


def published_order_tip_mm(set_points):
    """The thesis's getEndEffectorCoords for platforms set each by itself: M = R M."""
    place, reached = np.array([0.0, 0.0, -30.0]), np.eye(3)
    for x, y, z, *attitude in set_points:
        place = place + reached @ [x, y, z - 134.0]
        reached = rotations(np.array(attitude)) @ reached
    return place + reached @ TIP_MM


def turn_between(first, second):
    """Vector in the outer frame that turns one rotation into the other, for small turns exact to its cube."""
    rest = second @ np.swapaxes(first, -1, -2)
    return 0.5 * np.stack(
        [rest[..., 2, 1] - rest[..., 1, 2], rest[..., 0, 2] - rest[..., 2, 0], rest[..., 1, 0] - rest[..., 0, 1]],
        axis=-1,
    )


def test_the_tool_is_at_its_published_place_at_home():
    home = stack_pose(np.zeros((4, 6)), FO_SHIP)
    np.testing.assert_allclose(home.position_mm, [110.0, 0.0, -648.38], atol=1e-9)
    np.testing.assert_array_equal(home.rotation, np.eye(3))


def test_every_platform_stands_on_the_one_beneath():
    """Built up from the joints of each platform by itself: the plate's joints are rigid, whatever is beneath."""
    points = stacks(1)[0]
    plates = plate_poses(points, FO_SHIP)
    place, turn = np.array([0.0, 0.0, -30.0]), np.eye(3)
    for i, point in enumerate(points):
        base = place + turn @ [0.0, 0.0, -34.0]
        joints = base + joints_mm(point, FO_SHIP.platforms[i]).plate_mm @ turn.T
        place, turn = plates.position_mm[i], plates.rotation[i]
        np.testing.assert_allclose((joints - place) @ turn, FO_SHIP.platforms[i].plate_joints_mm, atol=1e-9)
    tool = stack_pose(points, FO_SHIP)
    np.testing.assert_allclose(tool.position_mm, place + turn @ TIP_MM, atol=1e-9)
    np.testing.assert_allclose(tool.rotation, turn)


def test_equal_platforms_make_the_published_pose_in_either_order():
    for point in stacks(50)[:, 0]:
        published = equal_platforms_pose(4.0 * point[:3], 4.0 * point[3:])
        found = stack_pose(np.tile(point, (4, 1)), FO_SHIP)
        np.testing.assert_allclose(found.position_mm, published.position_mm, atol=1e-9)
        np.testing.assert_allclose(found.rotation, published.rotation, atol=1e-12)
        np.testing.assert_allclose(published_order_tip_mm(np.tile(point, (4, 1))), found.position_mm, atol=1e-9)


def test_the_published_order_agrees_about_one_axis_and_is_wrong_for_unequal_platforms():
    random = np.random.default_rng(0)
    for axis in (3, 4, 5):
        points = np.zeros((4, 6))
        points[:, axis] = random.uniform(-0.2, 0.2, 4)
        np.testing.assert_allclose(published_order_tip_mm(points), stack_pose(points, FO_SHIP).position_mm, atol=1e-9)
    points = stacks(500)
    wrong = [np.linalg.norm(published_order_tip_mm(one) - stack_pose(one, FO_SHIP).position_mm) for one in points]
    assert 4.0 < np.median(wrong) < 8.0
    assert 30.0 < np.max(wrong) < 50.0
    # Two platforms at their limits, one rolled and the one above it pitched.
    crossed = np.zeros((4, 6))
    crossed[0, 3] = crossed[1, 4] = np.radians(15.0)
    off = np.linalg.norm(published_order_tip_mm(crossed) - stack_pose(crossed, FO_SHIP).position_mm)
    assert off == pytest.approx(5.37, abs=0.01)


def test_a_quarter_of_the_angles_four_times_is_the_whole_about_one_axis_only():
    for attitude in np.diag([1.0, 1.0, 0.3]):
        np.testing.assert_allclose(
            equal_platforms_pose(np.zeros(3), attitude).rotation, rotations(attitude), atol=1e-12
        )
    attitude = np.radians([60.0, 60.0, 0.0])
    rest = rotations(attitude).T @ equal_platforms_pose(np.zeros(3), attitude).rotation
    assert np.degrees(np.arccos((np.trace(rest) - 1.0) / 2.0)) > 10.0


def test_the_published_formula_is_that_of_the_logs_and_takes_any_shape():
    translation = np.arange(12.0).reshape(2, 2, 3)
    attitude = np.array([0.1, 0.2, -0.05])
    found = equal_platforms_pose(translation, attitude)
    assert found.position_mm.shape == (2, 2, 3)
    assert found.rotation.shape == (2, 2, 3, 3)
    np.testing.assert_array_equal(found.position_mm[1, 0], stack_tip_mm(translation[1, :1], attitude[None])[0])


def test_the_stack_of_independent_platforms_stands_where_the_real_logs_say():
    """All rows of all 27 logs: set alike, four independent platforms are the published formula.

    That formula is the logged truth: tests/geometry, with the attitude of the row before and the step since.
    """
    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    assert len(logs) == 27
    for log in logs:
        rows = log.rows
        translation = np.where(rows.axis[:, None] == np.array(["X", "Y", "Z"]), rows.setpoint[:, None], 0.0)
        attitude = np.radians(rows.attitude_deg)
        known = np.all(np.isfinite(attitude), axis=1)
        published = stack_tip_mm(translation[known], attitude[known])
        alike = np.repeat(np.concatenate([translation, attitude], axis=1)[known, None] / 4.0, 4, axis=1)
        np.testing.assert_allclose(stack_pose(alike, FO_SHIP).position_mm, published, atol=1e-9)


def test_stack_jacobian_is_the_difference_quotient():
    for points in stacks(5):
        nominal = stack_pose(points, FO_SHIP).rotation

        def pose(numbers, nominal=nominal):
            found = stack_pose(numbers.reshape(4, 6), FO_SHIP)
            return np.concatenate([found.position_mm, turn_between(nominal, found.rotation)])

        wanted = derivative(pose, points.ravel(), 1e-5)
        np.testing.assert_allclose(stack_jacobian(points, FO_SHIP), wanted, rtol=1e-7, atol=1e-7)


def test_many_stacks_are_each_stack():
    points = stacks(6).reshape(2, 3, 4, 6)
    pose, plates, jacobian = (f(points, FO_SHIP) for f in (stack_pose, plate_poses, stack_jacobian))
    assert jacobian.shape == (2, 3, 6, 24)
    for i, j in ((0, 1), (1, 2)):
        np.testing.assert_allclose(pose.position_mm[i, j], stack_pose(points[i, j], FO_SHIP).position_mm, atol=1e-9)
        np.testing.assert_allclose(plates.position_mm[i, j], plate_poses(points[i, j], FO_SHIP).position_mm, atol=1e-9)
        np.testing.assert_allclose(jacobian[i, j], stack_jacobian(points[i, j], FO_SHIP), atol=1e-9)


def test_what_cannot_be_set_is_nowhere():
    points = np.zeros((2, 4, 6))
    points[1, 2, 0] = np.nan
    found = stack_pose(points, FO_SHIP)
    assert np.all(np.isfinite(found.position_mm[0]))
    assert np.all(np.isnan(found.position_mm[1, 0]))
