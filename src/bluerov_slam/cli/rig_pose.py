"""`bluerov-slam rig pose`: where the tool is at some set points, or set points for a wanted pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from bluerov_slam.cli.rig_numbers import AIMS, FORM, attitude_of, pose_of, pose_words, show_set_points, stack_of
from bluerov_slam.errors import ConfigError, ExpectedError

if TYPE_CHECKING:
    from bluerov_slam.rig.stack import StackPose

Array = NDArray[np.float64]

CHI2_999_3DOF = 16.27


class UnreachableError(ExpectedError):
    """A pose that the rig cannot make."""


@click.command(name="pose", short_help="Set points to the tool's pose, or back.")
@click.option(
    "--set-point",
    "set_points",
    multiple=True,
    metavar=FORM,
    help="Of each platform, mm and degrees: once for all alike, or four times, base to top.",
)
@click.option("--tool", metavar=FORM, help="A wanted pose of the tool in the rig's frame, mm and degrees.")
@click.option("--aim", type=click.Choice(AIMS), default="least_motion", show_default=True, help="With --tool.")
@click.option(
    "--attitude", metavar="ROLL,PITCH,YAW", help="With --set-point: what an IMU on the tool measured, degrees."
)
def command(set_points: tuple[str, ...], tool: str | None, aim: str, attitude: str | None) -> None:
    """The tool's pose and how well it is known at set points, or the set points that make a pose (docs/rig.md)."""
    if bool(set_points) == bool(tool):
        raise ConfigError("give either --set-point or --tool")
    if tool is not None:
        if attitude is not None:
            raise ConfigError("--attitude goes with --set-point")
        _plan(tool, aim)
        return
    points = stack_of(set_points, "--set-point")
    _tell(points, None if attitude is None else attitude_of(attitude))


def _plan(tool: str, aim: str) -> None:
    from bluerov_slam.rig.planner import plan_set_points

    found = plan_set_points(pose_of(tool), aim=aim)  # type: ignore[arg-type]
    click.echo(found.words)
    click.echo(f"Tool: {pose_words(found.pose)}")
    show_set_points(found.set_points)
    click.echo(f"Least margin {found.margin:.3f} (1 at best, 0 at a limit), worst condition {found.condition:.1f}")
    if not found.reached:
        raise UnreachableError("the pose itself is out of reach; shown is the nearest that is not")


def _tell(points: Array, attitude_rad: Array | None) -> None:
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.stack import stack_pose
    from bluerov_slam.rig.uncertainty import pose_covariance
    from bluerov_slam.rig.validation import logged_spread
    from bluerov_slam.rig.workspace import PlatformWorkspace

    limit = next((broken for point in points if (broken := PlatformWorkspace().broken(point)) is not None), None)
    if limit is not None:
        nearest = np.array([PlatformWorkspace().nearest(point) for point in points])
        click.echo("The nearest set points on the way from home that can be reached:")
        show_set_points(nearest)
        raise UnreachableError(f"these set points cannot be reached: {limit.words}")
    show_set_points(points)
    pose = stack_pose(points, FO_SHIP)
    covariance = pose_covariance(points, FO_SHIP, logged_spread())
    if attitude_rad is not None:
        pose, covariance = _mended(points, attitude_rad)
    std = np.sqrt(np.diag(covariance))
    click.echo(f"Tool: {pose_words(pose)}")
    click.echo(
        f"1 sigma: x {std[0]:.2f}, y {std[1]:.2f}, z {std[2]:.2f} mm; turn about x, y, z "
        + ", ".join(f"{value:.2f}" for value in np.degrees(std[3:]))
        + " deg (tolerances as the thesis states them; gains, lean and play as its logs show)"
    )


def _mended(points: Array, attitude_rad: Array) -> tuple[StackPose, Array]:
    """Pose and covariance with the attitude that was measured on the tool."""
    from bluerov_slam.geometry.platform_stack import rotations
    from bluerov_slam.rig.collection_truth import LEVEL_STD_RAD, YAW_STD_RAD
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.stack import StackPose
    from bluerov_slam.rig.tool_truth import tool_truth
    from bluerov_slam.rig.validation import logged_spread

    std = np.array((LEVEL_STD_RAD, LEVEL_STD_RAD, YAW_STD_RAD))
    found = tool_truth(points, rotations(attitude_rad[None])[0], std, FO_SHIP, logged_spread())
    if found.surprise > CHI2_999_3DOF:
        click.echo(
            f"The attitude is far from what was set (chi-square {found.surprise:.0f} of three): "
            "is a servo stuck or off?"
        )
    return StackPose(found.position_mm, found.rotation), found.covariance
