"""`bluerov-slam navigate`: where the vehicle was during a recorded dive, and how well that is known."""

from __future__ import annotations

from pathlib import Path

import click

from bluerov_slam.cli.service_options import parse_flags
from bluerov_slam.services.navigation_settings import recorded_options
from bluerov_slam.survey.navigation_products import navigate


@click.command("navigate")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make; beside RECORDING by default.")
@click.option("--no-smooth", is_flag=True, help="The track as it was known live, without what was measured later.")
@click.option("--state", type=click.Path(path_type=Path), help="Take the calibrations from this saved state.")
@click.option("--set", "flags", multiple=True, metavar="navigation.KEY=VALUE", help="One setting; repeatable.")
@click.option("--baud", default=115200, show_default=True, type=click.IntRange(9600, 4_000_000), help="Of a capture.")
@click.option("--force", is_flag=True, help="Replace the folder if it exists.")
def command(
    recording: Path,
    out: Path | None,
    no_smooth: bool,
    state: Path | None,
    flags: tuple[str, ...],
    baud: int,
    force: bool,
) -> None:
    """Run the navigator over RECORDING (a session folder, its zip, an MCAP file or a plain capture).

    Writes the track as GeoJSON, GPX, CSV and MCAP, a report to read (report.html) and figures (summary.json). The
    settings are those of the time of recording, unless --set gives others.
    """
    values = parse_flags(flags)
    lines = navigate(
        recording,
        out,
        smooth=not no_smooth,
        baud=baud,
        options=lambda opened: recorded_options(opened.navigation_settings, values),
        state_file=state,
        force=force,
    )
    for line in lines:
        click.echo(line)
