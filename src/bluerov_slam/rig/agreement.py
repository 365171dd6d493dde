"""How far the fast membership test of a stack can be trusted: the same question put to a slow planner, near the edge.

The slow planner searches from many starts (home, equal shares, drawn at random) with many steps. A pose is reachable if
any search ends within all limits: found set points are a proof, whoever finds them. Nothing proves that a pose is out
of reach; with all starts failing it is taken to be.

"Near the edge": rays from home in random directions of all six coordinates (each weighed by its spread among reachable
poses), the edge on each found by halving with the slow planner; then poses at a share of the way to the edge that is
even within 1 - band .. 1 + band.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.reach import ReachModel, rotation_from_vector, rotation_vector
from bluerov_slam.rig.stack import StackPose, stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats
    from bluerov_slam.rig.workspace import StackWorkspace

Flags = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

SPREAD = np.array([84.0, 86.0, 37.0, 0.28, 0.28, 0.106])
"""Of x, y, z (mm) and turns (rad) among the poses of `StackWorkspace.sample`."""
STARTS = 20
STEPS = 90
FURTHEST = 10.0
"""No reachable pose of FO_SHIP lies so many spreads from home."""
_MADE = np.array([1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5])
_LEVEL = 5e-4
_LONGEST = 0.7


def slow_search(
    model: ReachModel, poses: StackPose, starts: int = STARTS, steps: int = STEPS, seed: int = 0
) -> tuple[Flags, Floats]:
    """Whether each pose (n,) is reachable, and set points that show it (n, P, 6), NaN where none were found."""
    count = len(poses.position_mm)
    found = np.full((count, model.count, 6), np.nan)
    open_ = np.arange(count)
    for k in range(starts):
        wanted = StackPose(poses.position_mm[open_], poses.rotation[open_])
        points = _start(model, wanted, k, seed)
        done, points = descend(model, wanted, points, steps)
        found[open_[done]] = points[done]
        open_ = open_[~done]
        if not len(open_):
            break
    return np.isfinite(found[:, 0, 0]), found


def descend(model: ReachModel, poses: StackPose, points: Floats, steps: int) -> tuple[Flags, Floats]:
    """Hinge steps of all poses at once until each is made within all limits."""
    done = np.zeros(len(points), dtype=bool)
    active = np.arange(len(points))
    for _ in range(steps):
        wanted = StackPose(poses.position_mm[active], poses.rotation[active])
        reach = model.evaluate(points[active])
        lacking = model.lacking(reach, wanted)
        good = (model.margin(reach) >= 0.0) & (np.abs(lacking) < _MADE).all(axis=-1)
        done[active[good]] = True
        step = model.step(reach, lacking, _LEVEL)
        largest = np.abs(step.move).max(axis=(-1, -2), keepdims=True)
        move = step.move * np.minimum(1.0, _LONGEST / np.maximum(largest, 1e-12))
        active = active[~good]
        if not len(active):
            break
        points[active] += move[~good] * model.scale
    return done, points


@dataclass(frozen=True, slots=True)
class NearEdge:
    """Poses on rays: share of the way from home to the edge (n,), what the slow planner says of them, its proofs."""

    poses: StackPose
    share: Floats
    reachable: Flags


def near_edge(model: ReachModel, count: int, seed: int, band: float = 0.05) -> NearEdge:
    """Poses within a band around the edge, evenly; seed fixed, poses fixed."""
    random = np.random.default_rng(seed)
    rays = random.normal(size=(count, 6))
    rays *= SPREAD / np.linalg.norm(rays, axis=1)[:, None]
    near, far = np.zeros(count), np.full(count, FURTHEST)
    for _ in range(12):
        middle = 0.5 * (near + far)
        inside, _ = slow_search(model, on_rays(model, rays, middle), 2, 30)
        near, far = np.where(inside, middle, near), np.where(inside, far, middle)
    share = random.uniform(1.0 - band, 1.0 + band, count)
    poses = on_rays(model, rays, share * 0.5 * (near + far))
    reachable, _ = slow_search(model, poses)
    return NearEdge(poses, share, reachable)


def on_rays(model: ReachModel, rays: Floats, lengths: Floats) -> StackPose:
    """Poses (n,) at lengths (n,) along rays (n, 6) from home: place along a line, turn about one axis."""
    home = stack_pose(np.zeros((model.count, 6)), model.dimensions)
    way = rays * lengths[:, None]
    return StackPose(home.position_mm + way[:, :3], rotation_from_vector(way[:, 3:]))


@dataclass(frozen=True, slots=True)
class Agreement:
    """Of how many poses, how often the fast test said yes to what is out of reach and no to what is not."""

    count: int
    false_yes: int
    false_no: int

    @property
    def share(self) -> float:
        """On which both say the same."""
        return 1.0 - (self.false_yes + self.false_no) / self.count


def agreement(workspace: StackWorkspace, sample: NearEdge) -> Agreement:
    """The fast test against the slow planner."""
    poses = sample.poses
    answers = np.array(
        [workspace.reaches(StackPose(p, r)) for p, r in zip(poses.position_mm, poses.rotation, strict=True)]
    )
    return Agreement(len(answers), int((answers & ~sample.reachable).sum()), int((~answers & sample.reachable).sum()))


def _start(model: ReachModel, poses: StackPose, kind: int, seed: int) -> Floats:
    points = np.zeros((len(poses.position_mm), model.count, 6))
    if kind == 0:
        points[..., 3:] = rotation_vector(poses.rotation)[:, None, :] / model.count
    elif kind > 1:
        drawn = np.random.default_rng((seed, kind)).uniform(-0.8, 0.8, points.shape)
        points = drawn * model.scale
    return points
