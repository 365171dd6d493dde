"""`bluerov-slam import`: logs of autopilot, ground station and acoustic positioning as recordings of our own."""

from __future__ import annotations

from pathlib import Path

import click

from bluerov_slam.services.log_import import import_log


@click.command("import")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the new sessions; beside FILE by default.")
@click.option(
    "--utc-offset",
    "utc_offset_h",
    type=click.FloatRange(-14.0, 14.0),
    help="Hours that a QGroundControl CSV log's local time is ahead of UTC, for example -7.",
)
def command(files: tuple[Path, ...], out: Path | None, utc_offset_h: float | None) -> None:
    """Make recordings of FILES: ArduSub .tlog or .BIN, QGroundControl CSV, or a folder of Water Linked G2 CSV files.

    Each becomes a session folder that replay, convert and navigate take.
    """
    for file in files:
        for line in import_log(file, out or file.resolve().parent, utc_offset_h).lines:
            click.echo(line)
