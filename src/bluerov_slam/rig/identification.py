"""Dimensions, servo offsets and gains of a rig from poses that were measured: least squares with what is known before.

A rig is told servo angles; a real servo makes gain x angle + offset. Measured are places of the tool and/or its
attitudes. One platform is a stack of one (`single_platform`). With x the parameters' deviations in units of their prior
spread, J the whitened derivative of the measurements and r what they deviate:

    x = argmin |r - J x|^2 + |x|^2,    covariance (J^T J + 1)^-1

Eigenvectors of J^T J with an eigenvalue below one are combinations of which the measurements say less than was known
before; `Identified.untold` puts them into words. Attitudes alone, for one, never tell the size of a platform from that
of one twice as large.

Derivatives: a parameter changes the legs' lengths by dl at a fixed plate; the plate gives way by -(dl/dx)^-1 dl.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.rotation import exp_so3, log_so3
from bluerov_slam.rig.dimensions import LEGS, PlatformDimensions, StackDimensions
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.leg_lengths import leg_lengths
from bluerov_slam.rig.stack import stack_jacobian, stack_pose

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bluerov_slam.rig.dimensions import Floats

_ALTERNATING = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
"""Which way round a joint goes when its pair opens."""
PRIOR_STD: dict[str, float] = {
    "offset": float(np.radians(2.0)),
    "gain": 0.05,
    "arm": 1.0,
    "rod": 1.0,
    "base radius": 1.0,
    "plate radius": 1.0,
    "base angle": float(np.radians(1.0)),
    "plate angle": float(np.radians(1.0)),
    "base height": 2.0,
    "tool x": 5.0,
    "tool y": 5.0,
    "tool z": 5.0,
    "mount roll": float(np.radians(3.0)),
    "mount pitch": float(np.radians(3.0)),
    "mount yaw": float(np.radians(3.0)),
}
"""Kinds of parameters and how well they are known before: mm, rad, gain 1. The base height is of a platform's servo
axes' plane on what is beneath; the mount is how the attitude's instrument sits on the tool."""
SERVO_KINDS = ("offset", "gain")
SIZE_KINDS = ("arm", "rod", "base radius", "plate radius", "base angle", "plate angle")
TOOL_KINDS = ("tool x", "tool y", "tool z")
MOUNT_KINDS = ("mount roll", "mount pitch", "mount yaw")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number to find: its kind, the platform (from 0, base first) and servo (from 0) where it has one."""

    kind: str
    platform: int | None = None
    servo: int | None = None

    def __str__(self) -> str:
        where = "" if self.platform is None else f"platform {self.platform + 1} "
        return f"{where}{'' if self.servo is None else f'servo {self.servo + 1} '}{self.kind}"


def parameters_of(platforms: int, kinds: Iterable[str]) -> tuple[Parameter, ...]:
    """All parameters of these kinds of a stack of so many platforms."""
    found: list[Parameter] = []
    for kind in kinds:
        if kind not in PRIOR_STD:
            raise ValueError(f"{kind!r} is none of {', '.join(PRIOR_STD)}")
        if kind in TOOL_KINDS + MOUNT_KINDS:
            found.append(Parameter(kind))
        else:
            servos = range(LEGS) if kind in SERVO_KINDS else (None,)
            found += [Parameter(kind, i, servo) for i in range(platforms) for servo in servos]
    return tuple(found)


def single_platform(dimensions: PlatformDimensions) -> StackDimensions:
    """A stack of one; its tool is the middle of the plate, its origin the plate's home: places are set points."""
    return StackDimensions((dimensions,), np.array([0.0, 0.0, dimensions.home_height_mm]), np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPoses:
    """What was measured at n poses.

    Attributes:
        servo_angles: told, (n, platforms, 6) rad.
        position_mm: of the tool, (n, 3); NaN where not measured.
        rotation: of the instrument on the tool, (n, 3, 3); NaN where not measured.
        position_std_mm: (3,).
        attitude_std_rad: of the turn about x, y, z of the rig frame, (3,).
    """

    servo_angles: Floats
    position_mm: Floats
    rotation: Floats
    position_std_mm: Floats
    attitude_std_rad: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What was found.

    Attributes:
        parameters: in the order of what follows.
        values: deviations from the stated rig, (k,) mm, rad or 1.
        covariance: (k, k).
        share_untold: of each parameter's spread before, how much is left, (k,); 1: nothing was learnt.
        untold: combinations of which the measurements tell nothing, in words.
        misfit: mean square of what stays unexplained, in the measurements' own spread; near 1 if all is well.
        dimensions: of the rig as found.
        gain: (platforms, 6).
        offset_rad: (platforms, 6).
        converged: whether the last step was nothing.
    """

    parameters: tuple[Parameter, ...]
    values: Floats
    covariance: Floats
    share_untold: Floats
    untold: tuple[str, ...]
    misfit: float
    dimensions: StackDimensions
    gain: Floats
    offset_rad: Floats
    converged: bool

    @property
    def std(self) -> Floats:
        """(k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


_ROUNDS = 12
_STILL = 1e-8
_DIFFERENCE = 1e-4
"""Of a parameter's spread, for derivatives of the legs' lengths."""
_SMALLEST_PART = 0.25
_NAMED = 4


def identify(measured: MeasuredPoses, dimensions: StackDimensions, parameters: Sequence[Parameter]) -> Identified:
    """The most likely parameters of a rig said to have these dimensions.

    Raises ValueError where a pose that was told cannot be assembled: then it was not a pose of this rig.
    """
    prior = np.array([PRIOR_STD[each.kind] for each in parameters])
    x = np.zeros(len(parameters))
    points = None
    moved = np.inf
    for _ in range(_ROUNDS):
        rig = _Rig(dimensions, parameters, prior * x, measured)
        points = rig.set_points(points)
        left, slope = rig.residuals(points, prior)
        information = slope.T @ slope
        step = np.linalg.solve(information + np.eye(len(x)), slope.T @ left - x)
        x = x + step
        moved = float(np.max(np.abs(step), initial=0.0))
        if moved < _STILL:
            break
    left = left - slope @ step
    scaled = np.linalg.inv(information + np.eye(len(x)))
    rig = _Rig(dimensions, parameters, prior * x, measured)
    known = max(1, len(left) - round(float(np.trace(information @ scaled))))
    return Identified(
        tuple(parameters),
        prior * x,
        scaled * prior[:, None] * prior,
        np.sqrt(np.diag(scaled)),
        _untold(information, parameters),
        float(left @ left) / known,
        rig.stack,
        rig.gain,
        rig.offset,
        moved < _STILL,
    )


@dataclass
class _Rig:
    """The stated rig with some values of its parameters."""

    stated: StackDimensions
    parameters: Sequence[Parameter]
    values: Floats
    measured: MeasuredPoses
    stack: StackDimensions = field(init=False)
    gain: Floats = field(init=False)
    offset: Floats = field(init=False)
    mount: Floats = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.stated.platforms)
        self.gain, self.offset, self.mount = np.ones((count, LEGS)), np.zeros((count, LEGS)), np.zeros(3)
        platforms, tool = list(self.stated.platforms), np.array(self.stated.tool_mm)
        for each, value in zip(self.parameters, self.values, strict=True):
            if each.platform is None:
                vector = tool if each.kind in TOOL_KINDS else self.mount
                vector[(TOOL_KINDS if each.kind in TOOL_KINDS else MOUNT_KINDS).index(each.kind)] += value
            elif each.servo is not None:
                (self.offset if each.kind == "offset" else self.gain)[each.platform, each.servo] += value
            else:
                platforms[each.platform] = _changed(platforms[each.platform], each.kind, float(value))
        self.stack = replace(self.stated, platforms=tuple(platforms), tool_mm=tool)

    def set_points(self, start: Floats | None) -> Floats:
        """What the servos make, (n, platforms, 6)."""
        angles = self.gain * self.measured.servo_angles + self.offset
        made = []
        for i, platform in enumerate(self.stack.platforms):
            found = plate_pose(angles[:, i], platform, None if start is None else start[:, i])
            if not np.all(found.converged):
                raise ValueError(f"pose {int(np.argmin(found.converged))}: platform {i + 1} cannot take these angles")
            made.append(found.set_point)
        return np.stack(made, axis=1)

    def residuals(self, points: Floats, prior: Floats) -> tuple[Floats, Floats]:
        """Whitened deviations of what was measured (m,) and their derivative by the scaled parameters (m, k)."""
        pose, jacobian = stack_pose(points, self.stack), stack_jacobian(points, self.stack)
        seen = pose.rotation @ exp_so3(self.mount)
        has_place = np.isfinite(self.measured.position_mm).all(axis=1)
        has_turn = np.isfinite(self.measured.rotation).all(axis=(1, 2))
        slope = np.zeros((len(points), 6, len(self.parameters)))
        for k, each in enumerate(self.parameters):
            slope[..., k] = prior[k] * self._derivative(each, points, jacobian, pose.rotation, seen)
        turns = np.zeros((len(points), 3))
        for i in np.flatnonzero(has_turn):
            turns[i] = log_so3(self.measured.rotation[i] @ seen[i].T)
        std_place, std_turn = self.measured.position_std_mm, self.measured.attitude_std_rad
        left = [((self.measured.position_mm - pose.position_mm) / std_place)[has_place], (turns / std_turn)[has_turn]]
        slopes = [(slope[:, :3] / std_place[:, None])[has_place], (slope[:, 3:] / std_turn[:, None])[has_turn]]
        count = len(self.parameters)
        return np.concatenate([each.ravel() for each in left]), np.concatenate(
            [each.reshape(-1, count) for each in slopes]
        )

    def _derivative(self, each: Parameter, points: Floats, jacobian: Floats, turn: Floats, seen: Floats) -> Floats:
        """Of the tool's place and the instrument's turn by one parameter, (n, 6)."""
        found = np.zeros((len(points), 6))
        if each.platform is None:
            if each.kind in TOOL_KINDS:
                found[:, :3] = turn[:, :, TOOL_KINDS.index(each.kind)]
            else:
                found[:, 3:] = seen[:, :, MOUNT_KINDS.index(each.kind)]
            return found
        i = each.platform
        block = jacobian[..., 6 * i : 6 * i + 6]
        if each.kind == "base height":
            return np.asarray(-block[..., 2])
        told = self.measured.servo_angles[:, i]
        angles = self.gain[i] * told + self.offset[i]
        platform = self.stack.platforms[i]
        legs = leg_lengths(points[:, i], angles, platform)
        by_parameter = np.zeros((len(points), LEGS))
        if each.servo is not None:
            rate = 1.0 if each.kind == "offset" else told[:, each.servo]
            by_parameter[:, each.servo] = -legs.by_servo_mm[:, each.servo] * rate
        else:
            step = _DIFFERENCE * PRIOR_STD[each.kind]
            ahead, behind = (
                leg_lengths(points[:, i], angles, _changed(platform, each.kind, way * step)).excess_mm
                for way in (1.0, -1.0)
            )
            by_parameter = (ahead - behind) / (2.0 * step)
        moved = -np.linalg.solve(legs.by_set_point, by_parameter[..., None])
        return np.asarray((block @ moved)[..., 0])


def _changed(platform: PlatformDimensions, kind: str, value: float) -> PlatformDimensions:
    """One platform with one kind of dimension changed in all its legs."""
    if kind == "arm":
        return replace(platform, arm_mm=platform.arm_mm + value)
    if kind == "rod":
        return replace(platform, rod_mm=platform.rod_mm + value)
    if kind == "base height":  # a platform lower down by -z is one with a higher home
        return replace(
            platform,
            home_height_mm=platform.home_height_mm + value,
            base_joints_mm=platform.base_joints_mm - np.array([0.0, 0.0, value]),
        )
    of_base = kind.startswith("base")
    joints = platform.base_joints_mm if of_base else platform.plate_joints_mm
    if kind.endswith("radius"):
        radius = np.hypot(joints[:, 0], joints[:, 1])
        joints = joints * np.stack([1.0 + value / radius, 1.0 + value / radius, np.ones(LEGS)], axis=1)
    else:
        cosine, sine = np.cos(_ALTERNATING * value), np.sin(_ALTERNATING * value)
        x, y, z = joints.T
        joints = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
    return replace(platform, base_joints_mm=joints) if of_base else replace(platform, plate_joints_mm=joints)


def _untold(information: Floats, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Weak combinations in words, the weakest first."""
    strength, ways = np.linalg.eigh(information)
    words = []
    for value, way in zip(strength, ways.T, strict=True):
        if value >= 1.0:
            break
        words.append(_in_words(way, parameters))
    return tuple(words)


def _in_words(way: Floats, parameters: Sequence[Parameter]) -> str:
    parts: list[tuple[float, str]] = []
    groups: dict[tuple[str, int | None], list[int]] = {}
    for k, each in enumerate(parameters):
        groups.setdefault((each.kind, each.platform), []).append(k)
    for (kind, platform), members in groups.items():
        values = way[members]
        if len(members) == LEGS and np.ptp(values) < 0.3 * abs(np.mean(values)):
            parts.append((float(np.linalg.norm(values)) * np.sign(np.mean(values)),
                          f"platform {(platform or 0) + 1} all servos' {kind} alike"))  # fmt: skip
        else:
            parts += [(float(way[k]), str(parameters[k])) for k in members]
    parts = sorted((part for part in parts if abs(part[0]) > _SMALLEST_PART), key=lambda part: -abs(part[0]))[:_NAMED]
    if len(parts) == 1:
        return f"{parts[0][1]}: not seen in these measurements"
    first = np.sign(parts[0][0])
    told = " and ".join(f"{'more' if value * first > 0.0 else 'less'} {name}" for value, name in parts)
    return f"not told apart: {told}"
