"""The limits of a stack as smooth functions of its set points, with derivatives: what every search in reach works on.

Per leg three margins: under the highest servo angle (or the root), over the lowest (or the root), tilt of the plate's
ball joint (the sine's; the joint at the arm never leans further in FO_SHIP). Per axis 1 - |set point| / limit. All are
without unit, positive inside, of the order of one at home. Set points are scaled by their axis limits, so that a step
of one is the whole range of an axis.

A step of the search (hinge Gauss-Newton): with e what the tool still lacks, F its derivative, g and G the margins below
a level and theirs, least |level - g - G d|^2 + damping |d|^2 with F d = e. G couples no two platforms, so six by six
blocks and one six by six system for the multipliers do it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import LEGS, AxisLimits
from bluerov_slam.rig.limits import PlatformLimits, servo_axes

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, PlatformDimensions, StackDimensions
    from bluerov_slam.rig.stack import StackPose

LEG_MARGINS = 3 * LEGS
ROUNDS = 6
"""Rounds of one step that look for the margins in its way; more change nothing."""
_STEEPEST = 1e-3
"""Least share of the rod along the arm's travel in a derivative: it is zero at the root."""


@dataclass(frozen=True, slots=True)
class Reach:
    """Margins and the tool of set points (..., P, 6), and by scaled set point their derivatives if asked for.

    Attributes:
        legs: margins of the legs, (..., P, 18).
        scaled: set points over their scale, (..., P, 6).
        position_mm: of the tool, (..., 3).
        rotation: of the tool, (..., 3, 3).
        legs_by: derivative of `legs`, (..., P, 18, 6).
        tool_by: derivative of the tool's place and turn, transposed, (..., P, 6, 6): set point, then output.
    """

    legs: Floats
    scaled: Floats
    position_mm: Floats
    rotation: Floats
    legs_by: Floats
    tool_by: Floats


class ReachModel:
    """A stack with its limits, put into arrays once."""

    def __init__(self, dimensions: StackDimensions, limits: PlatformLimits | tuple[PlatformLimits, ...]) -> None:
        platforms = dimensions.platforms
        each = (limits,) * len(platforms) if isinstance(limits, PlatformLimits) else limits
        if len(each) != len(platforms):
            raise ValueError(f"{len(each)} limits for {len(platforms)} platforms")
        self.dimensions, self.limits = dimensions, each
        self.count = len(platforms)
        self.scale = np.array([(limit.axes or AxisLimits()).array() for limit in each])
        self.ranges = np.array([limit.axis_array() for limit in each]) / self.scale
        self.bounded = bool(np.isfinite(self.ranges).all())
        bearing = _stacked(platforms, "arm_bearings_rad")
        self._level = np.stack([np.cos(bearing), np.sin(bearing), 0.0 * bearing])  # (3, P, 6)
        self._bolt = np.moveaxis(np.array([servo_axes(p) for p in platforms]), -1, 0).copy()
        self._joints = np.moveaxis(_stacked(platforms, "plate_joints_mm"), -1, -2).copy()  # (P, 3, 6)
        home = np.array([0.0, 0.0, -1.0])[:, None] * np.array([p.home_height_mm for p in platforms])
        self._origin = home[:, :, None] - np.moveaxis(_stacked(platforms, "base_joints_mm"), -1, 0)
        self._arm, self._rod = _stacked(platforms, "arm_mm"), _stacked(platforms, "rod_mm")
        self._twice_arm, self._shift = 2.0 * self._arm, self._arm**2 - self._rod**2
        self._high = np.array([np.broadcast_to(limit.highest_servo_rad, LEGS) for limit in each])
        self._low = np.array([np.broadcast_to(limit.lowest_servo_rad, LEGS) for limit in each])
        self._tilt = np.sin([limit.joint_tilt_rad for limit in each])[:, None]
        self._lift = dimensions.base_mm + home.T
        self._bolts_turning = np.concatenate([self._joints, np.moveaxis(self._bolt, 0, 1)], axis=-1)

    def evaluate(self, set_points: Floats) -> Reach:
        """At set points (..., P, 6)."""
        q = set_points
        lead = q.shape[:-1]
        sines, cosines = np.sin(q[..., 3:]), np.cos(q[..., 3:])
        turn, axes = _turns(sines, cosines)
        turned = np.moveaxis(turn @ self._bolts_turning, -2, 0)  # (3, ..., P, 12)
        arms_at, bolt = turned[..., :LEGS], turned[..., LEGS:]
        x = arms_at + (np.moveaxis(q[..., :3], -1, 0)[..., None] + _lead(self._origin, q))
        level = _lead(self._level, q)
        a, c = level[0] * x[0] + level[1] * x[1], -x[2]
        flat2 = a * a + c * c
        flat = np.sqrt(flat2)
        k = self._shift + (x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        ratio = k / (self._twice_arm * flat)
        phi = np.arctan2(c, a)
        over, under = np.maximum(phi - self._high, 0.0), np.minimum(phi - self._low, np.pi)
        theta = phi - np.arccos(np.minimum(np.maximum(ratio, -1.0), 1.0))
        ct, st = np.cos(theta), np.sin(theta)
        rod = x - self._arm * ct * level
        rod[2] += self._arm * st
        lean = (rod[0] * bolt[0] + rod[1] * bolt[1] + rod[2] * bolt[2]) / self._rod
        side = np.sign(lean)
        legs = np.empty((*lead, LEG_MARGINS))
        legs[..., :LEGS] = np.cos(over) - ratio
        legs[..., LEGS : 2 * LEGS] = ratio - np.cos(under)
        legs[..., 2 * LEGS :] = self._tilt - side * lean

        # Derivatives by the plate joint's place, then by the plate's turn: g(x) turns by arm x gradient.
        slopes = np.empty((3, 3, *lead, LEGS))  # coordinate, kind of margin
        in_plane = a * level
        in_plane[2] -= c
        ratio_by = x / (self._arm * flat) - (ratio / flat2) * in_plane
        phi_by = (-c / flat2) * level
        phi_by[2] -= a / flat2
        slopes[:, 0] = -np.sin(over) * phi_by - ratio_by
        slopes[:, 1] = ratio_by + np.sin(under) * phi_by
        # travel of the arm's end: level -sin, up cos
        along = -st * (level[0] * rod[0] + level[1] * rod[1]) - ct * rod[2]
        least = _STEEPEST * self._rod
        along = np.where(np.abs(along) < least, least, along)
        bolt_travel = -st * (level[0] * bolt[0] + level[1] * bolt[1]) - ct * bolt[2]
        slopes[:, 2] = (-side / self._rod) * (bolt - (bolt_travel / along) * rod)
        joint = arms_at[:, None]
        turns = _cross(joint, slopes)
        turns[:, 2] += _cross(bolt, (-side / self._rod) * rod)
        by = np.empty((6, 3, *lead, LEGS))
        by[:3] = slopes
        roll, pitch = axes
        by[3] = _wide(roll[0]) * turns[0] + _wide(roll[1]) * turns[1] + _wide(roll[2]) * turns[2]
        by[4] = _wide(pitch[0]) * turns[0] + _wide(pitch[1]) * turns[1]
        by[5] = turns[2]
        legs_by = np.moveaxis(by, (0, 1), (-1, -3)).reshape(*lead, LEG_MARGINS, 6) * self.scale[:, None, :]
        position, rotation, tool_by = self._tool(q, turn, pitch)
        return Reach(legs, q / self.scale, position, rotation, legs_by, tool_by)

    def margin(self, reach: Reach) -> Floats:
        """The least margin of all, (...,)."""
        least = reach.legs.min(axis=(-1, -2))
        if self.bounded:
            least = np.minimum(least, (self.ranges - np.abs(reach.scaled)).min(axis=(-1, -2)))
        return np.asarray(least)

    def lacking(self, reach: Reach, pose: StackPose) -> Floats:
        """Place (mm) and turn (rad, rig frame) from the tool to a pose, (..., 6)."""
        found = np.empty((*reach.position_mm.shape[:-1], 6))
        found[..., :3] = pose.position_mm - reach.position_mm
        found[..., 3:] = rotation_vector(pose.rotation @ np.swapaxes(reach.rotation, -1, -2))
        return found

    def step(
        self,
        reach: Reach,
        lacking: Floats,
        level: Floats | float,
        damping: float = 1e-3,
        pull: float = 0.0,
        anchor: Floats | float = 0.0,
        rounds: int = ROUNDS,
    ) -> Step:
        """Towards the pose and all margins above the level; `pull` also towards the anchor, scaled set points.

        Which margins are short after the step is found in rounds: each takes those short after the one before.
        """
        if reach.scaled.ndim == 2 and pull == 0.0:
            return self._step_of_one(reach, lacking, float(level), damping, rounds)
        level = np.asarray(level)[..., None, None] if np.ndim(level) else level
        lead = reach.scaled.shape[:-2]
        flat = (*lead, 6 * self.count)
        tool = reach.tool_by.reshape(*flat, 6)
        whole = np.swapaxes(tool, -1, -2)
        missing, room = level - reach.legs, self.ranges - level
        across = np.swapaxes(reach.legs_by, -1, -2)
        index = np.arange(6)
        system = np.empty((*reach.scaled.shape, 7))
        system[..., :6] = reach.tool_by
        short = missing > 0.0
        beyond = np.abs(reach.scaled) > room
        side = np.sign(reach.scaled)
        pulled = pull * (anchor - reach.scaled)
        move = np.zeros(reach.scaled.shape)
        legs, scaled = reach.legs, reach.scaled
        for _ in range(rounds):
            weighed = across * short[..., None, :]
            blocks = weighed @ reach.legs_by
            blocks[..., index, index] += damping + pull + beyond
            inward = np.where(beyond, side * room - reach.scaled, 0.0)
            system[..., 6] = (weighed @ missing[..., None])[..., 0] + inward + pulled
            solved = np.linalg.solve(blocks, system)
            gain = solved[..., :6].reshape(*flat, 6)
            free = solved[..., 6].reshape(flat)
            want = lacking - (whole @ free[..., None])[..., 0]
            forces = np.linalg.solve(whole @ gain, want[..., None])
            move = ((gain @ forces)[..., 0] + free).reshape(reach.scaled.shape)
            legs = reach.legs + (reach.legs_by @ move[..., None])[..., 0]
            scaled = reach.scaled + move
            now_short, now_beyond, now_side = legs < level, np.abs(scaled) > room, np.sign(scaled)
            if (now_short == short).all() and (now_beyond == beyond).all():
                break
            short, beyond, side = now_short, now_beyond, now_side
        # What stays short weighs the margins into a bound from above, if the problem were linear.
        axes = self.ranges - np.abs(scaled)
        short_legs = np.maximum(level - legs, 0.0)
        short_axes = np.maximum(level - axes, 0.0)
        weight = short_legs.sum(axis=(-1, -2)) + short_axes.sum(axis=(-1, -2))
        weighted = (short_legs * legs).sum(axis=(-1, -2))
        if self.bounded:
            weighted = weighted + (short_axes * axes).sum(axis=(-1, -2))
        bound = np.where(weight > 1e-9, weighted / np.maximum(weight, 1e-12), np.inf)
        return Step(move, bound)

    def _step_of_one(self, reach: Reach, lacking: Floats, level: float, damping: float, rounds: int) -> Step:
        """`step` of one pose in fewer calls: multipliers of the pose and of the short margins at once.

        With A the rows of F and G, least squares is (A A' + damping on G's) l = (e, level - g), d = A' l.
        """
        size = 6 * self.count
        legs0, scaled0 = reach.legs.ravel(), reach.scaled.ravel()
        apart = np.zeros((self.count, LEG_MARGINS, self.count, 6))
        for i in range(self.count):
            apart[i, :, i] = reach.legs_by[i]
        slopes = apart.reshape(-1, size)
        pose_by, unit = reach.tool_by.reshape(size, 6).T, np.eye(size)
        room, ranges = self.ranges.ravel() - level, self.ranges.ravel()
        missing = level - legs0
        legs, scaled = legs0, scaled0
        short, beyond = missing > 0.0, np.abs(scaled0) > room
        side = np.sign(scaled0)
        move = np.zeros(size)
        for _ in range(rounds):
            rows = np.concatenate([pose_by, slopes[short], unit[beyond]])
            wanted = np.concatenate([lacking, missing[short], (side * room - scaled0)[beyond]])
            system = rows @ rows.T
            system.reshape(-1)[6 * (len(rows) + 1) :: len(rows) + 1] += damping
            move = np.linalg.solve(system, wanted) @ rows
            legs, scaled = legs0 + slopes @ move, scaled0 + move
            now_short, now_beyond = legs < level, np.abs(scaled) > room
            if np.array_equal(now_short, short) and np.array_equal(now_beyond, beyond):
                break
            short, beyond, side = now_short, now_beyond, np.sign(scaled)
        axes = ranges - np.abs(scaled)
        short_legs, short_axes = np.maximum(level - legs, 0.0), np.maximum(level - axes, 0.0)
        weight = float(short_legs.sum() + short_axes.sum())
        weighted = float(short_legs @ legs) + (float(short_axes @ axes) if self.bounded else 0.0)
        bound = weighted / weight if weight > 1e-9 else np.inf
        return Step(move.reshape(-1, 6), np.asarray(bound))

    def _tool(self, q: Floats, turn: Floats, pitch: tuple[Floats, Floats]) -> tuple[Floats, Floats, Floats]:
        beneath = np.empty(turn.shape)
        top = np.empty(turn.shape)
        beneath[..., 0, :, :] = np.eye(3)
        top[..., 0, :, :] = turn[..., 0, :, :]
        for i in range(1, self.count):
            beneath[..., i, :, :] = top[..., i - 1, :, :]
            np.matmul(top[..., i - 1, :, :], turn[..., i, :, :], out=top[..., i, :, :])
        rises = (beneath @ (self._lift + q[..., :3])[..., None])[..., 0]
        plates = np.cumsum(rises, axis=-2) + self.dimensions.foot_mm
        rotation = top[..., -1, :, :]
        position = plates[..., -1, :] + rotation @ self.dimensions.tool_mm
        lever = position[..., None, :] - plates
        axes = np.empty(turn.shape)  # (..., P, axis, coordinate)
        axes[..., 0, :] = top[..., :, 0]
        axes[..., 1, :] = beneath[..., :, 0] * pitch[0][..., None] + beneath[..., :, 1] * pitch[1][..., None]
        axes[..., 2, :] = beneath[..., :, 2]
        by = np.zeros((*turn.shape[:-2], 6, 6))
        by[..., :3, :3] = np.swapaxes(beneath, -1, -2)
        by[..., 3:, 3:] = axes
        by[..., 3:, :3] = np.moveaxis(_cross(np.moveaxis(axes, -1, 0), np.moveaxis(lever, -1, 0)[..., None]), 0, -1)
        by *= self.scale[..., None]
        return position, rotation, by


@dataclass(frozen=True, slots=True)
class Step:
    """Change of the scaled set points, (..., P, 6), and the largest margin there is to first order, (...,).

    The bound is a weighted mean of margins, all of which can only rise together up to it; infinite if nothing is short.
    """

    move: Floats
    bound: Floats


def rotation_vector(rotation: Floats) -> Floats:
    """Axis times angle, (..., 3); for less than half a turn."""
    twice = np.empty(rotation.shape[:-1])
    twice[..., 0] = rotation[..., 2, 1] - rotation[..., 1, 2]
    twice[..., 1] = rotation[..., 0, 2] - rotation[..., 2, 0]
    twice[..., 2] = rotation[..., 1, 0] - rotation[..., 0, 1]
    sine = 0.5 * np.sqrt((twice * twice).sum(axis=-1))
    cosine = 0.5 * (rotation[..., 0, 0] + rotation[..., 1, 1] + rotation[..., 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-9, 0.5 * angle / np.maximum(sine, 1e-12), 0.5)
    return np.asarray(factor[..., None] * twice)


def rotation_from_vector(vector: Floats) -> Floats:
    """Rodrigues: (..., 3) to (..., 3, 3)."""
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    small = np.maximum(angle, 1e-12)
    skew = np.zeros((*vector.shape, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -z, y, -x
    skew[..., 1, 0], skew[..., 2, 0], skew[..., 2, 1] = z, -y, x
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * skew + (1.0 - np.cos(small)) / small**2 * skew @ skew)


def _turns(
    sines: Floats, cosines: Floats
) -> tuple[Floats, tuple[tuple[Floats, Floats, Floats], tuple[Floats, Floats]]]:
    """Rz Ry Rx, (..., 3, 3), and the axes of roll and of pitch in the frame beneath."""
    sr, sp, sy = sines[..., 0], sines[..., 1], sines[..., 2]
    cr, cp, cy = cosines[..., 0], cosines[..., 1], cosines[..., 2]
    turn = np.empty((*sr.shape, 3, 3))
    x0, x1 = cy * cp, sy * cp
    cysp, sysp = cy * sp, sy * sp
    turn[..., 0, 0], turn[..., 1, 0], turn[..., 2, 0] = x0, x1, -sp
    turn[..., 0, 1], turn[..., 1, 1], turn[..., 2, 1] = cysp * sr - sy * cr, sysp * sr + cy * cr, cp * sr
    turn[..., 0, 2], turn[..., 1, 2], turn[..., 2, 2] = cysp * cr + sy * sr, sysp * cr - cy * sr, cp * cr
    return turn, ((x0, x1, -sp), (-sy, cy))


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product of vectors whose coordinates run along the first axis."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _stacked(platforms: tuple[PlatformDimensions, ...], name: str) -> Floats:
    return np.array([getattr(platform, name) for platform in platforms])


def _wide(values: Floats) -> Floats:
    """Values of platforms for all their legs."""
    return values[..., None]


def _lead(values: Floats, q: Floats) -> Floats:
    """(3, P, 6) with room for the leading axes of q after the first."""
    return values.reshape(3, *(1,) * (q.ndim - 2), *values.shape[1:])
