"""Moves to show a rig: axis limits, inverted pairs, a circle, and pointing the array at a transmitter.

Each gives waypoints (n, P, 6), to be run by `trajectory.smooth_path` or in the published steps. Source: thesis section
2.5.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.geometry.platform_stack import PLATFORMS
from bluerov_slam.rig.dimensions import FO_SHIP, AxisLimits
from bluerov_slam.rig.limits import FO_SHIP_LIMITS, Limit, PlatformLimits
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.rig.workspace import PlatformWorkspace

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

INVERTED = np.array([1.0, -1.0, -1.0, 1.0])
"""First and last platform one way, second and third the other."""


def axis_limits(limits: AxisLimits | None = None, platforms: int = PLATFORMS) -> Floats:
    """From home to the most and the least of x, y, z, roll, pitch, yaw, all platforms alike, and home again."""
    return _each_axis(limits, np.ones(platforms))


def inverted_pairs(limits: AxisLimits | None = None) -> Floats:
    """The same with the second and third platform set the other way: the tool stays where it is.

    Exactly so along x, y, z. About the axes it stays level and in place sideways, but platforms that lean are lower:
    2 (1 - cos angle) x 134 mm, 9.1 mm at 15 degrees. `stand_still` takes that out as well.
    """
    return _each_axis(limits, INVERTED)


def stand_still(waypoints: Floats, dimensions: StackDimensions = FO_SHIP) -> Floats:
    """Raise all platforms alike until the tool's height is that of home, at every waypoint (n, P, 6)."""
    points = np.array(waypoints, dtype=np.float64)
    wished = stack_pose(np.zeros(points.shape[1:]), dimensions).position_mm[2]
    for _ in range(20):
        sunk = stack_pose(points, dimensions).position_mm[:, 2] - wished
        if np.abs(sunk).max() < 1e-10:
            break
        points[..., 2] -= (sunk / points.shape[1])[:, None]
    return points


def circle(
    radius_rad: float = float(np.radians(15.0)), points: int = 48, turns: int = 1, platforms: int = PLATFORMS
) -> Floats:
    """Roll and pitch round a circle, all platforms alike, from home and back; begins at the most of roll."""
    if not 0.0 < radius_rad <= np.pi / 4.0:
        raise OutOfValidityError(f"a radius of {radius_rad:.6g} rad, expected 0..0.785: give radians, not degrees")
    if points < 4 or turns < 1:
        raise OutOfValidityError(f"{points} points and {turns} turns, expected at least 4 and 1")
    angle = 2.0 * np.pi * np.arange(points * turns + 1) / points
    one = np.zeros((len(angle) + 2, 6))
    one[1:-1, 3], one[1:-1, 4] = radius_rad * np.cos(angle), radius_rad * np.sin(angle)
    return np.repeat(one[:, None, :], platforms, axis=1)


@dataclass(frozen=True, slots=True)
class Pointing:
    """Set points that turn the array to a transmitter.

    Attributes:
        set_points: (P, 6), all alike.
        off_rad: what is left between the array's normal and the transmitter.
        limit: what kept it from turning all the way.
    """

    set_points: Floats
    off_rad: float
    limit: Limit | None


def track_transmitter(
    transmitter_mm: Floats, dimensions: StackDimensions = FO_SHIP, limits: PlatformLimits = FO_SHIP_LIMITS
) -> Pointing:
    """Turn the array's normal (its x) to a transmitter (3,) of the rig frame.

    The published code adds the angles to a pose that it never sets, reads the transmitter's place into nowhere (two
    arguments of its scan lack their &), measures pitch with the wrong sign for z down, and takes the array to stand
    still while it turns. Here pitch and yaw of all platforms are those at which the normal of the array, where the
    turned stack carries it, meets the transmitter.
    """
    target = np.asarray(transmitter_mm, dtype=np.float64)
    if target.shape != (3,) or not np.isfinite(target).all():
        raise OutOfValidityError("the transmitter's place is x, y, z in mm, each a number")
    count = len(dimensions.platforms)
    wished = np.zeros(6)
    for _ in range(50):
        miss = _miss_rad(wished, target, dimensions)
        if np.abs(miss).max() < 1e-12:
            break
        wished[4:] = np.clip(wished[4:] + 0.7 * miss / count, -np.pi / 4.0, np.pi / 4.0)
    workspace = PlatformWorkspace(dimensions.platforms[0], limits)
    limit = workspace.broken(wished)
    if limit is not None:
        wished = _turn_within(wished, workspace)
    points = np.tile(wished, (count, 1))
    pose = stack_pose(points, dimensions)
    sight = target - pose.position_mm
    cosine = float(pose.rotation[:, 0] @ sight / np.linalg.norm(sight))
    return Pointing(points, float(np.arccos(np.clip(cosine, -1.0, 1.0))), limit)


def _miss_rad(one: Floats, target: Floats, dimensions: StackDimensions) -> Floats:
    """Pitch and yaw in the array's own frame from its normal to the transmitter, (2,): z is down, pitch up."""
    pose = stack_pose(np.tile(one, (len(dimensions.platforms), 1)), dimensions)
    x, y, z = pose.rotation.T @ (target - pose.position_mm)
    return np.array([-np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)])


def _turn_within(wished: Floats, workspace: PlatformWorkspace) -> Floats:
    """Each angle cut to its own limit, then both drawn back until the platform can stand so."""
    box = workspace.limits.axis_array()
    return workspace.nearest(np.clip(wished, -box, box))


def _each_axis(limits: AxisLimits | None, signs: Floats) -> Floats:
    most = (limits or AxisLimits()).array()
    rows = [np.zeros((len(signs), 6))]
    for axis in range(6):
        for sign in (1.0, -1.0):
            row = np.zeros((len(signs), 6))
            row[:, axis] = sign * signs * most[axis]
            rows.append(row)
    rows.append(np.zeros((len(signs), 6)))
    return np.stack(rows)
