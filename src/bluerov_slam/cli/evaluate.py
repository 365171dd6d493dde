"""`bluerov-slam evaluate`: how good the product is, measured against truth, bounds and real recordings."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bluerov_slam.errors import ConfigError

if TYPE_CHECKING:
    from bluerov_slam.evaluation.navigation_cases import Job, Outcome
    from bluerov_slam.evaluation.navigation_table import Row
    from bluerov_slam.records import Record

DEFAULT_SEEDS, DEFAULT_BASE = 30, 1000
TUNING_SEEDS = 100
DATA_VARIABLE = "BLUEROV_SLAM_DATA"
_BESIDE_THE_CHECKOUT = Path(__file__).resolve().parents[4] / "shared" / "data"
_SNAPIR, _ACOUSTIC = "auv_dvl_gt_snapir", "bluerov2_ugps_dive"
_ACOUSTIC_LOGS = {"2024": "", "2022a": "qgc_2022-08-15_09-56-00.csv", "2022b": "qgc_2022-08-15_11-57-51.csv"}


@click.group(name="evaluate", short_help="Measure how good the estimates are.")
def command() -> None:
    """Measure how good the estimates are: many simulated dives with known truth, and real recordings."""


@command.command(name="navigation")
@click.option("--seeds", default=DEFAULT_SEEDS, show_default=True, type=click.IntRange(1), help="Dives of each case.")
@click.option(
    "--seed-base",
    default=DEFAULT_BASE,
    show_default=True,
    type=click.IntRange(0),
    help="First seed; below 100 are those for tuning.",
)
@click.option("--cases", default="", help="Some of N1 to N8, as N1,N2; all by default.")
@click.option(
    "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Write the table as JSON, too."
)
@click.option("--jobs", default=0, type=click.IntRange(0), help="Processes; 0: one for each processor.")
@click.option(
    "--scheduler", default=None, help="A Dask scheduler to run on, as tcp://host:8786; by default this machine."
)
@click.option(
    "--firmware",
    type=click.Choice(["auto", "native", "reference"]),
    default="auto",
    show_default=True,
    help="The board of the simulated dives.",
)
@click.option(
    "--data",
    "data_folder",
    type=click.Path(file_okay=False, path_type=Path),
    envvar=DATA_VARIABLE,
    default=_BESIDE_THE_CHECKOUT,
    help=f"Real recordings for N7 and N8 ({DATA_VARIABLE}).",
)
def navigation(
    seeds: int,
    seed_base: int,
    cases: str,
    json_file: Path | None,
    jobs: int,
    scheduler: str | None,
    firmware: str,
    data_folder: Path,
) -> None:
    """Run the cases N1 to N8 (docs/evaluation.md) and print what came out beside what must come out."""
    from bluerov_slam.evaluation.navigation_cases import jobs_for
    from bluerov_slam.evaluation.navigation_table import table
    from bluerov_slam.survey.batch import Progress, run_batch

    wanted = _wanted(cases)
    if seed_base < TUNING_SEEDS:
        click.echo(f"Seeds below {TUNING_SEEDS} were used for tuning: the figures are no test", err=True)
    wanted = [case for case in wanted if _has_data(case, data_folder)]
    tasks = [Task(job, firmware, str(data_folder)) for job in jobs_for(wanted, range(seed_base, seed_base + seeds))]
    progress = Progress(len(tasks), lambda line: click.echo(line, err=True))
    outcomes: list[Outcome] = []
    try:
        for task, found in run_batch(run_task, tasks, jobs or os.cpu_count() or 1, scheduler):
            outcomes += found
            progress.done(str(task.job))
    except KeyboardInterrupt:
        click.echo("Stopped: nothing is stated from a part of the runs", err=True)
        raise SystemExit(130) from None
    rows = table(wanted, outcomes)
    click.echo(as_text(rows))
    if json_file is not None:
        json_file.write_text(json.dumps([row.as_json() for row in rows], indent=1) + "\n", encoding="utf-8")
    missed = [row.id for row in rows if row.met is False]
    click.echo(f"Not met: {', '.join(missed)}" if missed else "Every target is met")


@dataclass(frozen=True, slots=True)
class Task:
    """A job with what its worker needs to find by itself."""

    job: Job
    firmware: str
    data_folder: str


def run_task(task: Task) -> list[Outcome]:
    """Runs in a worker process."""
    from bluerov_slam.cli.firmware_choice import choose_board
    from bluerov_slam.evaluation import navigation_cases

    folder = Path(task.data_folder)
    if task.job.kind == "N7":
        tables = [(folder / _SNAPIR / f"{kind}_trajectory{task.job.part}.csv").read_text() for kind in ("DVL", "GT")]
        return [navigation_cases.run_snapir(task.job, *tables)]
    if task.job.kind == "N8":
        dive = task.job.part.split()[0]
        return [navigation_cases.run_held_out(task.job, _imported(str(folder / _ACOUSTIC / _ACOUSTIC_LOGS[dive])))]
    board, _ = choose_board(task.firmware, legacy=False)
    return navigation_cases.run_dive(task.job, board)


@cache
def _imported(path: str) -> list[Record]:
    """A real log's records; a worker takes several jobs on the same one."""
    from bluerov_slam.sources.log_import import read_log

    return read_log(Path(path)).records


def _wanted(cases: str) -> list[str]:
    from bluerov_slam.evaluation.navigation_cases import CASES

    names = [name.strip().upper() for name in cases.split(",") if name.strip()] or list(CASES)
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise ConfigError(f"--cases: {', '.join(unknown)} is none of {', '.join(CASES)}")
    return names


def _has_data(case: str, folder: Path) -> bool:
    needed = {"N7": folder / _SNAPIR, "N8": folder / _ACOUSTIC}.get(case)
    if needed is None or needed.is_dir():
        return True
    click.echo(f"{case} is left out: it needs the recordings in {needed} (set {DATA_VARIABLE})", err=True)
    return False


def as_text(rows: list[Row]) -> str:
    """The table for a terminal."""
    lines = [("id", "figure", "value", "95 % interval", "unit", "must", "aim", "/ bound", "met")]
    for row in rows:
        interval = row.interval
        lines.append(
            (
                row.id,
                row.name,
                f"{interval.value:.3g}",
                f"{interval.low:.3g}..{interval.high:.3g}",
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
