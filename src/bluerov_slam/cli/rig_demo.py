"""`bluerov-slam rig demo`: the thesis's demonstrations as set points in time, or on a real rig."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from bluerov_slam.cli.finite_range import FiniteRange
from bluerov_slam.cli.rig_numbers import pose_words, show_set_points, transmitter_of, write_set_points
from bluerov_slam.cli.rig_real import announced, move_option, port_option
from bluerov_slam.errors import CommandError, ConfigError, OutOfValidityError

Floats = NDArray[np.float64]

DEMOS = ("axis-limits", "inverted-pairs", "circle", "tracking")
TABLE_STEP_S = 0.02
CAREFUL = 0.2
"""Of the servos' speed, on a real rig: the whole speed would throw a metre of stack round its circle in 1.5 s."""


@click.command(name="demo", short_help="The thesis's demonstrations.")
@click.argument("name", type=click.Choice(DEMOS))
@click.option(
    "--radius",
    "radius_deg",
    default=11.25,
    show_default=True,
    type=FiniteRange(0.0, 45.0, min_open=True),
    help="Of the circle, degrees of a platform.",
)
@click.option("--turns", default=1, show_default=True, type=click.IntRange(1, 100), help="Of the circle.")
@click.option("--transmitter", metavar="X,Y,Z", help="For tracking: its place in the rig's frame, mm.")
@click.option("--csv", "csv_file", type=click.Path(dir_okay=False, path_type=Path), help="Set points in time.")
@click.option(
    "--speed",
    "share",
    type=FiniteRange(0.02, 1.0),
    help=f"Share of the servos' speed [default: 1, {CAREFUL:g} with --port].",
)
@port_option
@move_option
def command(
    name: str,
    radius_deg: float,
    turns: int,
    transmitter: str | None,
    csv_file: Path | None,
    share: float | None,
    port: Path | None,
    move_for_real: bool,
) -> None:
    """Set points of a demonstration, smoothly timed for the servos; only a rig at --port moves."""
    from bluerov_slam.rig import demo
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.stack import stack_pose
    from bluerov_slam.rig.trajectory import STEP_S, smooth_path

    if (transmitter is not None) != (name == "tracking"):
        raise ConfigError("--transmitter goes with tracking, which needs it")
    if move_for_real and port is None:
        raise ConfigError("--move-for-real is for a real rig: give its --port, too")
    if name == "axis-limits":
        waypoints = demo.axis_limits()
    elif name == "inverted-pairs":
        waypoints = demo.inverted_pairs()
    elif name == "circle":
        waypoints = demo.circle(float(np.radians(radius_deg)), turns=turns)
    else:
        waypoints = _tracking(str(transmitter))
    if share is None:
        share = 1.0 if port is None else CAREFUL
    # Calculated at the servos' whole speed and played slower: the path stays the same, forces fall with the square.
    try:
        way = smooth_path(waypoints, FO_SHIP, step_s=share * (TABLE_STEP_S if port is None else STEP_S))
    except OutOfValidityError as error:
        if name != "circle":
            raise
        raise ConfigError(
            f"--radius {radius_deg:g} is more than the rig can do: {error}; give a smaller one"
        ) from error
    times_s = way.times_s / share
    places = stack_pose(way.set_points, FO_SHIP).position_mm
    spans = ", ".join(
        f"{axis} {low:.1f} to {high:.1f}"
        for axis, low, high in zip("xyz", places.min(axis=0), places.max(axis=0), strict=True)
    )
    what = f"{name}: {len(waypoints)} set points, {times_s[-1]:.1f} s; the tool goes through {spans} mm"
    if port is None:
        click.echo(what)
    if csv_file is not None:
        write_set_points(csv_file, times_s, way.set_points)
        click.echo(f"Set points in time: {csv_file}")
    if port is not None and announced([what], move_for_real):
        _move(port, way.set_points, waypoints)


def _move(port: Path, set_points: Floats, waypoints: Floats) -> None:
    """On a real rig."""
    from bluerov_slam.services.rig import AT_HOME, connected_alone
    from bluerov_slam.services.rig_way import run_way

    try:
        with connected_alone(port, click.echo) as rig:
            reason = run_way(rig, set_points, waypoints)
    except KeyboardInterrupt:
        click.echo("Stopped by Ctrl-C: the rig holds where it is. Its button sends it home", err=True)
        raise SystemExit(130) from None
    if reason:
        raise CommandError(f"the demonstration ended early: {reason}")
    home = bool(np.all(np.abs(set_points[-1]) <= AT_HOME))
    click.echo("Done: the rig is at home" if home else "Done: the rig stays there. Its button sends it home")


def _tracking(transmitter: str) -> Floats:
    """From home to where the array looks at the transmitter."""
    from bluerov_slam.rig.demo import track_transmitter
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.stack import stack_pose

    found = track_transmitter(np.array(transmitter_of(transmitter)))
    show_set_points(found.set_points)
    click.echo(f"Tool: {pose_words(stack_pose(found.set_points, FO_SHIP))}")
    if found.limit is None:
        click.echo(f"The array looks at the transmitter to {np.degrees(found.off_rad):.4f} degrees")
    else:
        click.echo(
            f"It cannot turn all the way ({found.limit.words}): {np.degrees(found.off_rad):.1f} degrees are left"
        )
    return np.stack([np.zeros_like(found.set_points), found.set_points])
