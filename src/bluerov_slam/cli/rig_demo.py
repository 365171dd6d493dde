"""`bluerov-slam rig demo`: the thesis's demonstrations as set points in time."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from bluerov_slam.cli.rig_numbers import pose_words, show_set_points, write_set_points
from bluerov_slam.errors import ConfigError

DEMOS = ("axis-limits", "inverted-pairs", "circle", "tracking")


@click.command(name="demo", short_help="The thesis's demonstrations.")
@click.argument("name", type=click.Choice(DEMOS))
@click.option("--radius", "radius_deg", default=11.25, show_default=True, help="Of the circle, degrees of a platform.")
@click.option("--turns", default=1, show_default=True, type=click.IntRange(1, 100), help="Of the circle.")
@click.option("--transmitter", metavar="X,Y,Z", help="For tracking: its place in the rig's frame, mm.")
@click.option("--csv", "csv_file", type=click.Path(dir_okay=False, path_type=Path), help="Set points in time.")
def command(name: str, radius_deg: float, turns: int, transmitter: str | None, csv_file: Path | None) -> None:
    """Set points of a demonstration, smoothly timed for the servos; nothing moves."""
    from bluerov_slam.rig import demo
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.stack import stack_pose
    from bluerov_slam.rig.trajectory import smooth_path

    if (transmitter is not None) != (name == "tracking"):
        raise ConfigError("--transmitter goes with tracking, which needs it")
    if name == "axis-limits":
        waypoints = demo.axis_limits()
    elif name == "inverted-pairs":
        waypoints = demo.inverted_pairs()
    elif name == "circle":
        waypoints = demo.circle(float(np.radians(radius_deg)), turns=turns)
    else:
        waypoints = _tracking(str(transmitter))
    way = smooth_path(waypoints, FO_SHIP)
    places = stack_pose(way.set_points, FO_SHIP).position_mm
    spans = ", ".join(
        f"{axis} {low:.1f} to {high:.1f}"
        for axis, low, high in zip("xyz", places.min(axis=0), places.max(axis=0), strict=True)
    )
    click.echo(f"{name}: {len(waypoints)} set points, {way.duration_s:.1f} s; the tool goes through {spans} mm")
    if csv_file is not None:
        write_set_points(csv_file, way.times_s, way.set_points)
        click.echo(f"Set points in time: {csv_file}")


def _tracking(transmitter: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """From home to where the array looks at the transmitter."""
    from bluerov_slam.cli.isbl_simulate import three_numbers
    from bluerov_slam.rig.demo import track_transmitter
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.stack import stack_pose

    try:
        place = np.array(three_numbers(transmitter))
    except ValueError as error:
        raise ConfigError(f"--transmitter: {error}") from error
    found = track_transmitter(place)
    show_set_points(found.set_points)
    click.echo(f"Tool: {pose_words(stack_pose(found.set_points, FO_SHIP))}")
    if found.limit is None:
        click.echo(f"The array looks at the transmitter to {np.degrees(found.off_rad):.4f} degrees")
    else:
        click.echo(
            f"It cannot turn all the way ({found.limit.words}): {np.degrees(found.off_rad):.1f} degrees are left"
        )
    return np.stack([np.zeros_like(found.set_points), found.set_points])
