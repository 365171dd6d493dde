"""What reachability and plans of the rig's stack cost, and the covariance of its pose.

Time is the processor time of this thread, so that other programs do not count; the best of several rounds. Poses are
half reachable, half further out. Beside them stands SciPy's SLSQP on the same poses.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.planner import plan_set_points
from bluerov_slam.rig.stack import StackPose, stack_jacobian, stack_pose
from bluerov_slam.rig.uncertainty import pose_covariance
from bluerov_slam.rig.validation import stated_spread
from bluerov_slam.rig.workspace import StackWorkspace

POSES, ROUNDS = 60, 5
BEYOND = 1.6
"""Reachable poses moved and turned so much further from home: most of them are out of reach."""


def rows() -> list[dict[str, object]]:
    """rig_membership, rig_plan_..., rig_covariance."""
    space = StackWorkspace()
    poses = _poses(space)
    membership_ms = 1e3 / len(poses) * _best(lambda: [space.reaches(each) for each in poses])
    half = POSES // 2
    reachable_ms = 1e3 / half * _best(lambda: [space.reaches(each) for each in poses[:half]])
    slsqp_ms = 1e3 / 4 * _best(lambda: [_plan_by_slsqp(each) for each in poses[:4]], rounds=1)
    took = {aim: [_took(lambda p=each, a=aim: plan_set_points(p, aim=a, workspace=space)) for each in poses]
            for aim in ("least_motion", "margin", "conditioning")}  # fmt: skip
    spread = stated_spread()
    home = np.zeros((4, 6))
    covariance_us = 1e6 / 50 * _best(lambda: [pose_covariance(home, FO_SHIP, spread) for _ in range(50)])
    slsqp = f"SciPy SLSQP without limits of joints, one start, same run: {slsqp_ms:.0f} ms"
    return [
        _row("rig_membership", f"is a pose in reach, mean (those that are: {reachable_ms:.2f} ms)", membership_ms,
             "ms", 1.0, slsqp),
        *(
            _row(f"rig_plan_{aim}", f"set points for a pose by {aim.replace('_', ' ')}, mean (95 %: "
                 f"{1e3 * float(np.quantile(times, 0.95)):.1f} ms)", 1e3 * float(np.mean(times)), "ms",
                 20.0 if aim == "least_motion" else None, slsqp)
            for aim, times in took.items()
        ),
        _row("rig_covariance", "covariance of the tool's pose", covariance_us, "us", None, ""),
    ]  # fmt: skip


def _poses(space: StackWorkspace) -> list[StackPose]:
    """Half of them reachable, half further out by BEYOND."""
    points, made = space.sample(POSES, 2)
    further = stack_pose(BEYOND * points[POSES // 2 :], FO_SHIP)
    return [
        *(StackPose(made.position_mm[i], made.rotation[i]) for i in range(POSES // 2)),
        *(StackPose(p, r) for p, r in zip(further.position_mm, further.rotation, strict=True)),
    ]


def _plan_by_slsqp(pose: StackPose) -> np.ndarray:
    scale = np.tile([5.0, 5.0, 16.0, 0.26, 0.26, 0.087], 4)

    def missing(x: np.ndarray) -> np.ndarray:
        made = stack_pose((x * scale).reshape(4, 6), FO_SHIP)
        turn = pose.rotation @ made.rotation.T
        axis = 50.0 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return np.concatenate([made.position_mm - pose.position_mm, axis])

    def slope(x: np.ndarray) -> np.ndarray:
        jacobian = stack_jacobian((x * scale).reshape(4, 6), FO_SHIP) * scale
        return np.concatenate([jacobian[:3], -100.0 * jacobian[3:]])

    found: np.ndarray = minimize(
        lambda x: float(x @ x), np.zeros(24), jac=lambda x: 2.0 * x, bounds=[(-1.0, 1.0)] * 24, method="SLSQP",
        constraints={"type": "eq", "fun": missing, "jac": slope},
    ).x  # fmt: skip
    return found


def _best(work: Callable[[], object], rounds: int = ROUNDS) -> float:
    return min(_took(work) for _ in range(rounds))


def _took(work: Callable[[], object]) -> float:
    begin = time.thread_time()
    work()
    return time.thread_time() - begin


def _row(name: str, what: str, value: float, unit: str, must: float | None, beside: str) -> dict[str, object]:
    return {
        "id": name,
        "name": what,
        "value": round(value, 3),
        "unit": unit,
        "must": "" if must is None else f"<= {must:g}",
        "met": must is None or value <= must,
        "reference": beside,
    }
