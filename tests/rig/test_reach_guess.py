"""The guess of reach: near the truth for the stack it was fitted to, none for any other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bluerov_slam.rig.agreement import near_edge
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.limits import FO_SHIP_LIMITS
from bluerov_slam.rig.reach import ReachModel
from bluerov_slam.rig.reach_guess import stored_guess
from bluerov_slam.rig.stack import StackPose, stack_pose
from bluerov_slam.rig.workspace import StackWorkspace

MODEL = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
GUESS = stored_guess(MODEL)


def test_guessed_set_points_nearly_make_sampled_poses() -> None:
    assert GUESS is not None
    _, poses = StackWorkspace().sample(200, 9)
    points, margins = GUESS(poses)
    assert (np.abs(points) <= MODEL.scale).all()
    made = stack_pose(points, FO_SHIP)
    assert np.median(np.linalg.norm(made.position_mm - poses.position_mm, axis=-1)) < 15.0
    assert (margins > 0.0).mean() > 0.99


def test_the_guessed_margin_has_mostly_the_sign_of_the_truth_near_the_edge() -> None:
    assert GUESS is not None
    sample = near_edge(MODEL, 40, 22)
    _, margins = GUESS(sample.poses)
    assert ((margins >= 0.0) == sample.reachable).mean() > 0.8
    assert np.corrcoef(margins, sample.share)[0, 1] < -0.8


def test_a_guess_of_one_pose_is_that_of_many() -> None:
    assert GUESS is not None
    _, poses = StackWorkspace().sample(3, 10)
    many = GUESS(poses)
    one = GUESS(StackPose(poses.position_mm[1], poses.rotation[1]))
    assert np.allclose(one[0], many[0][1])
    assert np.allclose(one[1], many[1][1])


def test_another_stack_has_no_guess_and_is_searched_all_the_same() -> None:
    stiffer = replace(FO_SHIP_LIMITS, joint_tilt_rad=float(np.radians(36.0)))
    longer = replace(FO_SHIP, tool_mm=FO_SHIP.tool_mm + np.array([0.0, 0.0, -30.0]))
    for space in (StackWorkspace(FO_SHIP, stiffer), StackWorkspace(longer)):
        assert stored_guess(space.model) is None
        points, poses = space.sample(5, 12)
        for place, turn in zip(poses.position_mm, poses.rotation, strict=True):
            assert space.reaches(StackPose(place, turn))
        far = stack_pose(2.0 * points[:2], space.dimensions)
        far = StackPose(far.position_mm + np.array([300.0, 0.0, 0.0]), far.rotation)
        for place, turn in zip(far.position_mm, far.rotation, strict=True):
            assert not space.reaches(StackPose(place, turn))
