"""`bluerov-slam evaluate`: how good the product is, measured against truth, bounds and real recordings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bluerov_slam.cli.evaluation_options import (
    DATA_VARIABLE,
    data_option,
    run_all,
    run_options,
    tell,
    wanted_cases,
    warn_of_tuning_seeds,
)

if TYPE_CHECKING:
    from bluerov_slam.evaluation.navigation_cases import Job, Outcome
    from bluerov_slam.records import Record

DEFAULT_SEEDS = 30
_SNAPIR, _ACOUSTIC = "auv_dvl_gt_snapir", "bluerov2_ugps_dive"
_ACOUSTIC_LOGS = {"2024": "", "2022a": "qgc_2022-08-15_09-56-00.csv", "2022b": "qgc_2022-08-15_11-57-51.csv"}


@click.group(name="evaluate", short_help="Measure how good the estimates are.")
def command() -> None:
    """Measure how good the estimates are: many simulated dives with known truth, and real recordings."""


@command.command(name="navigation")
@click.option("--seeds", default=DEFAULT_SEEDS, show_default=True, type=click.IntRange(1), help="Dives of each case.")
@click.option("--cases", default="", help="Some of N1 to N8, as N1,N2; all by default.")
@run_options
@click.option(
    "--firmware",
    type=click.Choice(["auto", "native", "reference"]),
    default="auto",
    show_default=True,
    help="The board of the simulated dives.",
)
@data_option("Real recordings for N7 and N8")
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
    from bluerov_slam.evaluation.navigation_cases import CASES, jobs_for
    from bluerov_slam.evaluation.navigation_table import table

    wanted = wanted_cases(cases, CASES)
    warn_of_tuning_seeds(seed_base)
    wanted = [case for case in wanted if _has_data(case, data_folder)]
    tasks = [Task(job, firmware, str(data_folder)) for job in jobs_for(wanted, range(seed_base, seed_base + seeds))]
    found = run_all(run_task, tasks, jobs, scheduler)
    tell(table(wanted, [outcome for _, outcomes in found for outcome in outcomes]), json_file)


@dataclass(frozen=True, slots=True)
class Task:
    """A job with what its worker needs to find by itself."""

    job: Job
    firmware: str
    data_folder: str

    def __str__(self) -> str:
        return str(self.job)


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


def _has_data(case: str, folder: Path) -> bool:
    needed = {"N7": folder / _SNAPIR, "N8": folder / _ACOUSTIC}.get(case)
    if needed is None or needed.is_dir():
        return True
    click.echo(f"{case} is left out: it needs the recordings in {needed} (set {DATA_VARIABLE})", err=True)
    return False
