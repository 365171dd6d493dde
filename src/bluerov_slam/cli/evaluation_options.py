"""What the commands that measure share: their options, the driving of many jobs, the table that comes out."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from bluerov_slam.errors import ConfigError
from bluerov_slam.sinks.whole_output import in_whole

if TYPE_CHECKING:
    from bluerov_slam.evaluation.navigation_table import Row

Task = TypeVar("Task")
Result = TypeVar("Result")
Command = Callable[..., Any]

DEFAULT_BASE, TUNING_SEEDS = 1000, 100
DATA_VARIABLE = "BLUEROV_SLAM_DATA"
LOGS = "Folder with isbl_thesis, the thesis's logs"
_BESIDE_THE_CHECKOUT = Path(__file__).resolve().parents[4] / "shared" / "data"

json_option = click.option(
    "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Write the table as JSON, too."
)

report_option = click.option(
    "--report",
    "report_file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a report with plots there: one HTML file.",
)


def write_report(report_file: Path | None, make: Callable[[], str]) -> None:
    """The page in one piece, if one is asked for. Raises ConfigError where it cannot be written."""
    if report_file is None:
        return
    page = make()
    try:
        with in_whole(report_file) as unfinished:
            unfinished.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--report {report_file}: {error.strerror}") from error
    click.echo(f"Wrote {report_file}")


def data_option(what: str) -> Callable[[Command], Command]:
    """--data: where real recordings are; `what` says which."""
    return click.option(
        "--data",
        "data_folder",
        type=click.Path(file_okay=False, path_type=Path),
        envvar=DATA_VARIABLE,
        default=_BESIDE_THE_CHECKOUT,
        help=f"{what} ({DATA_VARIABLE}).",
    )


def run_options(command: Command) -> Command:
    """--seed-base, --json, --jobs, --scheduler."""
    for option in (
        click.option(
            "--scheduler", default=None, help="A Dask scheduler to run on, as tcp://host:8786; by default this machine."
        ),
        click.option("--jobs", default=0, type=click.IntRange(0), help="Processes; 0: one for each processor."),
        json_option,
        click.option(
            "--seed-base",
            default=DEFAULT_BASE,
            show_default=True,
            type=click.IntRange(0),
            help=f"First seed; below {TUNING_SEEDS} are those for tuning.",
        ),
    ):
        command = option(command)
    return command


def wanted_cases(cases: str, known: Collection[str]) -> list[str]:
    """The ids of "I1, i2"; all that are known where none is named. Raises ConfigError."""
    names = [name.strip().upper() for name in cases.split(",") if name.strip()] or list(known)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(f"--cases: {', '.join(unknown)} is none of {', '.join(known)}")
    return names


def warn_of_tuning_seeds(seed_base: int) -> None:
    """Says so where seeds are no test."""
    if seed_base < TUNING_SEEDS:
        click.echo(f"Seeds below {TUNING_SEEDS} were used for tuning: the figures are no test", err=True)


def run_all(
    function: Callable[[Task], Result], tasks: Sequence[Task], jobs: int, scheduler: str | None
) -> list[tuple[Task, Result]]:
    """What every task gave, in any order, with a line of progress for each. Ctrl-C ends the command: 130."""
    from bluerov_slam.survey.batch import run_counted

    try:
        return run_counted(
            function, tasks, jobs or os.cpu_count() or 1, scheduler, lambda line: click.echo(line, err=True)
        )
    except KeyboardInterrupt:
        click.echo("Stopped: nothing is stated from a part of the runs", err=True)
        raise SystemExit(130) from None


def tell(rows: Sequence[Row], json_file: Path | None) -> None:
    """The figures on the terminal and, if asked, in a file."""
    click.echo(as_text(rows))
    if json_file is not None:
        try:
            json_file.write_text(json.dumps([row.as_json() for row in rows], indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"cannot write {json_file}: {error.strerror or error}; the table above is all that there is. "
                "Give --json another place"
            ) from error
    missed = [row.id for row in rows if row.met is False]
    click.echo(f"Not met: {', '.join(missed)}" if missed else "Every target is met")


def as_text(rows: Sequence[Row]) -> str:
    """The table for a terminal."""
    lines = [("id", "figure", "value", "95 % interval", "unit", "must", "aim", "/ bound", "met")]
    for row in rows:
        interval = row.interval
        lines.append(
            (
                row.id,
                row.name,
                _number(interval.value),
                "" if math.isnan(interval.low) else f"{interval.low:.3g}..{interval.high:.3g}",
                row.unit,
                "" if row.must is None else str(row.must),
                "" if row.aim is None else str(row.aim),
                "" if row.bound_ratio is None else f"{row.bound_ratio:.2f}",
                {True: "yes", False: "NO", None: ""}[row.met],
            )
        )
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"
