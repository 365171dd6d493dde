import numpy as np
import pytest

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, AxisLimits, PlatformDimensions
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.platform import (
    condition,
    inverse,
    joints_mm,
    pose_jacobian,
    published_servo_angles_rad,
    servo_angles_rad,
    servo_jacobian,
)
from rig.poses import derivative, reachable, unequal

HOME = np.zeros(6)
DOWN_10 = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])


def box(count, seed=0):
    """Set points within the published limits of all axes at once, some of them out of reach."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6)) * AxisLimits().array()


def atan_acos_angles_rad(points, side):
    """The textbook form, leg by leg, from the drawing's numbers alone."""
    angles = np.empty(points.shape)
    for n, (*move, roll, pitch, yaw) in enumerate(points):
        turn = rotations(np.array([roll, pitch, yaw]))
        for i in range(6):
            bearing = FO_SHIP_PLATFORM.arm_bearings_rad[i]
            q = (
                turn @ FO_SHIP_PLATFORM.plate_joints_mm[i]
                + move
                - [0.0, 0.0, 100.0]
                - FO_SHIP_PLATFORM.base_joints_mm[i]
            )
            a, c = q @ [np.cos(bearing), np.sin(bearing), 0.0], -q[2]
            k = 24.0**2 + q @ q - 106.0**2
            with np.errstate(invalid="ignore"):
                angles[n, i] = np.arctan2(c, a) + side * np.arccos(k / (2.0 * 24.0 * np.hypot(a, c)))
    return np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi


def test_check_values():
    """Reference: all servos 23.0 degrees at zero, 0.4 at z = +10 mm, which is down."""
    np.testing.assert_allclose(np.degrees(servo_angles_rad(HOME, FO_SHIP_PLATFORM)), 23.0, atol=0.05)
    np.testing.assert_allclose(np.degrees(servo_angles_rad(DOWN_10, FO_SHIP_PLATFORM)), 0.4, atol=0.05)


@pytest.mark.parametrize(("branch", "side"), [("down", -1.0), ("up", 1.0)])
def test_one_arc_tangent_is_the_textbook_form(branch, side):
    points = box(300)
    wanted = atan_acos_angles_rad(points, side)
    assert 0.01 < np.mean(np.isnan(wanted)) < 0.5
    np.testing.assert_allclose(servo_angles_rad(points, FO_SHIP_PLATFORM, branch), wanted, atol=1e-11)


def test_the_published_quadratic_put_right_takes_the_same_branch():
    points = box(20_000)
    np.testing.assert_allclose(
        published_servo_angles_rad(points, FO_SHIP_PLATFORM), servo_angles_rad(points, FO_SHIP_PLATFORM), atol=1e-9
    )


def test_the_published_equations_as_printed_give_other_angles():
    """2.1 and 2.2 exchange the lengths; a rod of 24 and an arm of 106 mm would not even reach home."""
    ones = np.ones(6)
    exchanged = PlatformDimensions(
        FO_SHIP_PLATFORM.base_joints_mm, FO_SHIP_PLATFORM.plate_joints_mm, FO_SHIP_PLATFORM.arm_bearings_rad,
        106.0 * ones, 24.0 * ones,
    )  # fmt: skip
    angles = published_servo_angles_rad(HOME, exchanged)
    assert not np.any(np.abs(angles - servo_angles_rad(HOME, FO_SHIP_PLATFORM)) < 0.1)


@pytest.mark.parametrize("branch", ["down", "up"])
def test_plain_sums_and_arrays_agree(branch):
    points = box(400)
    made = unequal()
    many = servo_angles_rad(points, made, branch)
    one_by_one = [servo_angles_rad(point, made, branch) for point in points]
    np.testing.assert_allclose(one_by_one, many, atol=1e-12)
    few = points.reshape(100, 4, 6)
    np.testing.assert_allclose(
        [servo_angles_rad(four, made, branch) for four in few], many.reshape(100, 4, 6), atol=1e-12
    )
    np.testing.assert_array_equal(servo_angles_rad(few, made, branch), many.reshape(100, 4, 6))


def test_a_batch_of_platforms_each_has_its_own_dimensions():
    made = [unequal(seed) for seed in range(3)]
    names = ("base_joints_mm", "plate_joints_mm", "arm_bearings_rad", "arm_mm", "rod_mm")
    batch = PlatformDimensions(*(np.stack([getattr(one, name) for one in made]) for name in names))
    points = reachable(3)
    own = [servo_angles_rad(point, one) for point, one in zip(points, made, strict=True)]
    np.testing.assert_allclose(servo_angles_rad(points, batch), own, atol=1e-12)
    same = [servo_angles_rad(points[0], one) for one in made]
    np.testing.assert_allclose(servo_angles_rad(points[0], batch), same, atol=1e-12)
    grid = np.stack([points, points[::-1]])  # (2, 3, 6): the platforms are along the last of the leading axes
    np.testing.assert_allclose(servo_angles_rad(grid, batch)[0], own, atol=1e-12)


@pytest.mark.parametrize("branch", ["down", "up"])
def test_rods_keep_their_length(branch):
    points = reachable(2000)
    found = joints_mm(points, FO_SHIP_PLATFORM, branch)
    np.testing.assert_allclose(np.linalg.norm(found.plate_mm - found.arm_ends_mm, axis=-1), 106.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found.arm_ends_mm - found.base_mm, axis=-1), 24.0, atol=1e-12)


def test_joints_stand_over_the_base_and_turn_with_the_plate():
    found = joints_mm(np.array([1.0, 2.0, -3.0, 0.0, 0.0, 0.1]), FO_SHIP_PLATFORM)
    np.testing.assert_allclose(found.plate_mm.mean(axis=0), [1.0, 2.0, -103.0], atol=1e-9)
    home = joints_mm(HOME, FO_SHIP_PLATFORM)
    turn = np.angle((found.plate_mm - [1, 2, 0])[:, :2] @ [1, 1j] / (home.plate_mm[:, :2] @ [1, 1j]))
    np.testing.assert_allclose(turn, 0.1)
    assert np.all(home.arm_ends_mm[:, 2] < 0.0)  # 23 degrees up, and z is down


def test_a_positive_roll_lowers_the_right_side_and_a_positive_pitch_raises_the_front():
    rolled = joints_mm(np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]), FO_SHIP_PLATFORM).plate_mm
    assert np.all((rolled[:, 2] + 100.0) * rolled[:, 1] >= -1e-9)
    pitched = joints_mm(np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0]), FO_SHIP_PLATFORM).plate_mm
    assert np.all((pitched[:, 2] + 100.0) * pitched[:, 0] <= 1e-9)


def test_the_published_remap_turns_roll_and_pitch_in_the_other_order():
    """x' = -y, y' = -x, z' = -z; a' = -b, b' = -a, c' = -c, then Rz Ry Rx: with one angle the same turn, else not."""
    remap = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    for attitude in np.diag([0.2, 0.2, 0.2]):
        roll, pitch, yaw = attitude
        published = remap @ rotations(np.array([-pitch, -roll, -yaw])) @ remap
        np.testing.assert_allclose(published, rotations(attitude), atol=1e-15)
    limit = np.radians(15.0)
    difference = (remap @ rotations(np.array([-limit, -limit, 0.0])) @ remap).T @ rotations(
        np.array([limit, limit, 0.0])
    )
    assert np.degrees(np.arccos((np.trace(difference) - 1.0) / 2.0)) == pytest.approx(3.87, abs=0.05)


def test_out_of_reach_is_nan_for_the_legs_that_cannot_and_not_a_number_is_nan_for_all():
    far = servo_angles_rad(np.array([0.0, 0.0, -29.0, 0.0, 0.15, 0.0]), FO_SHIP_PLATFORM)
    assert 0 < np.isnan(far).sum() < 6
    for bad in (np.nan, np.inf):
        point = np.array([0.0, 0.0, 0.0, 0.0, 0.0, bad])
        assert np.all(np.isnan(servo_angles_rad(point, FO_SHIP_PLATFORM)))
        many = np.concatenate([np.tile(HOME, (20, 1)), point[None]])
        angles = servo_angles_rad(many, FO_SHIP_PLATFORM)
        assert np.all(np.isnan(angles[-1]))
        assert np.all(np.isfinite(angles[:-1]))


def test_more_set_points_than_one_block_are_the_same():
    points = np.tile(box(1000), (20, 1))
    angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
    np.testing.assert_array_equal(angles[:1000], angles[-1000:])
    assert servo_angles_rad(np.empty((0, 6)), FO_SHIP_PLATFORM).shape == (0, 6)


@pytest.mark.parametrize("branch", ["down", "up"])
def test_servo_jacobian_is_the_difference_quotient(branch):
    made = unequal()
    for point in reachable(20, share=0.8):
        wanted = derivative(lambda at: servo_angles_rad(at, made, branch), point, 1e-5)
        found = servo_jacobian(point, made, branch)
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(pose_jacobian(point, made, branch) @ found, np.eye(6), atol=1e-9)


def test_leg_lengths_change_as_their_derivatives_say():
    made = unequal(1)
    for point in reachable(10):
        angles = servo_angles_rad(HOME, made)
        found = leg_lengths(point, angles, made)
        by_set_point = derivative(lambda at, held=angles: leg_lengths(at, held, made).excess_mm, point, 1e-5)
        np.testing.assert_allclose(found.by_set_point, by_set_point, rtol=1e-7, atol=1e-7)
        by_servo = derivative(lambda at, held=point: leg_lengths(held, at, made).excess_mm, angles, 1e-5)
        np.testing.assert_allclose(-np.diag(found.by_servo_mm), by_servo, atol=1e-7)


def test_jacobians_of_many_are_those_of_each():
    points = reachable(30).reshape(5, 6, 6)
    for function in (servo_jacobian, pose_jacobian):
        many = function(points, FO_SHIP_PLATFORM)
        assert many.shape == (5, 6, 6, 6)
        np.testing.assert_allclose(many[3, 2], function(points[3, 2], FO_SHIP_PLATFORM), rtol=1e-9, atol=1e-12)
    assert np.all(np.isnan(pose_jacobian(np.array([0.0, 0.0, -60.0, 0.0, 0.0, 0.0]), FO_SHIP_PLATFORM)))


def test_condition_counts_rotations_at_the_plate_s_joints():
    """A larger copy of the platform has the same condition number."""
    point = reachable(1)[0]
    larger = PlatformDimensions(
        2 * FO_SHIP_PLATFORM.base_joints_mm, 2 * FO_SHIP_PLATFORM.plate_joints_mm, FO_SHIP_PLATFORM.arm_bearings_rad,
        2 * FO_SHIP_PLATFORM.arm_mm, 2 * FO_SHIP_PLATFORM.rod_mm, 200.0,
    )  # fmt: skip
    numbers = []
    for made, at in ((FO_SHIP_PLATFORM, point), (larger, point * [2, 2, 2, 1, 1, 1])):
        numbers.append(condition(leg_lengths(at, servo_angles_rad(at, made), made).by_set_point, made))
    assert numbers[0] == pytest.approx(numbers[1])
    assert 1.0 < numbers[0] < 4.0


def test_no_inverse_is_nan_and_does_not_spoil_the_others():
    matrices = np.stack([np.eye(6), np.zeros((6, 6)), np.full((6, 6), np.nan), 2.0 * np.eye(6)])
    found = inverse(matrices)
    np.testing.assert_allclose(found[0], np.eye(6))
    assert np.all(np.isnan(found[1:3]))
    np.testing.assert_allclose(found[3], 0.5 * np.eye(6))
