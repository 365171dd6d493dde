"""A second opinion on what the rig's stack can reach: SLSQP, which shares neither steps nor level with the search.

It makes the least margin as large as it can with the pose as equality, from several starts, and a yes counts only once
the published kinematics (`stack_pose`, `platform_margins`) confirm the set points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.limits import platform_margins
from bluerov_slam.rig.reach import rotation_vector
from bluerov_slam.rig.stack import StackPose, stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats
    from bluerov_slam.rig.reach import Reach, ReachModel

STARTS = 3
MOST_STEPS = 60
_MADE = np.array([1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5])
_UNIT_MM = 100.0


class _Cached:
    """Margins and tool at the last set points that were asked for: SLSQP asks for each of them in turn."""

    def __init__(self, model: ReachModel, pose: StackPose) -> None:
        self.model, self.pose = model, pose
        self._at: Floats | None = None
        self._reach: Reach | None = None

    def _look(self, x: Floats) -> Reach:
        if self._reach is None or self._at is None or not np.array_equal(self._at, x):
            self._at = x.copy()
            self._reach = self.model.evaluate(x[:-1].reshape(-1, 6) * self.model.scale)
        return self._reach

    def margins(self, x: Floats) -> Floats:
        """Of the legs, less the least margin that the last variable claims."""
        return np.asarray(self._look(x).legs.ravel() - x[-1])

    def margins_by(self, x: Floats) -> Floats:
        legs_by = self._look(x).legs_by
        count, rows = legs_by.shape[:2]
        found = np.zeros((count * rows, 6 * count + 1))
        for i in range(count):
            found[i * rows : (i + 1) * rows, 6 * i : 6 * i + 6] = legs_by[i]
        found[:, -1] = -1.0
        return found

    def missing(self, x: Floats) -> Floats:
        """Place over 100 mm, and turn."""
        found = self.model.lacking(self._look(x), self.pose)
        found[:3] /= _UNIT_MM
        return found

    def missing_by(self, x: Floats) -> Floats:
        tool_by = self._look(x).tool_by.reshape(-1, 6).copy()
        tool_by[:, :3] /= _UNIT_MM
        return np.concatenate([-tool_by.T, np.zeros((6, 1))], axis=1)


def slsqp_reaches(model: ReachModel, pose: StackPose, seed: int) -> bool:
    """Whether SLSQP finds set points that make a pose within every limit; axis limits are bounds of its variables."""
    from scipy.optimize import minimize

    random = np.random.default_rng(seed)
    size = 6 * model.count
    downhill = np.zeros(size + 1)
    downhill[-1] = -1.0
    limits = [(-r, r) for r in model.ranges.ravel()]
    look = _Cached(model, pose)
    for k in range(STARTS):
        x = np.zeros(size + 1)
        if k == 0:
            x[:size].reshape(-1, 6)[:, 3:] = rotation_vector(pose.rotation) / model.count / model.scale[:, 3:]
        elif k > 1:
            x[:size] = random.uniform(-0.6, 0.6, size)
        x[:size] = np.clip(x[:size], -1.0, 1.0)
        found = minimize(
            lambda x: -float(x[-1]),
            x,
            jac=lambda _: downhill,
            method="SLSQP",
            bounds=[*limits, (-2.0, 2.0)],
            constraints=[
                {"type": "ineq", "fun": look.margins, "jac": look.margins_by},
                {"type": "eq", "fun": look.missing, "jac": look.missing_by},
            ],
            options={"maxiter": MOST_STEPS, "ftol": 1e-7},
        )
        if _proven(model, pose, found.x[:size].reshape(-1, 6) * model.scale):
            return True
    return False


def _proven(model: ReachModel, pose: StackPose, points: Floats) -> bool:
    made = stack_pose(points, model.dimensions)
    turn = rotation_vector(pose.rotation @ made.rotation.T)
    if (np.abs(np.concatenate([pose.position_mm - made.position_mm, turn])) > _MADE).any():
        return False
    each = zip(points, model.dimensions.platforms, model.limits, strict=True)
    return all(bool(platform_margins(one, platform, limits).allowed) for one, platform, limits in each)
