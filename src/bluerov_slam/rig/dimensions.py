"""What a rig of hexapod platforms is made of: joints, arms, rods, axis limits, servos, and how well all that is known.

Frame of a platform: origin at the middle of its servo axes' plane, x forward, y right, z down; millimetres, radians.
Source: thesis table 2.3 and its configuration. There a joint or an arm at the bearing phi is drawn in a frame that is
x' = -y, y' = -x, z' = -z of this one: the bearing -90 deg - phi here (from x to y).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.geometry.platform_stack import BASE_MM, FOOT_MM, HOME_MM, PLATFORMS, TIP_MM

Floats = NDArray[np.float64]

LEGS = 6


@dataclass(frozen=True, slots=True)
class Leg:
    """One leg in plain numbers, for the calculation of one pose, where NumPy's calls would cost more than the sums."""

    base_x: float
    base_y: float
    base_z: float
    plate_x: float
    plate_y: float
    plate_z: float
    forward_x: float
    forward_y: float
    arm_mm: float
    rod_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class PlatformDimensions:
    """One platform, each leg with numbers of its own. Arrays may have leading axes: a batch of unequal platforms.

    Attributes:
        base_joints_mm: where each servo's axis meets its arm, (..., 6, 3), frame of the platform.
        plate_joints_mm: ball joints in the frame of the plate, (..., 6, 3).
        arm_bearings_rad: where the level arm points, from x to y, (..., 6).
        arm_mm: between the servo's axis and the ball joint, (..., 6).
        rod_mm: between the two ball joints, (..., 6).
        home_height_mm: of the plate over the servo axes' plane at set point zero.
        plate_radius_mm: root mean square distance of the plate's joints from its middle, (...): what a radian is worth.
        legs: the same in plain numbers; empty for a batch.
        to_arm_planes: (18, 13), empty for a batch. Times (nine numbers of the plate's rotation row by row, x, y, z, 1)
            it is each plate joint from its servo's axis: along the level arm, across it, upwards, six of each.
    """

    base_joints_mm: Floats
    plate_joints_mm: Floats
    arm_bearings_rad: Floats
    arm_mm: Floats
    rod_mm: Floats
    home_height_mm: float = float(-HOME_MM[2])
    plate_radius_mm: Floats = field(init=False, repr=False)
    legs: tuple[Leg, ...] = field(init=False, repr=False)
    to_arm_planes: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Freeze the arrays and put the legs into plain numbers."""
        for name, shape in (
            ("base_joints_mm", (LEGS, 3)),
            ("plate_joints_mm", (LEGS, 3)),
            ("arm_bearings_rad", (LEGS,)),
            ("arm_mm", (LEGS,)),
            ("rod_mm", (LEGS,)),
        ):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape[-len(shape) :] != shape:
                raise ValueError(f"{name} has shape {array.shape}, expected (..., {', '.join(map(str, shape))})")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        radius = np.sqrt(np.mean(np.sum(self.plate_joints_mm**2, axis=-1), axis=-1))
        object.__setattr__(self, "plate_radius_mm", radius)
        legs = () if self.batched else tuple(map(self._leg, range(LEGS)))
        object.__setattr__(self, "legs", legs)
        object.__setattr__(self, "to_arm_planes", np.empty((0, 13)) if self.batched else self._arm_planes())

    @property
    def batched(self) -> bool:
        """Whether these are the dimensions of many platforms."""
        return max(self.base_joints_mm.ndim - 1, self.plate_joints_mm.ndim - 1, self.arm_bearings_rad.ndim,
                   self.arm_mm.ndim, self.rod_mm.ndim) > 1  # fmt: skip

    def _leg(self, i: int) -> Leg:
        bearing = self.arm_bearings_rad[i]
        numbers = (*self.base_joints_mm[i], *self.plate_joints_mm[i], np.cos(bearing), np.sin(bearing))
        return Leg(*map(float, (*numbers, self.arm_mm[i], self.rod_mm[i])))

    def _arm_planes(self) -> Floats:
        level = np.stack([np.cos(self.arm_bearings_rad), np.sin(self.arm_bearings_rad), np.zeros(LEGS)], axis=-1)
        across = np.stack([-level[:, 1], level[:, 0], np.zeros(LEGS)], axis=-1)
        up = np.tile([0.0, 0.0, -1.0], (LEGS, 1))
        ways = np.concatenate([level, across, up])
        plate, base = np.tile(self.plate_joints_mm, (3, 1)), np.tile(self.base_joints_mm, (3, 1))
        of_rotation = (ways[:, :, None] * plate[:, None, :]).reshape(3 * LEGS, 9)
        home = np.array([0.0, 0.0, -self.home_height_mm])
        return np.concatenate([of_rotation, ways, np.sum(ways * (home - base), axis=-1, keepdims=True)], axis=-1)

    @staticmethod
    def symmetric(
        rod_mm: float,
        arm_mm: float,
        plate_radius_mm: float,
        base_radius_mm: float,
        plate_angle_rad: float,
        base_angle_rad: float,
        home_height_mm: float = float(-HOME_MM[2]),
    ) -> PlatformDimensions:
        """A platform as drawn: three equal pairs of servos, joints on two circles.

        Args:
            rod_mm: between the ball joints of a rod.
            arm_mm: of a servo, axis to ball joint.
            plate_radius_mm: of the circle of the plate's joints.
            base_radius_mm: of the circle of the servos' joints.
            plate_angle_rad: of each plate joint from its pair's axis (theta_P).
            base_angle_rad: of each base joint from its pair's axis (theta_B).
            home_height_mm: of the plate over the servo axes' plane at set point zero.
        """
        ones = np.ones(LEGS)
        return PlatformDimensions(
            _circle(base_radius_mm, base_angle_rad),
            _circle(plate_radius_mm, plate_angle_rad),
            -np.pi / 2.0 - np.radians(_DRAWN_ARMS_DEG),
            arm_mm * ones,
            rod_mm * ones,
            home_height_mm,
        )


_DRAWN_ARMS_DEG = np.array([-60.0, 120.0, 180.0, 0.0, 60.0, -120.0])


def _circle(radius_mm: float, angle_rad: float) -> Floats:
    """Six joints in servo order: three of one side as drawn, then their mirror images in reverse order."""
    side = np.array([np.pi / 6.0 + angle_rad, np.pi / 6.0 - angle_rad, -np.pi / 2.0 + angle_rad])
    bearing = -np.pi / 2.0 - np.concatenate([side, np.pi - side[::-1]])
    return radius_mm * np.stack([np.cos(bearing), np.sin(bearing), np.zeros(LEGS)], axis=-1)


FO_SHIP_PLATFORM = PlatformDimensions.symmetric(
    rod_mm=106.0,
    arm_mm=24.0,
    plate_radius_mm=57.725,  # table 2.3 rounds it to 57.73
    base_radius_mm=82.7,
    plate_angle_rad=float(np.radians(50.02)),
    base_angle_rad=float(np.radians(20.53)),
)


@dataclass(frozen=True, slots=True, eq=False)
class StackDimensions:
    """Platforms one on the other. Offsets in mm, (3,): the foot in the rig frame, each servo axes' plane (base) from
    the plate beneath, the tool in the frame of the uppermost plate."""

    platforms: tuple[PlatformDimensions, ...]
    foot_mm: Floats
    base_mm: Floats
    tool_mm: Floats


FO_SHIP = StackDimensions((FO_SHIP_PLATFORM,) * PLATFORMS, FOOT_MM, BASE_MM, TIP_MM)


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """How far one platform may go from home along each axis by itself (the thesis's `Hexapod_Config1.h`)."""

    x_mm: float = 5.0
    y_mm: float = 5.0
    z_mm: float = 16.0
    roll_rad: float = float(np.radians(15.0))
    pitch_rad: float = float(np.radians(15.0))
    yaw_rad: float = float(np.radians(5.0))

    def array(self) -> Floats:
        """(6,), as a set point."""
        return np.array([self.x_mm, self.y_mm, self.z_mm, self.roll_rad, self.pitch_rad, self.yaw_rad])


@dataclass(frozen=True, slots=True, eq=False)
class ServoCalibration:
    """How pulse widths become angles, for servos (..., 6): counts of a 12-bit timer whose cycle is 4096.

    Attributes:
        gain: of each servo against counts_per_rad, (..., 6).
        offset_counts: to add to the counts, (..., 6).
        reversed_: whether more counts lower the arm, (..., 6).
        counts_per_rad: 400 counts for half a turn; the thesis's code calls it 127.3.
        lowest_counts: the shortest pulse that a servo may get.
        highest_counts: the longest.
    """

    gain: Floats
    offset_counts: Floats
    reversed_: NDArray[np.bool_]
    counts_per_rad: float = 400.0 / float(np.pi)
    lowest_counts: int = 100
    highest_counts: int = 500

    @property
    def middle_counts(self) -> float:
        """Of a level arm before its offset."""
        return 0.5 * (self.lowest_counts + self.highest_counts)


FO_SHIP_SERVOS = ServoCalibration(
    np.ones((PLATFORMS, LEGS)),
    np.array(
        [
            [2.0, -1.0, 0.0, -19.0, -4.0, 1.0],
            [6.0, -12.0, 1.0, 14.0, -4.0, 11.0],
            [16.0, -11.0, -12.0, 9.0, -5.0, -16.0],
            [-8.0, 7.0, 8.0, -2.0, -2.0, -17.0],
        ]
    ),
    np.tile(np.arange(LEGS) % 2 == 0, (PLATFORMS, 1)),
)


@dataclass(frozen=True, slots=True)
class ManufacturingSpread:
    """How well a rig is known: standard deviations, each of every servo, rod, arm, joint or base by itself.

    The same for all legs; zero is exact. All but the play is the rig's build: it stays from pose to pose. What is
    "alike" is one number for all platforms, because one drawing, one printer or one kind of servo made them.

    Attributes:
        servo_rad: setting of a servo's zero.
        slop_rad: play of a servo, another at each pose.
        rod_mm: length of a rod.
        arm_mm: length of an arm.
        joint_mm: each coordinate of each base and plate joint.
        stacking_mm: each coordinate of the foot, of every base on the plate beneath and of the tool.
        pair_correlation: of the settings of two facing servos (0 and 1, 2 and 3, 4 and 5), which are levelled together.
        gain: of a servo: the share by which it turns too far, about its level arm.
        gain_alike: the same, of all servos alike.
        arm_alike_mm: of all arms alike.
        base_alike_mm: each coordinate of the bases on the plates beneath, alike.
        axis_gain: share by which every platform goes too far in x, y, z, roll, pitch, yaw, alike.
        axis_gain_apart: the same, of each platform by itself.
        lean_rad: roll and pitch of every platform, alike: what the load bends.
    """

    servo_rad: float = 0.0
    slop_rad: float = 0.0
    rod_mm: float = 0.0
    arm_mm: float = 0.0
    joint_mm: float = 0.0
    stacking_mm: float = 0.0
    pair_correlation: float = 0.0
    gain: float = 0.0
    gain_alike: float = 0.0
    arm_alike_mm: float = 0.0
    base_alike_mm: float = 0.0
    axis_gain: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    axis_gain_apart: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    lean_rad: float = 0.0
