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

from bluerov_slam.geometry.platform_stack import PLATFORMS, TIP_MM, rotations, stack_tip_mm

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
    found = np.zeros((*points.shape[:-2], 6, 6 * count))
    for i in range(count):
        yaw = points[..., i, 5]
        zero = np.zeros_like(yaw)
        beneath = reached[i]
        pitch_axis = np.stack([-np.sin(yaw), np.cos(yaw), zero], axis=-1)
        axes = [reached[i + 1][..., :, 0], np.einsum("...ij,...j->...i", beneath, pitch_axis), beneath[..., :, 2]]
        found[..., :3, 6 * i : 6 * i + 3] = beneath
        for k, axis in enumerate(axes, start=6 * i + 3):
            found[..., :3, k] = np.cross(axis, tool - plates[i])
            found[..., 3:, k] = axis
    return found


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
        place = place + np.einsum("...ij,...j->...i", reached[-1], lift)
        plates.append(place)
        reached.append(reached[-1] @ turns[..., i, :, :])
    return plates, reached
