"""What the commands about the thesis's logs share: where the logs are, and how figures are shown."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bluerov_slam.cli.evaluate import as_text

if TYPE_CHECKING:
    from bluerov_slam.evaluation.navigation_table import Row

_BESIDE_THE_CHECKOUT = Path(__file__).resolve().parents[4] / "shared" / "data"


def data_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """--data, as `evaluate` has it."""
    return click.option(
        "--data",
        "data_folder",
        type=click.Path(file_okay=False, path_type=Path),
        envvar="BLUEROV_SLAM_DATA",
        default=_BESIDE_THE_CHECKOUT,
        help="Folder with isbl_thesis, the thesis's logs (BLUEROV_SLAM_DATA).",
    )(command)


def json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """--json, as `evaluate` has it."""
    return click.option(
        "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Write the table as JSON, too."
    )(command)


def tell(rows: list[Row], json_file: Path | None) -> None:
    """The figures on the terminal and, if asked, in a file."""
    click.echo(as_text(rows))
    if json_file is not None:
        json_file.write_text(json.dumps([row.as_json() for row in rows], indent=1) + "\n", encoding="utf-8")
    missed = [row.id for row in rows if row.met is False]
    click.echo(f"Not met: {', '.join(missed)}" if missed else "Every target is met")
