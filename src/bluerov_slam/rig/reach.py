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
from math import atan2, sqrt
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.dimensions import LEGS, AxisLimits
from bluerov_slam.rig.limits import PlatformLimits, servo_axes

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, PlatformDimensions, StackDimensions
    from bluerov_slam.rig.stack import StackPose

LEG_MARGINS = 3 * LEGS
MONOMIALS = 27
_BY, _TOOL = 12 * LEGS, 12 * LEGS + 36 * LEGS
"""Where in the rows of `_of_monomials` derivatives begin, and where the rotation does."""
_SIDES = np.array([1.0, -1.0])[:, None, None]
_LEAST_OVER, _MOST_OVER = np.array([[0.0], [-np.inf]]), np.array([[np.inf], [np.pi]])
_UNIT = np.eye(3)
ROUNDS = 4
"""Rounds of one step that look for the margins in its way; more change nothing."""
_STEEPEST = 0.05
"""Least share of the rod along the arm's travel in a derivative: it is zero at the root."""


@dataclass(frozen=True, slots=True)
class Reach:
    """Margins and the tool of set points (..., P, 6), and by scaled set point their derivatives if asked for.

    Attributes:
        legs: margins of the legs, (..., P, 18): leg by leg its three.
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
        self._arm, self._rod = _stacked(platforms, "arm_mm"), _stacked(platforms, "rod_mm")
        self._twice_arm, self._shift = 2.0 * self._arm, self._arm**2 - self._rod**2
        ends = [(limit.highest_servo_rad, limit.lowest_servo_rad) for limit in each]
        self._ends = np.array([[np.broadcast_to(end, LEGS) for end in both] for both in ends])  # (P, 2, 6)
        self._tilt = np.sin([limit.joint_tilt_rad for limit in each])[:, None]
        home = np.array([0.0, 0.0, -1.0]) * np.array([p.home_height_mm for p in platforms])[:, None]
        self._lift = dimensions.base_mm + home
        self._linear = np.array([_of_monomials(*one) for one in zip(platforms, self.scale, strict=True)])
        # Margins of the axes, both ways, and room for those of the legs: what a step of one pose works on.
        size = 6 * self.count
        self._slopes = np.zeros((LEG_MARGINS * self.count + 2 * size, size))
        self._slopes[-2 * size :] = np.concatenate([-np.eye(size), np.eye(size)])

    def evaluate(self, set_points: Floats) -> Reach:
        """At set points (..., P, 6)."""
        q = set_points
        lead = q.shape[:-1]
        waves = np.ones((*lead, 3, 3))  # of roll, pitch, yaw: 1, cosine, sine
        np.cos(q[..., 3:], out=waves[..., 1])
        np.sin(q[..., 3:], out=waves[..., 2])
        given = np.empty((*lead, MONOMIALS + 3, 1))
        products = waves[..., 2, :, None] * waves[..., 1, None, :]
        given[..., :MONOMIALS, 0] = (products[..., None] * waves[..., 0, None, None, :]).reshape(*lead, MONOMIALS)
        given[..., MONOMIALS:, 0] = q[..., :3]
        made = (self._linear @ given)[..., 0]
        at = made[..., :_BY].reshape(*lead, 4, 3, LEGS)
        joint, bolt, plane, quarter = at[..., 0, :, :], at[..., 1, :, :], at[..., 2, :, :], at[..., 3, :, :]
        a, b, c = joint[..., 0, :], joint[..., 1, :], joint[..., 2, :]
        flat2 = a * a + c * c
        flat = np.sqrt(flat2)
        ratio = (self._shift + flat2 + b * b) / (self._twice_arm * flat)
        # Of the joint's direction over the highest angle and over the lowest, where they end short of the root.
        over = np.minimum(np.maximum(np.arctan2(c, a)[..., None, :] - self._ends, _LEAST_OVER), _MOST_OVER)
        cosine = np.minimum(np.maximum(ratio, -1.0), 1.0)
        sine = np.sqrt(1.0 - cosine * cosine)
        across, ahead = (sine / flat)[..., None, :], (cosine / flat)[..., None, :]
        rod = joint - self._arm[:, None] * (ahead * plane - across * quarter)
        travel = ahead * quarter + across * plane  # of the arm's end
        lean = np.einsum("...ij,...ij->...j", rod, bolt) / self._rod
        by_lean = (np.sign(lean) / -self._rod)[..., None, :]
        legs = np.empty((*lead, LEGS, 3))
        legs[..., :2] = np.swapaxes(_SIDES[:, 0] * (np.cos(over) - ratio[..., None, :]), -1, -2)
        legs[..., 2] = self._tilt - np.abs(lean)

        # Derivatives of each margin by the joint's place and by the bolt, seen from the arm: ahead, across, up.
        slopes = np.zeros((*lead, LEGS, 3, 6))
        ratio_by = joint * (1.0 / (self._arm * flat))[..., None, :] - plane * (ratio / flat2)[..., None, :]
        ends_by = (np.sin(over) / flat2[..., None, :])[..., None, :] * quarter[..., None, :, :]
        slopes[..., :2, :3] = (-_SIDES * (ends_by + ratio_by[..., None, :, :])).swapaxes(-1, -3).swapaxes(-1, -2)
        # How far the rod points along the arm's travel is zero at the root.
        share = np.einsum("...ij,...ij->...j", travel, bolt) / np.maximum(flat * sine, _STEEPEST * self._rod)
        slopes[..., 2, :3] = np.swapaxes(by_lean * (bolt - share[..., None, :] * rod), -1, -2)
        slopes[..., 2, 3:] = np.swapaxes(by_lean * rod, -1, -2)
        legs_by = slopes @ made[..., _BY:_TOOL].reshape(*lead, LEGS, 6, 6)
        shape = (*lead, LEG_MARGINS)
        position, rotation, tool_by = self._tool(q, made[..., _TOOL:].reshape(*lead, 6, 3))
        return Reach(legs.reshape(shape), q / self.scale, position, rotation, legs_by.reshape(*shape, 6), tool_by)

    def margin(self, reach: Reach) -> Floats:
        """The least margin of all, (...,)."""
        least = reach.legs.min(axis=(-1, -2))
        if self.bounded:
            least = np.minimum(least, (self.ranges - np.abs(reach.scaled)).min(axis=(-1, -2)))
        return np.asarray(least)

    def missing(self, reach: Reach, level: float) -> float:
        """Of one pose: the sum of squares of what its margins are short of a level."""
        legs = np.maximum(level - reach.legs, 0.0).ravel()
        axes = np.maximum(np.abs(reach.scaled) - (self.ranges - level), 0.0).ravel()
        return float(legs @ legs + axes @ axes)

    def lacking(self, reach: Reach, pose: StackPose) -> Floats:
        """Place (mm) and turn (rad, rig frame) from the tool to a pose, (..., 6)."""
        if reach.position_mm.ndim == 1:
            turn = _vector_of_one((pose.rotation @ reach.rotation.T).ravel().tolist())
            return np.concatenate([pose.position_mm - reach.position_mm, turn])
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
        slopes = self._slopes.copy()
        blocks = slopes[: LEG_MARGINS * self.count].reshape(self.count, LEG_MARGINS, self.count, 6)
        np.einsum("iaib->iab", blocks)[...] = reach.legs_by
        margins = np.concatenate(
            [reach.legs.ravel(), (self.ranges - reach.scaled).ravel(), (self.ranges + reach.scaled).ravel()]
        )
        pose_by, missing = reach.tool_by.reshape(size, 6).T, level - margins
        short, expected = missing > 0.0, margins
        move = np.zeros(size)
        for _ in range(rounds):
            rows = np.concatenate([pose_by, slopes[short]])
            system = rows @ rows.T
            system.reshape(-1)[6 * (len(rows) + 1) :: len(rows) + 1] += damping
            move = np.linalg.solve(system, np.concatenate([lacking, missing[short]])) @ rows
            expected = margins + slopes @ move
            now_short = expected < level
            if now_short.tobytes() == short.tobytes():
                break
            short = now_short
        lacked = np.maximum(level - expected, 0.0)
        weight = float(np.add.reduce(lacked))
        bound = float(lacked @ np.where(lacked > 0.0, expected, 0.0)) / weight if weight > 1e-9 else np.inf
        return Step(move.reshape(-1, 6), np.asarray(bound))

    def _tool(self, q: Floats, turned: Floats) -> tuple[Floats, Floats, Floats]:
        """Place, rotation and derivative from the plates' rotations and their scaled axes, (..., P, 6, 3)."""
        turn, axes = turned[..., :3, :], turned[..., 3:, :]
        beneath = np.empty((*q.shape[:-1], 3, 3))
        beneath[..., 0, :, :] = _UNIT
        rotation = turn[..., 0, :, :]
        for i in range(1, self.count):
            beneath[..., i, :, :] = rotation
            rotation = rotation @ turn[..., i, :, :]
        rises = (beneath @ (self._lift + q[..., :3])[..., None])[..., 0]
        plates = np.add.accumulate(rises, axis=-2) + self.dimensions.foot_mm
        position = plates[..., -1, :] + rotation @ self.dimensions.tool_mm
        lever = position[..., None, :] - plates
        across = np.zeros(beneath.shape)  # rows times it: cross product with the lever
        across[..., 1, 2], across[..., 2, 0], across[..., 0, 1] = lever[..., 0], lever[..., 1], lever[..., 2]
        across -= np.swapaxes(across, -1, -2)
        whole = np.swapaxes(beneath, -1, -2)
        by = np.zeros((*q.shape[:-1], 6, 6))
        by[..., :3, :3] = self.scale[:, :3, None] * whole
        turning = axes @ whole
        by[..., 3:, 3:] = turning
        by[..., 3:, :3] = -(turning @ across)
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


def _of_monomials(platform: PlatformDimensions, scale: Floats) -> Floats:
    """What of a platform is linear in products of 1, cosine, sine of yaw, pitch, roll and in x, y, z.

    Rows: ahead, across, up of each plate joint from its servo's axis, of its bolt, of the joint in the arm's plane and
    of that a quarter turn on (4 x 3 x legs); derivatives of the first two by the scaled set point (legs x 6 x 6); the
    rotation, the scaled axes of roll, pitch, yaw in the frame beneath (6 x 3).
    """
    waves = _rotation_waves()
    turn = np.einsum("xab,ybc,zcd->xyzad", *waves)
    slope = [np.zeros_like(w) for w in waves]
    for w, d in zip(waves, slope, strict=True):
        d[1], d[2] = w[2], -w[1]
    yaw, pitch, roll = waves
    turn_by = np.stack([
        np.einsum("xab,ybc,zcd->xyzad", yaw, pitch, slope[2]),
        np.einsum("xab,ybc,zcd->xyzad", yaw, slope[1], roll),
        np.einsum("xab,ybc,zcd->xyzad", slope[0], pitch, roll),
    ]).reshape(3, MONOMIALS, 3, 3)  # fmt: skip
    turn = turn.reshape(MONOMIALS, 3, 3)
    bearing = platform.arm_bearings_rad
    bolts = servo_axes(platform)
    ahead = np.stack([np.cos(bearing), np.sin(bearing), np.zeros(LEGS)], axis=-1)
    views = np.stack([ahead, bolts, np.tile([0.0, 0.0, -1.0], (LEGS, 1))], axis=1)  # (leg, 3, 3)
    arms = np.stack([platform.plate_joints_mm, bolts])  # (2, leg, 3)
    at = np.zeros((2, 3, LEGS, MONOMIALS + 3))
    at[..., :MONOMIALS] = np.einsum("lij,mjk,slk->silm", views, turn, arms)
    at[0, ..., MONOMIALS:] = np.swapaxes(views, 0, 1)
    from_axes = np.array([0.0, 0.0, -platform.home_height_mm]) - platform.base_joints_mm
    at[0, ..., 0] += np.einsum("lij,lj->il", views, from_axes)
    plane, quarter = at[0] * np.array([1.0, 0.0, 1.0])[:, None, None], np.zeros(at[0].shape)
    quarter[0], quarter[2] = -at[0, 2], at[0, 0]
    by = np.zeros((LEGS, 2, 3, 6, MONOMIALS + 3))
    by[..., 3:, :MONOMIALS] = np.einsum("lij,dmjk,slk->lsidm", views, turn_by, arms)
    by[:, 0, :, :3, 0] = views
    by *= scale[:, None]
    turned = np.zeros((6, 3, MONOMIALS + 3))
    turned[:3, :, :MONOMIALS] = np.moveaxis(turn, 0, -1)
    turned[3, :, :MONOMIALS] = scale[3] * turn[:, :, 0].T
    turned[4, :, : MONOMIALS : MONOMIALS // 3] = scale[4] * yaw[:, :, 1].T
    turned[5, 2, 0] = scale[5]
    return np.concatenate([one.reshape(-1, MONOMIALS + 3) for one in (at, plane, quarter, by, turned)])


def _rotation_waves() -> tuple[Floats, Floats, Floats]:
    """Rotations by yaw, pitch, roll as sums over 1, cosine, sine, (3, 3, 3) each."""
    found = []
    for axis in (2, 1, 0):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        wave = np.zeros((3, 3, 3))
        wave[0, axis, axis] = wave[1, i, i] = wave[1, j, j] = wave[2, j, i] = 1.0
        wave[2, i, j] = -1.0
        found.append(wave)
    return found[0], found[1], found[2]


def _vector_of_one(r: list[float]) -> tuple[float, float, float]:
    """`rotation_vector` of nine numbers in rows."""
    x, y, z = r[7] - r[5], r[2] - r[6], r[3] - r[1]
    sine = 0.5 * sqrt(x * x + y * y + z * z)
    factor = 0.5 * atan2(sine, 0.5 * (r[0] + r[4] + r[8] - 1.0)) / sine if sine > 1e-9 else 0.5
    return factor * x, factor * y, factor * z


def _stacked(platforms: tuple[PlatformDimensions, ...], name: str) -> Floats:
    return np.array([getattr(platform, name) for platform in platforms])
