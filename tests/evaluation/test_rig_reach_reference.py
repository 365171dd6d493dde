"""The second opinion on the rig's reach: yes where a sample proves it, no far away, and its yes is a proof."""

from __future__ import annotations

import numpy as np

from bluerov_slam.evaluation.rig_reach_reference import slsqp_reaches
from bluerov_slam.rig.stack import StackPose
from bluerov_slam.rig.workspace import StackWorkspace

SPACE = StackWorkspace()


def test_sampled_poses_are_found_and_far_ones_are_not() -> None:
    _, poses = SPACE.sample(6, 31)
    for place, turn in zip(poses.position_mm, poses.rotation, strict=True):
        assert slsqp_reaches(SPACE.model, StackPose(place, turn), 0)
        assert not slsqp_reaches(SPACE.model, StackPose(place + np.array([400.0, 0.0, 0.0]), turn), 0)
