"""R7 and R8: reachability and plans of the ground-truth rig."""

from __future__ import annotations

import numpy as np

from bluerov_slam.evaluation.acoustic_cases import share_row
from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun, figure
from bluerov_slam.evaluation.rig_reach_reference import slsqp_reaches
from bluerov_slam.evaluation.statistics import bootstrap
from bluerov_slam.navigation.rotation import log_so3
from bluerov_slam.rig.agreement import agreement, near_edge
from bluerov_slam.rig.dimensions import FO_SHIP, AxisLimits
from bluerov_slam.rig.planner import plan_set_points
from bluerov_slam.rig.stack import StackPose, stack_pose
from bluerov_slam.rig.workspace import StackWorkspace


def membership(run: RigRun) -> list[Row]:
    """R7: the test of reachability near the edge, against the same step from many starts and against another method."""
    space = StackWorkspace()
    sample = near_edge(space.model, run.count(1000, 20), run.seed)
    found = agreement(space, sample)
    count = run.count(200, 4)
    poses = [StackPose(sample.poses.position_mm[i], sample.poses.rotation[i]) for i in range(count)]
    fast = np.array([space.reaches(pose) for pose in poses])
    other = np.array([slsqp_reaches(space.model, pose, run.seed) for pose in poses])
    percent = 100.0 / found.count
    told = f"reachability within 5 % of the edge, {found.count} poses"
    return [
        figure("R7", f"{told}: agrees with the slow planner", 100.0 * found.share, "%", low=99.0),
        figure("R7.no", f"{told}: called out of reach, yet the planner got there", percent * found.false_no, "%"),
        figure("R7.yes", f"{told}: got there, where the planner had given up", percent * found.false_yes, "%"),
        figure("R7.slsqp", f"{count} of them: agrees with SLSQP", 100.0 * float((fast == other).mean()), "%", low=99.0),
        figure("R7.slsqp_no", f"{count} of them: no, yet SLSQP got there", 100.0 * float((~fast & other).mean()), "%"),
    ]


def plans(run: RigRun) -> list[Row]:
    """R8: a plan for poses that are known to be reachable."""
    space = StackWorkspace()
    count = run.count(200, 10)
    points, poses = space.sample(count, run.seed)
    found, errors_mm, motion, margins = [], [], [], []
    for place, turn, made_by in zip(poses.position_mm, poses.rotation, points, strict=True):
        plan = plan_set_points(StackPose(place, turn), workspace=space)
        found.append(not plan.reached)
        if plan.reached:
            made = stack_pose(plan.set_points, FO_SHIP)
            turned = np.linalg.norm(log_so3(made.rotation @ turn.T))
            errors_mm.append(max(float(np.linalg.norm(made.position_mm - place)), 100.0 * float(turned)))
            drawn = np.sqrt(np.sum((made_by / AxisLimits().array()) ** 2))
            motion.append(plan.motion / float(drawn))
            margins.append(plan.margin)
    missed = share_row("R8", f"plans for {count} reachable poses: not found", np.array(found), 2.0)
    return [
        missed,
        figure("R8.error", "plans: worst place, or turn at 100 mm", max(errors_mm), "mm", high=0.01),
        figure("R8.margin", "plans: least margin", min(margins), "1", low=-1e-6),
        Row("R8.motion", "plans: motion / motion of the set points it was made by", bootstrap(motion), "1",
            Target(high=1.0)),
    ]  # fmt: skip


CASES = (RigCase("R7", "reachability", membership), RigCase("R8", "plans", plans))
