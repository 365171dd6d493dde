"""Platforms one on the other: where the tool is, and how that changes with every platform's set point.

With M the orientation reached so far, x0 the foot, d the height of a base, T = home + translation of a platform:

    p = x0, M = I;  for each platform  p += M (d + T), M = M R;  p += M tool

Each platform turns about axes that turned with those beneath: M = M R. The thesis's text, figure and code multiply R M,
which is the same only where all R commute, as those of equal platforms do. Frames and units: docs/rig.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.geometry.platform_stack import PLATFORMS, TIP_MM, cross, rotations, stack_tip_mm

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions


@dataclass(frozen=True, slots=True)
class StackPose:
    """Place of the tool, mm, (..., 3), and its rotation into the rig frame, (..., 3, 3)."""

    position_mm: Floats
    rotation: Floats


def stack_pose(set_points: Floats, dimensions: StackDimensions) -> StackPose:
    """The tool's pose at set points (..., platforms, 6), base to top."""
    plates, reached = _plates(np.asarray(set_points, dtype=np.float64), dimensions)
    return StackPose(plates[-1] + reached[-1] @ dimensions.tool_mm, reached[-1])


def plate_poses(set_points: Floats, dimensions: StackDimensions) -> StackPose:
    """The pose of every plate in the rig frame: places (..., platforms, 3), rotations (..., platforms, 3, 3)."""
    plates, reached = _plates(np.asarray(set_points, dtype=np.float64), dimensions)
    return StackPose(np.stack(plates, axis=-2), np.stack(reached[1:], axis=-3))


def stack_jacobian(set_points: Floats, dimensions: StackDimensions) -> Floats:
    """Derivative of the tool's place (mm) and turn (rad, vector in the rig frame), (..., 6, 6 platforms).

    Columns are the set points of the platforms, base to top; mm and rad per mm and per rad.
    """
    points = np.asarray(set_points, dtype=np.float64)
    plates, reached = _plates(points, dimensions)
    tool = plates[-1] + reached[-1] @ dimensions.tool_mm
    count = points.shape[-2]
    beneath, turned = np.stack(reached[:-1], axis=-3), np.stack(reached[1:], axis=-3)
    cy, sy = np.cos(points[..., 5, None]), np.sin(points[..., 5, None])
    axes = np.empty((*points.shape[:-1], 3, 3))  # of roll, pitch, yaw in rows
    axes[..., 0, :] = turned[..., :, 0]
    axes[..., 1, :] = cy * beneath[..., :, 1] - sy * beneath[..., :, 0]
    axes[..., 2, :] = beneath[..., :, 2]
    levers = tool[..., None, None, :] - np.stack(plates, axis=-2)[..., None, :]
    found = np.zeros((*points.shape[:-2], count, 6, 6))  # of one platform each, its columns in rows
    found[..., :3, :3] = np.swapaxes(beneath, -1, -2)
    found[..., 3:, :3] = cross(axes, levers)
    found[..., 3:, 3:] = axes
    return np.swapaxes(found.reshape(*points.shape[:-2], 6 * count, 6), -1, -2)


def equal_platforms_pose(translation_mm: Floats, attitude_rad: Floats, tool_mm: Floats = TIP_MM) -> StackPose:
    """The published formula: the four platforms of FO_SHIP set alike, a quarter each of the stack's (..., 3), (..., 3).

    This is what the thesis logged as truth. For several axes a quarter of the Euler angles four times is not the whole.
    """
    turns, moves = np.broadcast_arrays(attitude_rad, translation_mm)
    tip = stack_tip_mm(moves.reshape(-1, 3), turns.reshape(-1, 3), tool_mm).reshape(moves.shape)
    return StackPose(tip, np.linalg.matrix_power(rotations(turns / PLATFORMS), PLATFORMS))


def _plates(points: Floats, dimensions: StackDimensions) -> tuple[list[Floats], list[Floats]]:
    """Places of the plates, and the rotations of the foot and of the plates."""
    turns = rotations(points[..., 3:])
    place = np.broadcast_to(dimensions.foot_mm, (*points.shape[:-2], 3))
    reached = [np.broadcast_to(np.eye(3), (*points.shape[:-2], 3, 3))]
    plates = []
    for i, platform in enumerate(dimensions.platforms):
        lift = dimensions.base_mm + points[..., i, :3] - np.array([0.0, 0.0, platform.home_height_mm])
        place = place + (reached[-1] @ lift[..., None])[..., 0]
        plates.append(place)
        reached.append(reached[-1] @ turns[..., i, :, :])
    return plates, reached
