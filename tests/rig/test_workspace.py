"""Reach of a platform and of the stack: derivatives, proofs, the edge, the nearest pose."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.rig.agreement import agreement, near_edge, slow_search
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM
from bluerov_slam.rig.limits import FO_SHIP_LIMITS, Limit, platform_margins
from bluerov_slam.rig.reach import ReachModel, rotation_from_vector, rotation_vector
from bluerov_slam.rig.stack import StackPose, stack_pose
from bluerov_slam.rig.workspace import RADIAN_MM, PlatformWorkspace, StackWorkspace

SPACE = StackWorkspace()
HOME = stack_pose(np.zeros((4, 6)), FO_SHIP)


def test_margins_and_tool_have_the_derivatives_of_differences() -> None:
    model = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (4, 6)) * model.scale
    reach, h = model.evaluate(points), 1e-6
    for i in range(4):
        for k in range(6):
            moved = points.copy()
            moved[i, k] += h * model.scale[i, k]
            after = model.evaluate(moved)
            assert np.allclose((after.legs - reach.legs)[i] / h, reach.legs_by[i, :, k], atol=1e-4)
            turn = rotation_vector(after.rotation @ reach.rotation.T)
            change = np.concatenate([after.position_mm - reach.position_mm, turn]) / h
            assert np.allclose(change, reach.tool_by[i, k], atol=1e-3)


def test_a_step_of_one_pose_is_that_of_many() -> None:
    model = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
    points = np.random.default_rng(4).uniform(-1.1, 1.1, (30, 4, 6)) * model.scale
    wanted = stack_pose(np.random.default_rng(5).uniform(-0.9, 0.9, points.shape) * model.scale, FO_SHIP)
    reach = model.evaluate(points)
    many = model.step(reach, model.lacking(reach, wanted), 2e-3)
    assert np.isfinite(many.bound).any()
    for i in range(len(points)):
        alone = model.evaluate(points[i])
        lacking = model.lacking(alone, StackPose(wanted.position_mm[i], wanted.rotation[i]))
        one = model.step(alone, lacking, 2e-3)
        assert np.allclose(one.move, many.move[i], atol=1e-6)
        assert np.allclose(one.bound, many.bound[i], atol=1e-6)


def test_smooth_margins_have_the_sign_of_the_exact_ones() -> None:
    model = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (4000, 4, 6)) * model.scale
    exact = platform_margins(points, FO_SHIP_PLATFORM)
    legs = (exact.reach >= 0.0) & (exact.servo_rad >= 0.0) & (exact.joint_rad >= 0.0)
    assert np.array_equal(model.evaluate(points).legs.min(axis=-1) >= 0.0, legs)
    assert 0.5 < legs.mean() < 0.9
    assert (exact.legs_mm[legs] > 0.0).all()  # rods never come near each other within the other limits
    assert (exact.arms_mm[legs] > 0.0).all()


def test_slopes_stay_bounded_through_the_root() -> None:
    model = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
    points = np.random.default_rng(3).uniform(-1.1, 1.1, (4000, 4, 6)) * model.scale
    reach = model.evaluate(points)
    assert (np.abs(reach.legs[..., 0::3]).min(axis=(-1, -2)) < 1e-3).sum() > 20  # on either side of a root or an end
    assert np.abs(reach.legs_by).max() < 3.0


def test_lack_of_one_pose_is_that_of_many() -> None:
    points, poses = SPACE.sample(20, 14)
    reach = SPACE.model.evaluate(0.5 * points)
    many = SPACE.model.lacking(reach, poses)
    for i in range(20):
        one = SPACE.model.lacking(
            SPACE.model.evaluate(0.5 * points[i]), StackPose(poses.position_mm[i], poses.rotation[i])
        )
        assert np.allclose(one, many[i], atol=1e-12)


def test_what_is_missing_to_a_level_is_none_exactly_above_it() -> None:
    points = np.random.default_rng(15).uniform(-1.0, 1.0, (50, 4, 6)) * SPACE.model.scale
    for point in points:
        reach = SPACE.model.evaluate(point)
        least = float(SPACE.model.margin(reach))
        assert SPACE.model.missing(reach, least - 1e-9) == 0.0
        assert SPACE.model.missing(reach, least + 0.01) >= 0.01**2 * 0.99


def test_rotation_vectors_return() -> None:
    vectors = np.random.default_rng(2).uniform(-1.0, 1.0, (50, 3))
    assert np.allclose(rotation_vector(rotation_from_vector(vectors)), vectors, atol=1e-12)
    assert np.array_equal(rotation_vector(np.eye(3)), np.zeros(3))


def test_samples_of_a_platform_are_reachable_and_fill_its_box() -> None:
    space = PlatformWorkspace()
    points = space.sample(3000, 5)
    assert platform_margins(points, FO_SHIP_PLATFORM).allowed.all()
    assert np.array_equal(points, space.sample(3000, 5))
    assert (np.abs(points).max(axis=0) > 0.95 * FO_SHIP_LIMITS.axis_array()).all()


def test_the_nearest_set_point_lies_on_the_edge() -> None:
    space = PlatformWorkspace()
    wished = np.array([0.0, 0.0, -16.0, 0.26, 0.26, 0.0])
    assert not space.reaches(wished)
    near = space.nearest(wished)
    assert space.reaches(near)
    assert not space.reaches(near * (1.0 + 1e-5))


def test_every_sampled_pose_of_the_stack_is_found() -> None:
    points, poses = SPACE.sample(40, 6)
    for i in range(40):
        pose = StackPose(poses.position_mm[i], poses.rotation[i])
        found = SPACE.find(pose)
        assert found.reached
        assert SPACE.reaches(pose)
        made = stack_pose(found.set_points, FO_SHIP)
        assert np.abs(made.position_mm - pose.position_mm).max() < 1e-3
        assert np.abs(made.rotation - pose.rotation).max() < 1e-5
        assert platform_margins(found.set_points, FO_SHIP_PLATFORM).allowed.all()
        assert platform_margins(points[i], FO_SHIP_PLATFORM).allowed.all()


def test_the_largest_margin_beats_what_the_sample_has() -> None:
    points, poses = SPACE.sample(5, 7)
    for i in range(5):
        margin = SPACE.margin(StackPose(poses.position_mm[i], poses.rotation[i]))
        assert margin > float(SPACE.model.margin(SPACE.model.evaluate(points[i])))


def test_far_poses_are_out_and_their_nearest_is_in() -> None:
    for place, turn, limits in [
        ((500.0, 0.0, -648.0), (0.0, 0.0, 0.0), set(Limit)),
        ((110.0, 0.0, -648.0), (0.0, 0.0, 0.6), {Limit.AXIS, Limit.JOINT, Limit.REACH}),  # a corner of three
        ((110.0, 0.0, -900.0), (0.0, 0.0, 0.0), {Limit.AXIS, Limit.REACH, Limit.SERVO}),
    ]:
        pose = StackPose(np.array(place), rotation_from_vector(np.array(turn)))
        assert not SPACE.reaches(pose)
        assert not SPACE.find(pose).reached
        near = SPACE.nearest(pose)
        assert near.limit in limits
        assert near.limit.words in near.words
        assert platform_margins(near.set_points, FO_SHIP_PLATFORM).allowed.all()
        from_home = np.linalg.norm(pose.position_mm - HOME.position_mm), RADIAN_MM * np.linalg.norm(turn)
        assert np.hypot(near.place_mm, RADIAN_MM * near.turn_rad) < 0.8 * np.hypot(*from_home)


def test_a_reachable_pose_is_its_own_nearest() -> None:
    near = SPACE.nearest(HOME)
    assert near.limit is None
    assert near.place_mm == near.turn_rad == 0.0


def test_degrees_and_missing_numbers_are_refused() -> None:
    with pytest.raises(OutOfValidityError, match="degrees"):
        SPACE.reaches(StackPose(HOME.position_mm, np.array([0.0, 20.0, 0.0])))
    with pytest.raises(OutOfValidityError, match="not a number"):
        SPACE.reaches(StackPose(np.array([np.nan, 0.0, 0.0]), np.eye(3)))


def test_fast_membership_agrees_with_many_searches_near_the_edge() -> None:
    sample = near_edge(SPACE.model, 30, 21)
    assert 0.3 < sample.reachable.mean() < 0.8
    assert agreement(SPACE, sample).share >= 0.9  # 30 poses within 5 %; the figure over 1000 is in bench and docs


def test_slow_search_shows_its_proofs() -> None:
    _, poses = SPACE.sample(20, 8)
    reached, points = slow_search(SPACE.model, poses)
    assert reached.all()
    made = stack_pose(points, FO_SHIP)
    assert np.abs(made.position_mm - poses.position_mm).max() < 1e-3
    assert platform_margins(points, FO_SHIP_PLATFORM).allowed.all()


def test_limits_of_each_platform_are_kept_apart() -> None:
    space = StackWorkspace(FO_SHIP, (FO_SHIP_LIMITS,) * 4)
    assert space.reaches(HOME)
    assert not space.reaches(StackPose(HOME.position_mm + np.array([400.0, 0.0, 0.0]), np.eye(3)))
