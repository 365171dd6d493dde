"""Reach and plans of the stack: processor time of the membership test near the edge, its agreement, time of a plan.

References beside: the slow planner that the test stands in for, and SLSQP, another method.
"""

from __future__ import annotations

import os
import statistics
import time

from bench.system import row
from bluerov_slam.evaluation.rig_reach_reference import slsqp_reaches
from bluerov_slam.rig.agreement import agreement, near_edge, slow_search
from bluerov_slam.rig.planner import Aim, plan_set_points
from bluerov_slam.rig.stack import StackPose
from bluerov_slam.rig.workspace import StackWorkspace

POSES = int(os.environ.get("BLUEROV_SLAM_BENCH_POSES", "1000"))
PLANS = 50
COMPARED = 200
SEED = 1000
AIMS: tuple[Aim, ...] = ("least_motion", "conditioning", "margin")


def rows() -> list[dict[str, object]]:
    """Membership within 5 % of the edge, and plans of sampled poses."""
    space = StackWorkspace()
    sample = near_edge(space.model, POSES, SEED)
    poses = [StackPose(p, r) for p, r in zip(sample.poses.position_mm, sample.poses.rotation, strict=True)]
    began = time.process_time()
    found = agreement(space, sample)
    fast_ms = 1e3 * (time.process_time() - began) / POSES
    began = time.process_time()
    slow_search(space.model, StackPose(sample.poses.position_mm[:200], sample.poses.rotation[:200]))
    slow_ms = 1e3 * (time.process_time() - began) / 200
    began = time.process_time()
    other = [slsqp_reaches(space.model, pose, SEED) for pose in poses[:COMPARED]]
    other_ms = 1e3 * (time.process_time() - began) / len(other)
    same = statistics.mean(space.reaches(pose) == one for pose, one in zip(poses, other, strict=False))
    beside = (
        f"slow planner, batched, {slow_ms:.1f} ms; SLSQP {other_ms:.0f} ms, same on {100 * same:.1f} % of {len(other)}"
    )
    errors = f"{found.false_yes} false yes, {found.false_no} false no of {found.count}; {beside}"
    result = [
        row("rig_membership_ms", "is a pose within 5 % of the edge reachable, mean", fast_ms, "ms", "<= 1", beside),
        row(
            "rig_membership_agreement", "agreement with the slow planner there", 100 * found.share, "%", ">= 99", errors
        ),
    ]
    _, plans = space.sample(PLANS, SEED)
    for aim in AIMS:
        times = []
        for place, turn in zip(plans.position_mm, plans.rotation, strict=True):
            began = time.process_time()
            plan_set_points(StackPose(place, turn), aim=aim, workspace=space)
            times.append(1e3 * (time.process_time() - began))
        count = f"{PLANS} sampled poses, largest {max(times):.1f} ms"
        result.append(
            row(f"rig_plan_{aim}_ms", f"plan by {aim}, median", statistics.median(times), "ms", "<= 20", count)
        )
    return result
