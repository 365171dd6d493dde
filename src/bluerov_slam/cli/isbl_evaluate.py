"""`bluerov-slam isbl evaluate`: how good acoustic positioning is, against truth, bounds and the thesis's chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bluerov_slam.cli.evaluation_options import (
    DATA_VARIABLE,
    data_option,
    report_option,
    run_all,
    run_options,
    tell,
    wanted_cases,
    warn_of_tuning_seeds,
    write_report,
)

if TYPE_CHECKING:
    from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob

DEFAULT_DRAWS = 1000


@click.command(name="evaluate", short_help="Measure how good acoustic positioning is.")
@click.option("--draws", default=DEFAULT_DRAWS, show_default=True, type=click.IntRange(1), help="Records of each cell.")
@click.option("--cases", default="", help="Some of the cases, as I1,I2; all by default.")
@run_options
@report_option
@data_option("Real recordings for I20 and I21")
def command(
    draws: int,
    cases: str,
    seed_base: int,
    json_file: Path | None,
    report_file: Path | None,
    jobs: int,
    scheduler: str | None,
    data_folder: Path,
) -> None:
    """Run the cases I1... (docs/acoustics.md) and print what came out beside what must come out.

    I20 and I21 are what `isbl reproduce` and `isbl heldout` state; without the logs a row says that they were skipped.
    """
    from bluerov_slam.evaluation.acoustic_cases import jobs_for, skipped_row, table

    wanted = _wanted(cases)
    warn_of_tuning_seeds(seed_base)
    there = [case for case in wanted if not case.material or (data_folder / case.material).is_dir()]
    folders = {case.id: str(data_folder / case.material) if case.material else "" for case in there}
    tasks = [Task(job, folders[job.case]) for job in jobs_for(there, draws, seed_base)]
    found = [(task.job, outcome) for task, outcome in run_all(run_task, tasks, jobs, scheduler)] if tasks else []
    rows = []
    for case in wanted:
        if case in there:
            rows += table([case], found)
        else:
            rows.append(skipped_row(case, f"no {data_folder / case.material} (set {DATA_VARIABLE})"))
    tell(rows, json_file)

    def report() -> str:
        from bluerov_slam.survey.acoustic_report import evaluation_report

        return evaluation_report(wanted, found, rows)

    write_report(report_file, report)


@dataclass(frozen=True, slots=True)
class Task:
    """A job, and the folder of its recordings ("" for none)."""

    job: AcousticJob
    folder: str

    def __str__(self) -> str:
        return str(self.job)


def run_task(task: Task) -> Any:
    """Runs in a worker process."""
    from bluerov_slam.survey.acoustic_evaluation import every_case

    return every_case()[task.job.case].run(task.job, _contents(task.folder))


@cache
def _contents(folder: str) -> Mapping[str, bytes]:
    """Files of a folder by name; a worker takes several jobs on the same ones."""
    return {each.name: each.read_bytes() for each in sorted(Path(folder).iterdir()) if each.is_file()} if folder else {}


def _wanted(cases: str) -> list[AcousticCase]:
    from bluerov_slam.survey.acoustic_evaluation import every_case

    known = every_case()
    return [known[name] for name in wanted_cases(cases, known)]
