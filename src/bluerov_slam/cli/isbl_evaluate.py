"""`bluerov-slam isbl evaluate`: how good acoustic positioning is, against truth, bounds and the thesis's chain."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bluerov_slam.cli.evaluate import as_text
from bluerov_slam.errors import ConfigError

if TYPE_CHECKING:
    from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob

DEFAULT_DRAWS, DEFAULT_BASE = 1000, 1000
TUNING_SEEDS = 100
DATA_VARIABLE = "BLUEROV_SLAM_DATA"
_BESIDE_THE_CHECKOUT = Path(__file__).resolve().parents[4] / "shared" / "data"


@click.command(name="evaluate", short_help="Measure how good acoustic positioning is.")
@click.option("--draws", default=DEFAULT_DRAWS, show_default=True, type=click.IntRange(1), help="Records of each cell.")
@click.option(
    "--seed-base",
    default=DEFAULT_BASE,
    show_default=True,
    type=click.IntRange(0),
    help="First seed; below 100 are those for tuning.",
)
@click.option("--cases", default="", help="Some of the cases, as I1,I2; all by default.")
@click.option(
    "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Write the table as JSON, too."
)
@click.option("--jobs", default=0, type=click.IntRange(0), help="Processes; 0: one for each processor.")
@click.option(
    "--data",
    "data_folder",
    type=click.Path(file_okay=False, path_type=Path),
    envvar=DATA_VARIABLE,
    default=_BESIDE_THE_CHECKOUT,
    help=f"Real recordings ({DATA_VARIABLE}).",
)
def command(draws: int, seed_base: int, cases: str, json_file: Path | None, jobs: int, data_folder: Path) -> None:
    """Run the cases I1... (docs/acoustics-timing.md) and print what came out beside what must come out."""
    from bluerov_slam.evaluation.acoustic_cases import jobs_for, table
    from bluerov_slam.survey.batch import Progress, run_batch

    wanted = [case for case in _wanted(cases) if _has_data(case, data_folder)]
    if seed_base < TUNING_SEEDS:
        click.echo(f"Seeds below {TUNING_SEEDS} were used for tuning: the figures are no test", err=True)
    folders = {case.id: str(data_folder / case.material) if case.material else "" for case in wanted}
    tasks = [Task(job, folders[job.case]) for job in jobs_for(wanted, draws, seed_base)]
    progress = Progress(len(tasks), lambda line: click.echo(line, err=True))
    found: list[tuple[AcousticJob, Any]] = []
    try:
        for task, outcome in run_batch(run_task, tasks, jobs or os.cpu_count() or 1):
            found.append((task.job, outcome))
            progress.done(str(task.job))
    except KeyboardInterrupt:
        click.echo("Stopped: nothing is stated from a part of the runs", err=True)
        raise SystemExit(130) from None
    rows = table(wanted, found)
    click.echo(as_text(rows))
    if json_file is not None:
        json_file.write_text(json.dumps([row.as_json() for row in rows], indent=1) + "\n", encoding="utf-8")
    missed = [row.id for row in rows if row.met is False]
    click.echo(f"Not met: {', '.join(missed)}" if missed else "Every target is met")


@dataclass(frozen=True, slots=True)
class Task:
    """A job, and the folder of its recordings ("" for none)."""

    job: AcousticJob
    folder: str


def run_task(task: Task) -> Any:
    """Runs in a worker process."""
    from bluerov_slam.evaluation.acoustic_cases import all_cases

    return all_cases()[task.job.case].run(task.job, _contents(task.folder))


@cache
def _contents(folder: str) -> Mapping[str, bytes]:
    """Files of a folder by name; a worker takes several jobs on the same ones."""
    return {each.name: each.read_bytes() for each in sorted(Path(folder).iterdir()) if each.is_file()} if folder else {}


def _wanted(cases: str) -> list[AcousticCase]:
    from bluerov_slam.evaluation.acoustic_cases import all_cases

    known = all_cases()
    names = [name.strip().upper() for name in cases.split(",") if name.strip()] or list(known)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(f"--cases: {', '.join(unknown)} is none of {', '.join(known)}")
    return [known[name] for name in names]


def _has_data(case: AcousticCase, folder: Path) -> bool:
    if not case.material or (folder / case.material).is_dir():
        return True
    needed = folder / case.material
    click.echo(f"{case.id} is left out: it needs the recordings in {needed} (set {DATA_VARIABLE})", err=True)
    return False
