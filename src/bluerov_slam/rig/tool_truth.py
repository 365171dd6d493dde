"""Where the tool is when its attitude has been measured: set points corrected together, by how uncertain each is.

For one pose by itself; over a session of many poses of one rig use `session_truth`, which learns its build.

The thesis gives each of four platforms a quarter of the attitude that the IMU on the tool tells. That is right for
equal platforms bent alike, and says nothing of how well the place is then known. Here every platform's set point has
the errors e of its spread P (24 numbers), and the attitude is a measurement of three combinations of them:

    r = log(R_measured R(set points + e)^T)   turn still unexplained, rig frame
    J: rows of the turn in the stack's Jacobian
    e <- K (r + J e),  K = P J^T (J P J^T + S)^-1   repeated until e stands still (Gauss-Newton, the most likely e)

The place is that of set points + e, with the covariance that (1 - K J) P leaves, and that of the offsets between parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.rotation import log_so3
from bluerov_slam.rig.dimensions import ManufacturingSpread
from bluerov_slam.rig.stack import stack_jacobian, stack_pose
from bluerov_slam.rig.uncertainty import pose_covariance, set_points_covariance

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

_ROUNDS = 20
_STILL = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class ToolTruth:
    """The tool's pose and how well it is known.

    Attributes:
        position_mm: (3,), rig frame.
        rotation: (3, 3).
        covariance: (6, 6) of the place (mm) and the turn (rad, vector in the rig frame).
        set_points: (platforms, 6), the most likely ones.
        surprise: squared size of the attitude's deviation from what was commanded, in its own spread; chi-square of
            three if the spreads are right.
    """

    position_mm: Floats
    rotation: Floats
    covariance: Floats
    set_points: Floats
    surprise: float


def tool_truth(
    set_points: Floats,
    rotation: Floats,
    attitude_std_rad: Floats,
    dimensions: StackDimensions,
    spread: ManufacturingSpread,
) -> ToolTruth:
    """The pose at commanded set points (platforms, 6) when the tool's measured rotation is (3, 3).

    `attitude_std_rad` (3,): of the measured turn about x, y, z of the rig frame. NaN throughout where a set point
    cannot be reached.
    """
    told = np.asarray(set_points, dtype=np.float64)
    count = len(told)
    prior = set_points_covariance(told, dimensions, spread)
    if not np.all(np.isfinite(prior)):
        return ToolTruth(np.full(3, np.nan), np.full((3, 3), np.nan), np.full((6, 6), np.nan), told, np.nan)
    noise = np.diag(np.square(attitude_std_rad))
    errors = np.zeros(6 * count)
    surprise = float("nan")
    for _ in range(_ROUNDS):
        points = told + errors.reshape(count, 6)
        turn = stack_jacobian(points, dimensions)[3:]
        left = log_so3(rotation @ stack_pose(points, dimensions).rotation.T) + turn @ errors
        expected = turn @ prior @ turn.T + noise
        gain = np.linalg.solve(expected, turn @ prior).T
        moved = gain @ left - errors
        errors = errors + moved
        surprise = float(left @ np.linalg.solve(expected, left))
        if np.max(np.abs(moved)) < _STILL:
            break
    points = told + errors.reshape(count, 6)
    jacobian = stack_jacobian(points, dimensions)
    rest = prior - gain @ turn @ prior
    pose = stack_pose(points, dimensions)
    offsets = pose_covariance(told, dimensions, ManufacturingSpread(stacking_mm=spread.stacking_mm))
    return ToolTruth(pose.position_mm, pose.rotation, jacobian @ rest @ jacobian.T + offsets, points, surprise)
