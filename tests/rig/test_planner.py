"""Plans: each aim is best at its own, all make the pose, unreachable poses get the nearest."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM
from bluerov_slam.rig.limits import platform_margins
from bluerov_slam.rig.planner import Plan, plan_set_points
from bluerov_slam.rig.stack import StackPose, stack_pose
from bluerov_slam.rig.workspace import StackWorkspace

SPACE = StackWorkspace()


def _plans(pose: StackPose) -> dict[str, Plan]:
    aims = ("least_motion", "conditioning", "margin")
    return {aim: plan_set_points(pose, aim=aim, workspace=SPACE) for aim in aims}  # type: ignore[arg-type]


def test_each_aim_is_best_at_its_own_and_all_make_the_pose() -> None:
    _, poses = SPACE.sample(6, 3)
    for place, turn in zip(poses.position_mm, poses.rotation, strict=True):
        pose = StackPose(place, turn)
        plans = _plans(pose)
        for plan in plans.values():
            assert plan.reached
            assert plan.limit is None
            assert np.abs(stack_pose(plan.set_points, FO_SHIP).position_mm - place).max() < 1e-3
            assert platform_margins(plan.set_points, FO_SHIP_PLATFORM).allowed.all()
        least, margin, condition = plans["least_motion"], plans["margin"], plans["conditioning"]
        assert least.motion <= min(margin.motion, condition.motion) + 1e-6
        assert margin.margin >= max(least.margin, condition.margin) - 1e-6


def test_the_least_way_from_where_it_stands_is_none() -> None:
    points, poses = SPACE.sample(3, 4)
    for i in range(3):
        # where it stands must keep the margin that plans leave
        start = 0.8 * points[i]
        plan = plan_set_points(stack_pose(start, FO_SHIP), start=start, workspace=SPACE)
        assert plan.motion < 0.02
    del poses


def test_an_unreachable_pose_gets_the_nearest_and_the_words() -> None:
    plan = plan_set_points(StackPose(np.array([500.0, 0.0, -648.0]), np.eye(3)), workspace=SPACE)
    assert not plan.reached
    assert plan.limit is not None
    assert "cannot be reached" in plan.words
    assert plan.limit.words in plan.words
    assert platform_margins(plan.set_points, FO_SHIP_PLATFORM).allowed.all()


def test_degrees_are_refused() -> None:
    with pytest.raises(OutOfValidityError, match="degrees"):
        plan_set_points(StackPose(np.zeros(3), np.array([0.0, 20.0, 0.0])))
