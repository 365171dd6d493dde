"""`bluerov-slam isbl heldout`: filters over the thesis's fixes, found on first halves, scored on second ones."""

from __future__ import annotations

import json
from pathlib import Path

import click

from bluerov_slam.cli.evaluation_options import LOGS, data_option, json_option, report_option, tell, write_report


@click.command(name="heldout", short_help="Score the filters on held-out halves of the thesis's logs.")
@data_option(LOGS)
@json_option
@report_option
@click.option(
    "--parameters",
    "parameter_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Made by isbl calibrate; those of the package by default.",
)
def command(data_folder: Path, json_file: Path | None, report_file: Path | None, parameter_file: Path | None) -> None:
    """Score causal filter and smoother on the second half of every log, beside what was published."""
    from bluerov_slam.evaluation.thesis_held_out import from_json
    from bluerov_slam.survey.thesis_parameters import shipped_parameters
    from bluerov_slam.survey.thesis_study import held_out_rows, read_study

    told = None if parameter_file is None else from_json(json.loads(parameter_file.read_text(encoding="utf-8")))
    study, parameters = read_study(data_folder), told or shipped_parameters()
    rows = held_out_rows(study, parameters)
    tell(rows, json_file)

    def report() -> str:
        from bluerov_slam.survey.thesis_report import held_out_report

        return held_out_report(study, rows, parameters)

    write_report(report_file, report)
