"""The published validation of the rig (thesis table 2.4): eight places measured by ruler, beside what we predict.

The table names set points only by words. Max X, Max Y, Min Z are the axis limits, Max Roll and Min Pitch those of the
tilts; what "Med" means is not said, and half of the limit is what fits: the attitudes recovered below differ from the
commanded tilt by the same share as in the thesis's logs. Its estimates are those of the equal-platform formula with the
attitude of the tool's IMU. That attitude is not told, but three coordinates hold it: `told_attitude` turns the formula
round. Where it does not lean the yaw moves the place hardly at all; there a spread of a few degrees is put in.

Predictions stand beside each measured place: from the set points alone, from what the rig makes of its set points by
the thesis's logs (`logged_set_points`), and with that attitude (`tool_truth`). The gains come from the attitudes of the
27 logs, never from the table, whose measured places are only compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.geometry.platform_stack import PLATFORMS, rotations
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.rig.dimensions import FO_SHIP, ManufacturingSpread
from bluerov_slam.rig.gauge import PUBLISHED_RANGES, servo_errors
from bluerov_slam.rig.identification import PRIOR_STD
from bluerov_slam.rig.stack import equal_platforms_pose, stack_pose
from bluerov_slam.rig.tool_truth import tool_truth
from bluerov_slam.rig.uncertainty import pose_covariance

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

MEASURED_HALF_WIDTH_MM = 1.6
_ROUNDED_MM = 1.0 / np.sqrt(12.0)
"""Standard deviation of a coordinate printed in whole millimetres."""
IMU_STD_RAD = np.radians([1.0, 1.0, 2.0])
"""Assumed of the tool's IMU (an LSM6DSOX and a LIS3MDL, not calibrated in place): the thesis states none for tilts."""
YAW_STD_RAD = float(np.radians(3.0))
"""What is known of the yaw before an estimate is turned round: the stack was not told to turn."""
LOGGED_GAIN = np.array([1.0, 1.0, 1.0, 1.12, 1.11, 1.0])
"""What the stack makes of set points by the moving rows of the thesis's 27 logs: mean slope of the IMU's roll and pitch
over what was commanded. Of places the logs measured nothing. Their yaw comes out 0.72 of what was commanded, but
nothing tells whether the rig or its compass (not calibrated, next to 24 servos) turns too little: it stays at 1."""
LOGGED_GAIN_STD = (0.12, 0.12, 0.12, 0.02, 0.05, 0.3)
"""Roll and pitch from log to log, yaw by its doubt; whether ways are stretched as tilts are is not known."""
LOGGED_LEAN_RAD = np.radians([-0.31, -1.91])
"""Mean roll and pitch of the tool where no turn was commanded, of the 27 logs; and how they differ from log to log:"""
LOGGED_LEAN_STD_RAD = np.radians([0.37, 1.02])
LOGGED_PLAY_RAD = float(np.radians(0.70))
"""RMS of roll and pitch of the tool about a straight line over what was commanded: what is another at each pose."""
HORN_DOUBT_MM = 1.0
"""Section 2.6 states horns of 24.5 to 25.5 mm between their holes, table 2.3 an arm of 24."""
REGION = 0.95


@dataclass(frozen=True, slots=True)
class MeasuredPlace:
    """A row of the table, mm.

    Attributes:
        set_point: of every platform, x, y, z (mm), roll, pitch, yaw (degrees).
        estimated_mm: by the thesis, with the IMU's attitude.
        measured_mm: by ruler, each +-1.6 mm.
        guessed: the set point is not stated.
    """

    name: str
    set_point: tuple[float, float, float, float, float, float]
    estimated_mm: tuple[float, float, float]
    measured_mm: tuple[float, float, float]
    guessed: bool = False

    @property
    def set_points(self) -> Floats:
        """(4, 6), mm and rad."""
        one = np.array(self.set_point, dtype=np.float64)
        one[3:] = np.radians(one[3:])
        return np.tile(one, (PLATFORMS, 1))


TABLE_2_4 = (
    MeasuredPlace("Zero", (0, 0, 0, 0, 0, 0), (124, 1, -642), (127, 0, -643)),
    MeasuredPlace("Max X", (5, 0, 0, 0, 0, 0), (152, 1, -638), (152, 2, -639)),
    MeasuredPlace("Max Y", (0, 5, 0, 0, 0, 0), (126, 21, -642), (127, 19, -643)),
    MeasuredPlace("Min Z", (0, 0, -16, 0, 0, 0), (122, -2, -708), (126, -1, -711)),
    MeasuredPlace("Max Roll", (0, 0, 0, 15, 0, 0), (90, 305, -520), (101, 295, -535)),
    MeasuredPlace("Min Pitch", (0, 0, 0, 0, -15, 0), (333, 4, -425), (340, 2, -430)),
    MeasuredPlace("Med Roll", (0, 0, 0, 7.5, 0, 0), (111, 178, -604), (105, 172, -610), guessed=True),
    MeasuredPlace("Med Pitch", (0, 0, 0, 0, -7.5, 0), (263, 2, -542), (257, 1, -543), guessed=True),
)
PUBLISHED_ERRORS_MM = (3.32, 1.41, 2.45, 5.10, 21.12, 8.83, 10.39, 6.16)


def stated_spread() -> ManufacturingSpread:
    """Only what the thesis states: what passes its gauge, horns of 24.5 to 25.5 mm, servos 57 to 59 mm apart.

    Ranges are taken as even, the spacing's as that of two joints. Of rods, plates and the build nothing is stated, and
    nothing of play: none is put in.
    """
    (arm_low, arm_high), (low, high) = PUBLISHED_RANGES["horn_length_mm"], PUBLISHED_RANGES["servo_spacing_mm"]
    passed = servo_errors().covariance_rad2
    return ManufacturingSpread(
        servo_rad=float(np.sqrt(passed[0, 0])),
        pair_correlation=float(passed[0, 1] / passed[0, 0]),
        arm_mm=(arm_high - arm_low) / float(np.sqrt(12.0)),
        joint_mm=(high - low) / float(np.sqrt(24.0)),
    )


def logged_spread(about_logged: bool = False) -> ManufacturingSpread:
    """The stated one, and what the attitudes of the thesis's 27 logs show beside it.

    A gain of each axis and a lean, alike for all platforms and at all poses, and play, another at each. The logs see
    the sum of four platforms; how these share a gain nothing tells: each may differ as much as all do together. Nor do
    they see what a gain of the servos does at home, where arms stand at 23 degrees: it lifts the stack. None is
    stated; it is put in as large as identification supposes.

    Args:
        about_logged: about `logged_set_points`, whose gains and lean are known as the logs repeat them; else about the
            set points as commanded.
    """
    stated, home = stated_spread(), np.zeros((PLATFORMS, 6))
    known, play = (_tilt_rad(home, spread) for spread in (stated, ManufacturingSpread(slop_rad=1.0)))
    tilts = tuple(np.hypot(LOGGED_GAIN - 1.0, LOGGED_GAIN_STD).tolist())
    lean = float(np.sqrt(np.mean(LOGGED_LEAN_STD_RAD**2)))
    if not about_logged:
        # The stated zeros lean a stack, too; what they do not explain is the load's.
        lean = float(np.sqrt(np.mean(LOGGED_LEAN_STD_RAD**2 + LOGGED_LEAN_RAD**2) - known**2))
    return replace(
        stated,
        slop_rad=LOGGED_PLAY_RAD / play,
        gain_alike=PRIOR_STD["gain"],
        arm_alike_mm=HORN_DOUBT_MM,
        axis_gain=LOGGED_GAIN_STD if about_logged else tilts,
        axis_gain_apart=tilts,
        lean_rad=lean / PLATFORMS,
    )


def _tilt_rad(set_points: Floats, spread: ManufacturingSpread) -> float:
    return float(np.sqrt(np.mean(np.diag(pose_covariance(set_points, FO_SHIP, spread))[3:5])))


def logged_set_points(set_points: Floats) -> Floats:
    """What the thesis's rig makes of set points (..., 6) by its logs: gains of its tilts and the lean of its home."""
    made: Floats = set_points * LOGGED_GAIN
    made[..., 3:5] += LOGGED_LEAN_RAD / PLATFORMS
    return made


def published_error_mm(place: MeasuredPlace) -> float:
    """Distance of the thesis's estimate from the measured place."""
    return float(np.linalg.norm(np.subtract(place.estimated_mm, place.measured_mm)))


@dataclass(frozen=True, slots=True, eq=False)
class ToldAttitude:
    """What the IMU told: roll, pitch, yaw (3,) and its covariance, rad; how well the formula meets the estimate, mm."""

    attitude_rad: Floats
    covariance_rad2: Floats
    residual_mm: float


def told_attitude(place: MeasuredPlace) -> ToldAttitude:
    """The attitude behind a published estimate: the formula of equal platforms turned round."""
    moved = PLATFORMS * np.array(place.set_point[:3])
    start = PLATFORMS * np.radians(place.set_point[3:])
    weights = np.concatenate([np.full(3, 1.0 / _ROUNDED_MM), [1.0 / YAW_STD_RAD]])
    attitude = start.copy()
    for _ in range(_ROUNDS):
        left = np.append(np.array(place.estimated_mm) - _formula_mm(moved, attitude), start[2] - attitude[2])
        slope = np.vstack([_slope(moved, attitude), [0.0, 0.0, 1.0]]) * weights[:, None]
        step = np.linalg.lstsq(slope, left * weights, rcond=None)[0]
        attitude = attitude + step * min(1.0, _LARGEST_STEP_RAD / float(np.linalg.norm(step)))
    residual = float(np.linalg.norm(np.array(place.estimated_mm) - _formula_mm(moved, attitude)))
    return ToldAttitude(attitude, np.linalg.inv(slope.T @ slope), residual)


_ROUNDS = 50
_LARGEST_STEP_RAD = 0.1
_DIFFERENCE_RAD = 1e-6


def _formula_mm(moved_mm: Floats, attitude_rad: Floats) -> Floats:
    return equal_platforms_pose(moved_mm, attitude_rad).position_mm


def _slope(moved_mm: Floats, attitude_rad: Floats) -> Floats:
    steps = _DIFFERENCE_RAD * np.eye(3)
    ahead, behind = _formula_mm(moved_mm, attitude_rad + steps), _formula_mm(moved_mm, attitude_rad - steps)
    return np.asarray((ahead - behind).T / (2.0 * _DIFFERENCE_RAD))


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Our place for a row of the table.

    Attributes:
        place: the row.
        position_mm: predicted, (3,).
        covariance_mm2: of the prediction by itself, (3, 3).
        distance_mm: from the measured place.
        squared: of that in the spread of prediction and measurement together; chi-square of three.
        surprise: of the IMU's attitude against the commanded one, chi-square of three; NaN if it was not used.
    """

    place: MeasuredPlace
    position_mm: Floats
    covariance_mm2: Floats
    distance_mm: float
    squared: float
    surprise: float

    @property
    def inside(self) -> bool:
        """Whether the measured place lies in the 95 % region."""
        return self.squared <= chi_square_quantile(REGION, 3.0)


def predict(
    place: MeasuredPlace,
    spread: ManufacturingSpread,
    dimensions: StackDimensions = FO_SHIP,
    with_attitude: bool = True,
    imu_std_rad: Floats = IMU_STD_RAD,
    as_logged: bool = False,
) -> Prediction:
    """From the set points alone or with the attitude that the IMU told; `as_logged`: from `logged_set_points`."""
    points = logged_set_points(place.set_points) if as_logged else place.set_points
    if not with_attitude:
        position = stack_pose(points, dimensions).position_mm
        covariance = pose_covariance(points, dimensions, spread)[:3, :3]
        return _compared(place, position, covariance, float("nan"))
    told = told_attitude(place)
    rotation = np.linalg.matrix_power(rotations(told.attitude_rad / PLATFORMS), PLATFORMS)
    # Spreads of roll, pitch and yaw stand for those about x, y and z: at 71 degrees they differ, but all are assumed.
    std = np.sqrt(np.square(imu_std_rad) + np.diag(told.covariance_rad2))
    truth = tool_truth(points, rotation, std, dimensions, spread)
    return _compared(place, truth.position_mm, truth.covariance[:3, :3], truth.surprise)


def _compared(place: MeasuredPlace, position_mm: Floats, covariance_mm2: Floats, surprise: float) -> Prediction:
    miss = np.array(place.measured_mm) - position_mm
    measured = (MEASURED_HALF_WIDTH_MM**2 / 3.0 + _ROUNDED_MM**2) * np.eye(3)
    squared = float(miss @ np.linalg.solve(covariance_mm2 + measured, miss))
    return Prediction(place, position_mm, covariance_mm2, float(np.linalg.norm(miss)), squared, surprise)
