"""Reach and plans of the rig's stack, and the covariance of its pose.

Time is this process's processor time, so that other programs do not count. References beside: the slow planner that the
membership test stands in for, and SLSQP, another method.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np

from bench.system import row
from bluerov_slam.evaluation.rig_reach_reference import slsqp_reaches
from bluerov_slam.rig.agreement import agreement, near_edge, slow_search
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.planner import Aim, plan_set_points
from bluerov_slam.rig.stack import StackPose, stack_pose
from bluerov_slam.rig.uncertainty import pose_covariance
from bluerov_slam.rig.validation import stated_spread
from bluerov_slam.rig.workspace import StackWorkspace

NEAR = int(os.environ.get("BLUEROV_SLAM_BENCH_POSES", "1000"))
COMPARED = 200
MIXED, BEYOND = 400, 1.6
"""Half of the mixed poses are reachable, half such moved and turned so much further from home: most out of reach."""
PLANS, COVARIANCES = 50, 50
SEED = 1000
AIMS: tuple[Aim, ...] = ("least_motion", "conditioning", "margin")


def rows() -> list[dict[str, object]]:
    """rig_membership, the same near the edge and its agreement, rig_plan_..., rig_covariance."""
    space = StackWorkspace()
    return [*_membership(space), *_near_the_edge(space), *_plans(space), _covariance()]


def _membership(space: StackWorkspace) -> list[dict[str, object]]:
    half = MIXED // 2
    points, inside = space.sample(MIXED, SEED)
    poses = [*_each(inside)[:half], *_each(stack_pose(BEYOND * points[half:], FO_SHIP))]
    times = [_took_ms(lambda pose=pose: space.reaches(pose)) for pose in poses]
    slsqp_ms = statistics.mean(_took_ms(lambda pose=pose: slsqp_reaches(space.model, pose, SEED)) for pose in poses[:4])
    what = f"is a pose in reach, mean (those that are: {statistics.mean(times[:half]):.2f} ms)"
    beside = f"{_tail(times)}; SLSQP {slsqp_ms:.0f} ms"
    return [row("rig_membership", what, statistics.mean(times), "ms", "<= 1", beside)]


def _near_the_edge(space: StackWorkspace) -> list[dict[str, object]]:
    sample = near_edge(space.model, NEAR, SEED)
    poses = _each(sample.poses)
    found = agreement(space, sample)
    times = [_took_ms(lambda pose=pose: space.reaches(pose)) for pose in poses]
    few = StackPose(sample.poses.position_mm[:COMPARED], sample.poses.rotation[:COMPARED])
    slow_ms = _took_ms(lambda: slow_search(space.model, few)) / len(few.position_mm)
    began = time.process_time()
    other = [slsqp_reaches(space.model, pose, SEED) for pose in poses[:COMPARED]]
    other_ms = 1e3 * (time.process_time() - began) / len(other)
    same = statistics.mean(space.reaches(pose) == one for pose, one in zip(poses, other, strict=False))
    beside = (
        f"slow planner, batched, {slow_ms:.1f} ms; SLSQP {other_ms:.0f} ms, same on {100 * same:.1f} % of {len(other)}"
    )
    errors = f"{found.false_yes} false yes, {found.false_no} false no of {found.count}; {beside}"
    share, mean_ms = 100 * found.share, statistics.mean(times)
    told = f"{_tail(times)}; {beside}"
    return [
        row("rig_membership_ms", "is a pose within 5 % of the edge reachable, mean", mean_ms, "ms", "<= 1", told),
        row("rig_membership_agreement", "agreement with the slow planner there", share, "%", ">= 99", errors),
    ]


def _plans(space: StackWorkspace) -> list[dict[str, object]]:
    poses = _each(space.sample(PLANS, SEED)[1])
    result = []
    for aim in AIMS:
        times = [_took_ms(lambda p=pose, a=aim: plan_set_points(p, aim=a, workspace=space)) for pose in poses]
        spread = f"{PLANS} sampled poses, 95 % within {np.quantile(times, 0.95):.1f} ms, largest {max(times):.1f} ms"
        middle = statistics.median(times)
        result.append(row(f"rig_plan_{aim}_ms", f"plan by {aim}, median", middle, "ms", "<= 20", spread))
    return result


def _covariance() -> dict[str, object]:
    home, spread = np.zeros((4, 6)), stated_spread()
    times = [_took_ms(lambda: pose_covariance(home, FO_SHIP, spread)) for _ in range(COVARIANCES)]
    return row("rig_covariance", "covariance of the tool's pose", 1e3 * min(times), "us")


def _tail(times: Sequence[float]) -> str:
    return f"99 % within {np.quantile(times, 0.99):.2f} ms"


def _each(poses: StackPose) -> Sequence[StackPose]:
    return [StackPose(place, turn) for place, turn in zip(poses.position_mm, poses.rotation, strict=True)]


def _took_ms(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return 1e3 * (time.process_time() - began)
