"""`bluerov-slam rig evaluate`: how good the rig's kinematics, plans and calibration are, against what is published."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bluerov_slam.cli.evaluation_options import (
    DATA_VARIABLE,
    DEFAULT_BASE,
    data_option,
    json_option,
    tell,
    wanted_cases,
    warn_of_tuning_seeds,
)
from bluerov_slam.cli.finite_range import FiniteRange

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bluerov_slam.acoustics.thesis_log import ThesisLog
    from bluerov_slam.evaluation.navigation_table import Row
    from bluerov_slam.evaluation.rig_cases import RigCase

LARGEST_EFFORT = 10.0
"""More poses at once than this machine's memory is sure to hold."""
THESIS_LOGS = Path("isbl_thesis") / "raw_logs.tar.gz"


@click.command(name="evaluate", short_help="Measure how good the rig's tools are.")
@click.option(
    "--effort", default=1.0, show_default=True, type=FiniteRange(0.0, LARGEST_EFFORT, min_open=True), help="Of draws."
)
@click.option("--seed", default=DEFAULT_BASE, show_default=True, type=click.IntRange(0), help="Below 100: for tuning.")
@click.option("--cases", default="", help="Some of the cases, as R1,R2; all by default.")
@json_option
@data_option("Real recordings for R3")
@click.option(
    "--firmware",
    "build",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder with the firmware's brov-rig and report.json, for R9 [default: firmware/build of this checkout].",
)
def command(
    effort: float, seed: int, cases: str, json_file: Path | None, data_folder: Path, build: Path | None
) -> None:
    """Run the cases R1... (docs/rig-calibration.md) and print what came out beside what must come out."""
    from bluerov_slam.evaluation.rig_cases import RigFirmware, RigRun
    from bluerov_slam.services.rig_firmware import BUILD, firmware_angles_rad, instruction_counts
    from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

    warn_of_tuning_seeds(seed)
    rows: list[Row] = []
    built = build or BUILD
    firmware = RigFirmware(partial(firmware_angles_rad, build=built), partial(instruction_counts, build=built))
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
        rows += case.run(RigRun(seed, effort, logs, firmware))
    tell(rows, json_file)


def _wanted(cases: str) -> list[RigCase]:
    from bluerov_slam.evaluation.rig_cases import all_cases

    known = all_cases()
    return [known[name] for name in wanted_cases(cases, known)]
