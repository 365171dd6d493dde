"""How far a platform is from what it cannot do, limit by limit, and the words for each limit.

With a and c of the plate joint in the plane of its servo's arm (c up), phi = atan2(c, a), h = 2 arm sqrt(a^2 + c^2)
and K = arm^2 + |q|^2 - rod^2, the arm stands at theta = phi - acos(K / h) (docs/rig.md). So

    theta <= highest   exactly if   K / h <= cos(max(phi - highest, 0))
    theta >= lowest    exactly if   K / h >= cos(min(phi - lowest, pi))

and where the arm cannot meet its limit, what remains is the root, -1 <= K / h <= 1. These margins are smooth through
the root, where theta itself turns infinitely fast, so that a search can cross it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations, permutations
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.rig.dimensions import LEGS, AxisLimits
from bluerov_slam.rig.platform import joints_mm, servo_angles_rad
from bluerov_slam.rig.servos import angle_range_rad

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, PlatformDimensions, ServoCalibration
    from bluerov_slam.rig.platform import Joints

QUARTER_RAD = float(np.pi / 2.0)
LARGEST_TURN_RAD = float(np.pi)
"""No platform turns half around: such a number is degrees."""
LARGEST_PLACE_MM = 10_000.0


class Limit(StrEnum):
    """Why a pose cannot be reached."""

    AXIS = "axis"
    REACH = "reach"
    SERVO = "servo"
    JOINT = "joint"
    LEGS = "legs"
    ARMS = "arms"

    @property
    def words(self) -> str:
        """For a person."""
        return _WORDS[self]


_WORDS = {
    Limit.AXIS: "a platform would pass its limit along or about one axis",
    Limit.REACH: "a rod is too short or too long for any angle of its servo",
    Limit.SERVO: "a servo would have to turn beyond its range",
    Limit.JOINT: "a ball joint would tilt beyond its play",
    Limit.LEGS: "two rods would touch",
    Limit.ARMS: "a rod would touch the arm of another servo",
}


@dataclass(frozen=True, slots=True, eq=False)
class PlatformLimits:
    """What one platform may do.

    Attributes:
        axes: along and about each axis from home; None leaves only what the mechanism itself limits.
        lowest_servo_rad: of each servo, (6,).
        highest_servo_rad: of each servo, (6,).
        joint_tilt_rad: how far a rod may lean from the plane square to its ball joint's bolt. Every bolt is taken to
            lie along its servo's axis, at the plate too, fixed to the plate. The thesis publishes neither bolt nor
            tilt; 40 degrees is the next round number above the 37 that its own axis limits need.
        rod_thickness_mm: M3 rods. The heads of the ball joints are not measured anywhere and not modelled.
        arm_thickness_mm: the widest horn that the thesis measured.
    """

    axes: AxisLimits | None = field(default_factory=AxisLimits)
    lowest_servo_rad: Floats = field(default_factory=lambda: np.full(LEGS, -QUARTER_RAD))
    highest_servo_rad: Floats = field(default_factory=lambda: np.full(LEGS, QUARTER_RAD))
    joint_tilt_rad: float = float(np.radians(40.0))
    rod_thickness_mm: float = 3.0
    arm_thickness_mm: float = 7.8

    def axis_array(self) -> Floats:
        """(6,), infinite where nothing is set."""
        return np.full(6, np.inf) if self.axes is None else self.axes.array()

    @staticmethod
    def of_servos(calibration: ServoCalibration, axes: AxisLimits | None = None) -> tuple[PlatformLimits, ...]:
        """Limits of every platform of a stack with these servos, whose offsets shift their ranges."""
        low, high = angle_range_rad(calibration)
        axes = axes or AxisLimits()
        return tuple(PlatformLimits(axes, a, b) for a, b in zip(low, high, strict=True))


FO_SHIP_LIMITS = PlatformLimits()


@dataclass(frozen=True, slots=True)
class PlatformMargins:
    """Distance to each limit, negative beyond it; NaN where the legs do not reach and there is none. Each (...,).

    Attributes:
        axis: least of 1 - |set point| / limit over the six axes; infinite without axis limits.
        reach: least of 1 - |K / h| over the legs (see the head of this file); zero where arm and rod are in line.
        servo_rad: to the nearer end of a servo's range.
        joint_rad: to the largest tilt of a ball joint.
        legs_mm: air between two rods.
        arms_mm: air between a rod and the arm of another leg.
    """

    axis: Floats
    reach: Floats
    servo_rad: Floats
    joint_rad: Floats
    legs_mm: Floats
    arms_mm: Floats

    def by_limit(self) -> dict[Limit, Floats]:
        """The same by name."""
        return {
            Limit.AXIS: self.axis,
            Limit.REACH: self.reach,
            Limit.SERVO: self.servo_rad,
            Limit.JOINT: self.joint_rad,
            Limit.LEGS: self.legs_mm,
            Limit.ARMS: self.arms_mm,
        }

    @property
    def allowed(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Whether every limit is kept, (...,); never where a margin is NaN."""
        kept = [margin >= 0.0 for margin in self.by_limit().values()]
        return np.asarray(np.logical_and.reduce(kept))

    def broken(self) -> Limit | None:
        """Of one set point: the limit it breaks, the root of the kinematics before what follows from it."""
        order = (Limit.REACH, Limit.SERVO, Limit.JOINT, Limit.LEGS, Limit.ARMS, Limit.AXIS)
        margins = self.by_limit()
        return next((limit for limit in order if not float(margins[limit]) >= 0.0), None)


def platform_margins(
    set_points: Floats, dimensions: PlatformDimensions, limits: PlatformLimits = FO_SHIP_LIMITS
) -> PlatformMargins:
    """Margins of set points (..., 6)."""
    points = np.asarray(set_points, dtype=np.float64)
    joints = joints_mm(points, dimensions)
    angles = servo_angles_rad(points, dimensions)
    ratio = root_ratio(joints.plate_mm - joints.base_mm, dimensions)
    servo = np.minimum(angles - limits.lowest_servo_rad, limits.highest_servo_rad - angles)
    rods = joints.plate_mm - joints.arm_ends_mm
    legs_mm, arms_mm = air_mm(joints, limits)
    return PlatformMargins(
        axis=np.min(1.0 - np.abs(points) / limits.axis_array(), axis=-1),
        reach=np.min(1.0 - np.abs(ratio), axis=-1),
        servo_rad=np.min(servo, axis=-1),
        joint_rad=limits.joint_tilt_rad - _largest_tilt_rad(points, rods, dimensions),
        legs_mm=legs_mm,
        arms_mm=arms_mm,
    )


def root_ratio(from_axes_mm: Floats, dimensions: PlatformDimensions) -> Floats:
    """K / h of plate joints (..., 6, 3) seen from their servos' axes; a leg reaches if it lies within -1..1."""
    bearing = dimensions.arm_bearings_rad
    a = np.cos(bearing) * from_axes_mm[..., 0] + np.sin(bearing) * from_axes_mm[..., 1]
    k = dimensions.arm_mm**2 + np.sum(from_axes_mm**2, axis=-1) - dimensions.rod_mm**2
    return np.asarray(k / (2.0 * dimensions.arm_mm * np.hypot(a, from_axes_mm[..., 2])))


def servo_axes(dimensions: PlatformDimensions) -> Floats:
    """Unit vectors along the servos' axes, (..., 6, 3): square to the arm, level."""
    bearing = dimensions.arm_bearings_rad
    return np.stack([-np.sin(bearing), np.cos(bearing), np.zeros_like(bearing)], axis=-1)


def checked_set_points(set_points: Floats, shape: tuple[int, ...] = (6,)) -> Floats:
    """Set points that are numbers and radians.

    Raises OutOfValidityError with the cure.
    """
    points = np.asarray(set_points, dtype=np.float64)
    if points.shape[-len(shape) :] != shape:
        raise OutOfValidityError(
            f"set points have the shape {points.shape}, expected (..., {', '.join(map(str, shape))})"
        )
    if not np.isfinite(points).all():
        raise OutOfValidityError("a set point is not a number: give x, y, z in mm and roll, pitch, yaw in rad")
    _check_turn(points[..., 3:])
    _check_place(points[..., :3])
    return points


def checked_pose(position_mm: Floats, rotation: Floats) -> tuple[Floats, Floats]:
    """A place (3,) and a rotation (3, 3) that can be one.

    Raises OutOfValidityError with the cure.
    """
    place, turn = np.asarray(position_mm, dtype=np.float64), np.asarray(rotation, dtype=np.float64)
    if place.shape != (3,) or turn.shape not in {(3, 3), (3,)}:
        raise OutOfValidityError(f"a pose is a place (3,) and a rotation (3, 3), not {place.shape} and {turn.shape}")
    if not (np.isfinite(place).all() and np.isfinite(turn).all()):
        raise OutOfValidityError("the pose has a value that is not a number")
    _check_place(place)
    if turn.shape == (3,):
        _check_turn(turn)
        turn = rotations(turn)
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0.0:
        raise OutOfValidityError("the rotation of the pose is no rotation: its rows are not square to each other")
    return place, turn


def _check_turn(angles_rad: Floats) -> None:
    largest = float(np.max(np.abs(angles_rad), initial=0.0))
    if largest > LARGEST_TURN_RAD:
        raise OutOfValidityError(
            f"an angle of {largest:.6g} rad, expected -pi..pi: this looks like degrees, multiply by pi / 180"
        )


def _check_place(place_mm: Floats) -> None:
    largest = float(np.max(np.abs(place_mm), initial=0.0))
    if largest > LARGEST_PLACE_MM:
        raise OutOfValidityError(
            f"a place of {largest:.6g} mm, expected at most {LARGEST_PLACE_MM:g} mm from the foot: give millimetres"
        )


def _largest_tilt_rad(points: Floats, rods: Floats, dimensions: PlatformDimensions) -> Floats:
    """Over both joints of all legs, (...,)."""
    bolts = servo_axes(dimensions)
    turned = np.einsum("...ij,...lj->...li", rotations(points[..., 3:]), bolts)
    sines = np.stack([np.sum(rods * bolts, axis=-1), np.sum(rods * turned, axis=-1)]) / dimensions.rod_mm
    return np.asarray(np.arcsin(np.clip(np.abs(sines), 0.0, 1.0)).max(axis=(0, -1)))


_LEG_PAIRS = list(combinations(range(LEGS), 2))
_RODS, _OTHERS = np.array(_LEG_PAIRS + [(i, LEGS + j) for i, j in permutations(range(LEGS), 2)]).T
"""Which rods are held against which other rods (0..5) and arms (6..11)."""


def air_mm(joints: Joints, limits: PlatformLimits) -> tuple[Floats, Floats]:
    """Least air between two rods, and between a rod and the arm of another leg, each (...,); NaN out of reach."""
    begins = np.concatenate([joints.arm_ends_mm, joints.base_mm], axis=-2)
    ends = np.concatenate([joints.plate_mm, joints.arm_ends_mm], axis=-2)
    apart = segment_distance_mm(
        begins[..., _RODS, :], ends[..., _RODS, :], begins[..., _OTHERS, :], ends[..., _OTHERS, :]
    )
    legs, arms = apart[..., : len(_LEG_PAIRS)], apart[..., len(_LEG_PAIRS) :]
    arm_mm = 0.5 * (limits.rod_thickness_mm + limits.arm_thickness_mm)
    return legs.min(axis=-1) - limits.rod_thickness_mm, arms.min(axis=-1) - arm_mm


def segment_distance_mm(a0: Floats, a1: Floats, b0: Floats, b1: Floats) -> Floats:
    """Least distance between the segments a0 a1 and b0 b1, each (..., 3)."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    uu, vv, uv, uw, vw = (np.einsum("...k,...k->...", *both) for both in ((u, u), (v, v), (u, v), (u, w), (v, w)))
    across = uu * vv - uv * uv
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.where(across > 1e-12 * uu * vv, (uv * vw - vv * uw) / across, 0.0)
        s = np.minimum(np.maximum(s, 0.0), 1.0)
        t = np.minimum(np.maximum((uv * s + vw) / vv, 0.0), 1.0)
        s = np.minimum(np.maximum((uv * t - uw) / uu, 0.0), 1.0)  # the nearest point of a to the end that t was cut to
    apart = w + s[..., None] * u - t[..., None] * v
    return np.asarray(np.sqrt(np.einsum("...k,...k->...", apart, apart)))
