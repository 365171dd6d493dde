"""`bluerov-slam convert`: a recorded dive for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from bluerov_slam.services.conversion import convert

FORMATS = ("jsonl", "csv", "klf", "xtf")


@click.command("convert")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--to", "target", type=click.Choice(FORMATS), required=True, help="csv makes a folder of three tables.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write; beside FILE by default.")
@click.option("--baud", default=115200, show_default=True, type=click.IntRange(9600, 4_000_000), help="Of a capture.")
@click.option("--swap", is_flag=True, help="Exchange A and B: the sonars' cables were crossed.")
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
def command(file: Path, target: str, output: Path | None, baud: int, swap: bool, force: bool) -> None:
    """Convert FILE (a session folder, its zip, an MCAP file or a plain capture of the serial link)."""
    if output is None:
        name = file.resolve().name
        stem = name if file.is_dir() else file.stem
        output = file.resolve().parent / (f"{stem}_csv" if target == "csv" else f"{stem}.{target}")
    for line in convert(file, target, output, baud=baud, swap=swap, force=force):
        click.echo(line)
