"""`bluerov-slam rig evaluate`: how good the rig's kinematics, plans and calibration are, against what is published."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bluerov_slam.cli.evaluate import as_text
from bluerov_slam.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bluerov_slam.acoustics.thesis_log import ThesisLog
    from bluerov_slam.evaluation.navigation_table import Row
    from bluerov_slam.evaluation.rig_cases import RigCase

DEFAULT_BASE, TUNING_SEEDS = 1000, 100
DATA_VARIABLE = "BLUEROV_SLAM_DATA"
THESIS_LOGS = Path("isbl_thesis") / "raw_logs.tar.gz"
_BESIDE_THE_CHECKOUT = Path(__file__).resolve().parents[4] / "shared" / "data"


@click.command(name="evaluate", short_help="Measure how good the rig's tools are.")
@click.option("--effort", default=1.0, show_default=True, type=click.FloatRange(0.0, min_open=True), help="Of draws.")
@click.option("--seed", default=DEFAULT_BASE, show_default=True, type=click.IntRange(0), help="Below 100: for tuning.")
@click.option("--cases", default="", help="Some of the cases, as R1,R2; all by default.")
@click.option(
    "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Write the table as JSON, too."
)
@click.option(
    "--data",
    "data_folder",
    type=click.Path(file_okay=False, path_type=Path),
    envvar=DATA_VARIABLE,
    default=_BESIDE_THE_CHECKOUT,
    help=f"Real recordings ({DATA_VARIABLE}).",
)
def command(effort: float, seed: int, cases: str, json_file: Path | None, data_folder: Path) -> None:
    """Run the cases R1... (docs/rig-calibration.md) and print what came out beside what must come out."""
    from bluerov_slam.evaluation.rig_cases import RigRun
    from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

    if seed < TUNING_SEEDS:
        click.echo(f"Seeds below {TUNING_SEEDS} were used for tuning: the figures are no test", err=True)
    rows: list[Row] = []
    for case in _wanted(cases):
        logs: Sequence[ThesisLog] = ()
        if case.needs_logs:
            archive = data_folder / THESIS_LOGS
            if not archive.is_file():
                click.echo(
                    f"{case.id} is left out: it needs the recordings in {archive} (set {DATA_VARIABLE})", err=True
                )
                continue
            logs = read_thesis_logs(archive).logs
        click.echo(f"{case.id} {case.title}", err=True)
        rows += case.run(RigRun(seed, effort, logs))
    click.echo(as_text(rows))
    if json_file is not None:
        json_file.write_text(json.dumps([row.as_json() for row in rows], indent=1) + "\n", encoding="utf-8")
    missed = [row.id for row in rows if row.met is False]
    click.echo(f"Not met: {', '.join(missed)}" if missed else "Every target is met")


def _wanted(cases: str) -> list[RigCase]:
    from bluerov_slam.evaluation.rig_cases import all_cases

    known = all_cases()
    names = [name.strip().upper() for name in cases.split(",") if name.strip()] or list(known)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(f"--cases: {', '.join(unknown)} is none of {', '.join(known)}")
    return [known[name] for name in names]
