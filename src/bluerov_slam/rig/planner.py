"""Which of all the set points that make a pose: least motion, best conditioning or largest margin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.limits import FO_SHIP_LIMITS, Limit, PlatformLimits, checked_pose, checked_set_points
from bluerov_slam.rig.platform import condition, servo_jacobian
from bluerov_slam.rig.stack import StackPose
from bluerov_slam.rig.workspace import LEVEL, Nearest, StackWorkspace, _cut, _made

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

Aim = Literal["least_motion", "conditioning", "margin"]
_PULL = 1e-2
"""Weight of the way from the start against a missing margin: small, so that no limit is passed for a shorter way."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Set points for a pose.

    Attributes:
        reached: whether they make the wished pose; if not, they make the nearest.
        set_points: (P, 6).
        pose: that they make.
        margin: their least margin, without unit.
        motion: root of the summed squares of the way from the start, in shares of the axis limits.
        condition: the worst of the platforms.
        nearest: what to do instead if the pose cannot be reached.
    """

    reached: bool
    set_points: Floats
    pose: StackPose
    margin: float
    motion: float
    condition: float
    nearest: Nearest | None

    @property
    def limit(self) -> Limit | None:
        """What forbids the wished pose."""
        return None if self.nearest is None else self.nearest.limit

    @property
    def words(self) -> str:
        """For a person."""
        return "The pose can be reached." if self.nearest is None else self.nearest.words


def plan_set_points(
    pose: StackPose,
    dimensions: StackDimensions = FO_SHIP,
    limits: PlatformLimits | tuple[PlatformLimits, ...] = FO_SHIP_LIMITS,
    aim: Aim = "least_motion",
    start: Floats | None = None,
    workspace: StackWorkspace | None = None,
) -> Plan:
    """Set points of all platforms for a pose of the tool.

    Args:
        pose: place (3,) and rotation (3, 3).
        dimensions: of the stack.
        limits: of its platforms.
        aim: the least way from the start, the best condition of the worst platform or the largest margin.
        start: where the platforms stand, (P, 6); home if not given.
        workspace: to use again; dimensions and limits are then its own.
    """
    space = workspace or StackWorkspace(dimensions, limits)
    pose = StackPose(*checked_pose(pose.position_mm, pose.rotation))
    from_points = np.zeros((space.model.count, 6)) if start is None else checked_set_points(start)
    found = space.find(pose)
    nearest = None
    if not found.reached:
        nearest = space.nearest(pose)
        points = nearest.set_points
    elif aim == "margin":
        safest = space.safest(pose, found.set_points)
        points = safest.set_points if safest.reached else found.set_points
    elif aim == "least_motion":
        points = _least_motion(space, pose, found.set_points, from_points)
    else:
        points = _best_condition(space, pose, found.set_points)
    reach = space.model.evaluate(points)
    moved = (points - from_points) / space.model.scale
    return Plan(
        nearest is None,
        points,
        StackPose(reach.position_mm, reach.rotation),
        float(space.model.margin(reach)),
        float(np.sqrt(np.sum(moved**2))),
        float(_conditions(space, points).max()),
        nearest,
    )


def _least_motion(space: StackWorkspace, pose: StackPose, points: Floats, start: Floats) -> Floats:
    model, best, least = space.model, points, np.inf
    anchor = start / model.scale
    for _ in range(20):
        reach = model.evaluate(points)
        lacking = model.lacking(reach, pose)
        way = float(np.sum((reach.scaled - anchor) ** 2))
        if _made(lacking) and float(model.margin(reach)) >= 0.0 and way < least - 1e-9:
            best, least = points, way
        step = model.step(reach, lacking, 5.0 * LEVEL, 1e-6, _PULL, anchor)
        if np.abs(step.move).max() < 1e-6:
            break
        points = points + _cut(step.move) * model.scale
    return best


def _best_condition(space: StackWorkspace, pose: StackPose, points: Floats) -> Floats:
    """Down the slope of the summed logarithms of the conditions, within the limits, while it gets better."""
    model, length = space.model, 0.3
    best, value = points, float(np.log(_conditions(space, points)).sum())
    for _ in range(6):
        slope = _condition_slope(space, best)
        slope /= max(float(np.abs(slope).max()), 1e-9)
        target = best / model.scale - length * slope
        tried = best
        for _ in range(3):
            reach = model.evaluate(tried)
            step = model.step(reach, model.lacking(reach, pose), LEVEL, 1e-6, _PULL, target)
            tried = tried + _cut(step.move) * model.scale
        reach = model.evaluate(tried)
        kept = _made(model.lacking(reach, pose)) and float(model.margin(reach)) >= 0.0
        now = float(np.log(_conditions(space, tried)).sum()) if kept else np.inf
        if now < value - 1e-6:
            best, value = tried, now
        else:
            length *= 0.4
    return best


def _conditions(space: StackWorkspace, points: Floats) -> Floats:
    """Of every platform, (..., P)."""
    each = [
        condition(servo_jacobian(points[..., i, :], platform), platform)
        for i, platform in enumerate(space.dimensions.platforms)
    ]
    return np.stack(each, axis=-1)


def _condition_slope(space: StackWorkspace, points: Floats) -> Floats:
    """Of the logarithm of each platform's condition by its scaled set point, (P, 6)."""
    h = 1e-4
    shifts = np.concatenate([np.eye(6), -np.eye(6)])[:, None, :] * h
    logs = np.log(_conditions(space, points + shifts * space.model.scale))
    return np.asarray((logs[:6] - logs[6:]).T / (2.0 * h))
