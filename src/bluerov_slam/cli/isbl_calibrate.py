"""`bluerov-slam isbl calibrate --train-only`: makes the parameter file of the filters over the thesis's logs."""

from __future__ import annotations

from pathlib import Path

import click

from bluerov_slam.cli.evaluation_options import LOGS, data_option, report_option, write_report
from bluerov_slam.errors import ConfigError


@click.command(name="calibrate", short_help="Calibrate and tune on the first halves of the thesis's logs.")
@data_option(LOGS)
@click.option("--train-only", is_flag=True, help="Use nothing but the first half of each log. There is no other way.")
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("thesis_parameters.json"),
    show_default=True,
    help="File to write.",
)
@click.option("--check", is_flag=True, help="Write nothing; say whether the package's file comes out, byte for byte.")
@report_option
def command(data_folder: Path, train_only: bool, out: Path, check: bool, report_file: Path | None) -> None:
    """Find biases, cell probabilities and noise from first halves; some minutes."""
    from bluerov_slam.evaluation.thesis_training import train
    from bluerov_slam.survey.thesis_parameters import as_text, shipped_text
    from bluerov_slam.survey.thesis_study import read_study

    if not train_only:
        raise ConfigError(
            "isbl calibrate needs --train-only: parameters that saw the second halves would score nothing"
        )
    study = read_study(data_folder)
    parameters = train([session.first for session in study.sessions], lambda line: click.echo(line, err=True))
    text = as_text(parameters)
    same = text == shipped_text() if check else None

    def report() -> str:
        from bluerov_slam.survey.thesis_report import training_report

        return training_report(study, parameters, same)

    write_report(report_file, report)
    if same is not None:
        click.echo("The package's parameters come out byte for byte" if same else "They differ from the package's")
        raise SystemExit(0 if same else 1)
    out.write_text(text, encoding="utf-8")
    click.echo(f"Wrote {out}")
