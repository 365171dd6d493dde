"""What a platform and a stack can reach, in all six axes at once: membership, margin, nearest pose, samples.

One platform: its set point says it all, so membership is a look at its margins. The stack: a pose is reachable if any
set points of all its platforms together make it. There are 24 of them for six coordinates, so membership is a search
(`reach.ReachModel.step`, damped as Levenberg and Marquardt do) from a guess close by (`reach_guess`). It ends when set
points are found that make the pose within every limit (a proof), when guess and bound say that there are none, or when
its steps are used up. "No" is not proven: docs/rig-workspace.md measures how often it is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, LEGS
from bluerov_slam.rig.limits import (
    FO_SHIP_LIMITS,
    Limit,
    PlatformLimits,
    air_mm,
    checked_pose,
    checked_set_points,
    platform_margins,
)
from bluerov_slam.rig.platform import joints_mm
from bluerov_slam.rig.reach import ReachModel, rotation_vector
from bluerov_slam.rig.reach_guess import stored_guess
from bluerov_slam.rig.stack import StackPose, stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, PlatformDimensions, StackDimensions
    from bluerov_slam.rig.reach import Reach

MOST_STEPS, MOST_WITHOUT_GUESS = 18, 40
"""Of a search. Without a guess nothing but its end says no."""
LEVEL = 2e-3
"""Margin that plans and the largest margin aim at, so that they end inside and not on the limit."""
LONGEST_STEP = 0.7
SEARCH_LEVEL, KEPT = 5e-4, 0.3
"""What a search aims at; once inside, only that this share of its margin is kept while the pose is made."""
DAMPING, LEAST_DAMPING, STIFFER, SOFTER = 3e-4, 1e-5, 4.0, 0.4
"""Of a search: at the first step and at least; what it is multiplied by after a step that made things worse, better."""
_LACK = 0.01
"""What a lack of 100 mm, or of a radian, weighs against the squares of missing margins in what is better."""
FEW_STEPS, GUESSED_OUT, BOUND_OUT = 3, -0.002, -0.008
"""From so many steps on a search gives up if the guessed margin and the last two bounds are below these."""
MANY_STEPS, STILL_OUT = 7, -0.001
"""From so many on also if the last three bounds are below this, whatever the guess. All chosen on poses of seeds 11
and 12, not proven."""
_ABOVE, _RISE = 0.01, 0.05
"""How far above the bound, and faster than what, the level of the search for the largest margin is raised."""
_ROUNDING = 1e-9
PLACE_MM = 1e-3
TURN_RAD = 1e-5
"""A pose is made when the tool is this near."""
_WEIGHT = np.array([0.01, 0.01, 0.01, 1.0, 1.0, 1.0])
RADIAN_MM = 200.0
"""What a radian weighs against millimetres in "nearest": about the reach of the tool over the upper plates."""


@dataclass(frozen=True, slots=True)
class Found:
    """What a search in reach came to.

    Attributes:
        reached: whether set points were found that make the pose within every limit.
        set_points: they, or where the search ended, (P, 6).
        margin: least margin there, without unit, negative beyond a limit.
        bound: estimate from above of the largest margin.
    """

    reached: bool
    set_points: Floats
    margin: float
    bound: float


@dataclass(frozen=True, slots=True)
class Nearest:
    """The reachable pose next to a wished one.

    Attributes:
        pose: of the tool.
        set_points: that make it, (P, 6).
        place_mm: from the wished place.
        turn_rad: from the wished rotation.
        limit: what forbids to come nearer; None if the pose itself is reachable.
    """

    pose: StackPose
    set_points: Floats
    place_mm: float
    turn_rad: float
    limit: Limit | None

    @property
    def words(self) -> str:
        """For a person."""
        if self.limit is None:
            return "The pose can be reached."
        return (
            f"The pose cannot be reached: {self.limit.words}. The nearest that can be is {self.place_mm:.1f} mm and "
            f"{np.degrees(self.turn_rad):.1f} degrees away."
        )


class PlatformWorkspace:
    """The reachable set points of one platform."""

    def __init__(
        self, dimensions: PlatformDimensions = FO_SHIP_PLATFORM, limits: PlatformLimits = FO_SHIP_LIMITS
    ) -> None:
        self.dimensions, self.limits = dimensions, limits

    def reaches(self, set_point: Floats) -> bool:
        """Whether a set point (6,) keeps every limit."""
        return self.broken(set_point) is None

    def broken(self, set_point: Floats) -> Limit | None:
        """The limit that a set point (6,) breaks."""
        return platform_margins(checked_set_points(set_point), self.dimensions, self.limits).broken()

    def nearest(self, set_point: Floats) -> Floats:
        """The last reachable set point on the way from home, (6,), to a millionth of the way."""
        wished = checked_set_points(set_point)
        near, far = 0.0, 1.0
        if self.reaches(wished):
            return wished
        while far - near > 1e-6:
            middle = 0.5 * (near + far)
            near, far = (middle, far) if self.reaches(middle * wished) else (near, middle)
        return near * wished

    def sample(self, count: int, seed: int) -> Floats:
        """Reachable set points (count, 6), even over the reachable part of the box of the axis limits."""
        if self.limits.axes is None:
            raise ValueError("sampling needs axis limits: without them the reachable set has no box around it")
        random, box = np.random.default_rng(seed), self.limits.axis_array()
        kept: list[Floats] = []
        while sum(map(len, kept)) < count:
            drawn = random.uniform(-box, box, (max(64, 2 * count), 6))
            kept.append(drawn[platform_margins(drawn, self.dimensions, self.limits).allowed])
        return np.concatenate(kept)[:count]


class StackWorkspace:
    """The reachable poses of a stack's tool."""

    def __init__(
        self,
        dimensions: StackDimensions = FO_SHIP,
        limits: PlatformLimits | tuple[PlatformLimits, ...] = FO_SHIP_LIMITS,
    ) -> None:
        self.model = ReachModel(dimensions, limits)
        self.dimensions, self.limits = dimensions, self.model.limits
        self._guess = stored_guess(self.model)

    def reaches(self, pose: StackPose) -> bool:
        """Whether set points are found that make this pose within all limits: yes is a proof, no is not."""
        return self.find(pose).reached

    def find(self, pose: StackPose, start: Floats | None = None) -> Found:
        """Search set points that make this pose within all limits."""
        pose = StackPose(*checked_pose(pose.position_mm, pose.rotation))
        if start is None:
            return self._search(pose, *self._begin(pose))
        return self._search(pose, checked_set_points(start), np.inf)

    def margin(self, pose: StackPose) -> float:
        """The largest least margin of all set points that make this pose: without unit, negative out of reach."""
        return self.safest(pose).margin

    def safest(self, pose: StackPose, start: Floats | None = None, steps: int = 30) -> Found:
        """The set points that make this pose with the largest margin."""
        pose = StackPose(*checked_pose(pose.position_mm, pose.rotation))
        points = self.start(pose) if start is None else checked_set_points(start)
        model, level, bound = self.model, LEVEL, np.inf
        best, margin = points, -np.inf
        for k in range(steps):
            reach = model.evaluate(points)
            lacking, least = model.lacking(reach, pose), float(model.margin(reach))
            if least > margin and np.abs(lacking[:3]).max() < 50.0 * PLACE_MM:
                best, margin = points, least
            step = model.step(reach, lacking, level)
            # Just above what there is: the hinges then share what is short. Closer towards the end.
            above = _ABOVE if k < steps // 2 else 0.3 * _ABOVE
            bound = float(step.bound)
            level = min(bound + above, level + _RISE) if np.isfinite(bound) else max(least, level) + _RISE
            points = points + _cut(step.move) * model.scale
        for _ in range(4):
            reach = model.evaluate(best)
            lacking = model.lacking(reach, pose)
            if _made(lacking):
                break
            best = best + _cut(model.step(reach, lacking, max(margin, LEVEL)).move) * model.scale
        reach = model.evaluate(best)
        made = _made(model.lacking(reach, pose))
        margin = float(model.margin(reach)) if made else min(margin, bound, -_ROUNDING)
        return Found(bool(made and margin >= 0.0 and self._clear(best)), best, margin, bound)

    def nearest(self, pose: StackPose) -> Nearest:
        """The reachable pose next to this one, a radian weighed as 200 mm, with the limit that is in the way."""
        pose = StackPose(*checked_pose(pose.position_mm, pose.rotation))
        found = self._search(pose, *self._begin(pose))
        if found.reached:
            return Nearest(pose, found.set_points, 0.0, 0.0, None)
        # Each start has a best of its own, one often far nearer than the others.
        starts = (found.set_points, self.start(pose), np.zeros(found.set_points.shape))
        ends = [self._approach(pose, start) for start in starts]
        points = min(ends, key=lambda end: self._distance_mm(pose, end))
        reach = self.model.evaluate(points)
        lacking = self.model.lacking(reach, pose)
        place, turn = float(np.linalg.norm(lacking[:3])), float(np.linalg.norm(lacking[3:]))
        return Nearest(StackPose(reach.position_mm, reach.rotation), points, place, turn, self._in_the_way(points))

    def sample(self, count: int, seed: int) -> tuple[Floats, StackPose]:
        """Reachable poses (count,) and the set points that make them, (count, P, 6).

        Every platform's set point is even over what it can reach, independent of the others: the poses are the sum of
        four such draws, dense in the middle and thin towards the edge.
        """
        seeds = np.random.SeedSequence(seed).generate_state(self.model.count)
        drawn = [
            PlatformWorkspace(platform, limits).sample(count, int(one))
            for platform, limits, one in zip(self.dimensions.platforms, self.limits, seeds, strict=True)
        ]
        points = np.stack(drawn, axis=1)
        return points, stack_pose(points, self.dimensions)

    def start(self, pose: StackPose) -> Floats:
        """Set points to search from: the guess, or an equal share of the turn for each platform."""
        return self._begin(pose)[0]

    def _begin(self, pose: StackPose) -> tuple[Floats, float]:
        """Set points to search from, and what margin to hope for."""
        if self._guess is not None:
            points, hope = self._guess(pose)
            return points, float(hope)
        points = np.zeros((self.model.count, 6))
        points[:, 3:] = rotation_vector(pose.rotation) / self.model.count
        return np.clip(points, -self.model.scale, self.model.scale), np.inf

    def _search(self, pose: StackPose, points: Floats, hope: float) -> Found:
        model, damping, before = self.model, DAMPING, np.inf
        bounds, margin, guessed = (np.inf,) * 3, -np.inf, bool(np.isfinite(hope))
        for k in range(MOST_STEPS if guessed else MOST_WITHOUT_GUESS):
            reach = model.evaluate(points)
            lacking = model.lacking(reach, pose)
            margin = float(model.margin(reach))
            if margin >= 0.0 and _made(lacking) and self._clear(points):
                return Found(True, points, margin, max(bounds[0], margin))
            now = model.missing(reach, SEARCH_LEVEL) + _LACK * float(np.abs(lacking) @ _WEIGHT)
            if k:
                damping = max(damping * (STIFFER if now > before else SOFTER), LEAST_DAMPING)
            before = now
            level = min(SEARCH_LEVEL, KEPT * margin) if margin > 0.0 else SEARCH_LEVEL
            step = model.step(reach, lacking, level, damping)
            bounds = (float(step.bound), *bounds[:2])
            points = points + _cut(step.move) * model.scale
            early = k + 1 >= FEW_STEPS and hope < GUESSED_OUT and max(bounds[:2]) < BOUND_OUT
            late = k + 1 >= MANY_STEPS and max(bounds) < STILL_OUT
            if guessed and (early or late):
                break
        return Found(False, points, margin, bounds[0])

    def _approach(self, pose: StackPose, points: Floats) -> Floats:
        """Least distance to the pose within the limits, by a penalty on what passes them; then drawn inside."""
        model = self.model
        weight = np.array([1.0, 1.0, 1.0, RADIAN_MM, RADIAN_MM, RADIAN_MM]) / RADIAN_MM
        stiff, level = 30.0, 2.0 * LEVEL
        size = 6 * model.count
        for _ in range(60):
            reach = model.evaluate(points)
            lacking = model.lacking(reach, pose) * weight
            tool = (reach.tool_by.reshape(size, 6) * weight).T
            short, slope = _short(model, reach, level)
            system = tool.T @ tool + stiff**2 * slope.T @ slope + 1e-4 * np.eye(size)
            right = tool.T @ lacking + stiff**2 * slope.T @ short
            move = _cut(np.asarray(np.linalg.solve(system, right)).reshape(-1, 6))
            points = points + move * model.scale
            if np.abs(move).max() < 1e-5:
                break
        if float(model.margin(model.evaluate(points))) >= 0.0 and self._clear(points):
            return points
        inside, outside = 0.0, 1.0
        while outside - inside > 1e-6:
            share = 0.5 * (inside + outside)
            good = float(model.margin(model.evaluate(share * points))) >= 0.0 and self._clear(share * points)
            inside, outside = (share, outside) if good else (inside, share)
        return inside * points

    def _distance_mm(self, pose: StackPose, points: Floats) -> float:
        lacking = self.model.lacking(self.model.evaluate(points), pose)
        return float(np.hypot(np.linalg.norm(lacking[:3]), RADIAN_MM * np.linalg.norm(lacking[3:])))

    def _in_the_way(self, points: Floats) -> Limit:
        """Of set points on the edge: the limit of the least margin."""
        reach = self.model.evaluate(points)
        legs = np.swapaxes(reach.legs.reshape(-1, LEGS, 3), -1, -2)
        axis = float((self.model.ranges - np.abs(reach.scaled)).min())
        least = {Limit.AXIS: axis, Limit.JOINT: float(legs[:, 2].min())}
        for kind in (0, 1):
            platform, leg = np.unravel_index(int(np.argmin(legs[:, kind])), (self.model.count, LEGS))
            limit = self._servo_or_root(points, int(platform), int(leg), kind)
            least[limit] = min(least.get(limit, np.inf), float(legs[platform, kind, leg]))
        if not self._clear(points, spare_mm=0.5):
            return self._touching(points)
        return min(least, key=lambda limit: least[limit])

    def _servo_or_root(self, points: Floats, platform: int, leg: int, kind: int) -> Limit:
        margins = platform_margins(points[platform], self.dimensions.platforms[platform], self.limits[platform])
        del leg, kind
        return Limit.SERVO if float(margins.servo_rad) < 0.02 else Limit.REACH

    def _clear(self, points: Floats, spare_mm: float = 0.0) -> bool:
        """Whether no rod touches another or an arm."""
        platforms, limits = self.dimensions.platforms, self.limits
        if all(one is platforms[0] for one in platforms) and all(one is limits[0] for one in limits):
            each = [air_mm(joints_mm(points, platforms[0]), limits[0])]
        else:
            each = [air_mm(joints_mm(q, one), limit) for q, one, limit in zip(points, platforms, limits, strict=True)]
        return all(bool(legs.min() >= spare_mm and arms.min() >= spare_mm) for legs, arms in each)

    def _touching(self, points: Floats) -> Limit:
        for point, platform, limits in zip(points, self.dimensions.platforms, self.limits, strict=True):
            if float(platform_margins(point, platform, limits).legs_mm) < 0.5:
                return Limit.LEGS
        return Limit.ARMS


def _made(lacking: Floats) -> bool:
    return bool(np.abs(lacking[:3]).max() < PLACE_MM and np.abs(lacking[3:]).max() < TURN_RAD)


def _cut(move: Floats, longest: float = LONGEST_STEP) -> Floats:
    largest = float(np.abs(move).max())
    return move * (longest / largest) if largest > longest else move


def _short(model: ReachModel, reach: Reach, level: float) -> tuple[Floats, Floats]:
    """What is missing to the level of the margins below it, and how they grow with all scaled set points."""
    rows, short = [], []
    for i in range(model.count):
        for value, slope in zip(reach.legs[i], reach.legs_by[i], strict=True):
            if value < level:
                row = np.zeros(6 * model.count)
                row[6 * i : 6 * i + 6] = slope
                rows.append(row)
                short.append(level - value)
        for k in range(6):
            room = model.ranges[i, k] - abs(reach.scaled[i, k])
            if room < level:
                row = np.zeros(6 * model.count)
                row[6 * i + k] = -np.sign(reach.scaled[i, k])
                rows.append(row)
                short.append(level - room)
    return np.array(short), np.array(rows).reshape(-1, 6 * model.count)
