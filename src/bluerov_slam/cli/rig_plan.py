"""`bluerov-slam rig plan`: a smooth way of the tool through some poses."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from bluerov_slam.cli.finite_range import FiniteRange
from bluerov_slam.cli.rig_numbers import AIMS, FORM, pose_of, pose_words, show_set_points, write_set_points
from bluerov_slam.cli.rig_pose import UnreachableError


@click.command(name="plan", short_help="A smooth way of the tool through poses.")
@click.option(
    "--tool", "tools", multiple=True, required=True, metavar=FORM, help="A pose to pass, in order; repeat it."
)
@click.option("--aim", type=click.Choice(AIMS), default="least_motion", show_default=True)
@click.option(
    "--servo-speed", "speed_radps", default=5.0, show_default=True, type=FiniteRange(0.01, 50.0), help="rad/s."
)
@click.option("--csv", "csv_file", type=click.Path(dir_okay=False, path_type=Path), help="Set points in time.")
def command(tools: tuple[str, ...], aim: str, speed_radps: float, csv_file: Path | None) -> None:
    """From home through every --tool, each planned from the set points before, as fast as the servos allow."""
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.planner import plan_set_points
    from bluerov_slam.rig.trajectory import smooth_path
    from bluerov_slam.rig.workspace import StackWorkspace

    space = StackWorkspace()
    waypoints = [np.zeros((len(FO_SHIP.platforms), 6))]
    for number, text in enumerate(tools, start=1):
        found = plan_set_points(pose_of(text), aim=aim, start=waypoints[-1], workspace=space)  # type: ignore[arg-type]
        if not found.reached:
            raise UnreachableError(f"pose {number}: {found.words} It is {pose_words(found.pose)}")
        click.echo(f"Pose {number}: {pose_words(found.pose)}; margin {found.margin:.3f}")
        show_set_points(found.set_points)
        waypoints.append(found.set_points)
    way = smooth_path(np.array(waypoints), FO_SHIP, speed_radps)
    click.echo(
        f"{way.duration_s:.2f} s in {len(way.times_s) - 1} steps; no faster way on this path: {way.bound_s:.2f} s"
    )
    if csv_file is not None:
        write_set_points(csv_file, way.times_s, way.set_points)
        click.echo(f"Set points in time: {csv_file}")
