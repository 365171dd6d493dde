"""`bluerov-slam isbl reproduce`: the thesis's published table and filters, out of its raw logs."""

from __future__ import annotations

from pathlib import Path

import click

from bluerov_slam.cli.evaluation_options import LOGS, data_option, json_option, tell


@click.command(name="reproduce", short_help="The thesis's published results, from its raw logs.")
@data_option(LOGS)
@json_option
@click.option(
    "--report", "report_file", type=click.Path(dir_okay=False, path_type=Path), help="Write a report with plots (HTML)."
)
def command(data_folder: Path, json_file: Path | None, report_file: Path | None) -> None:
    """Reproduce the thesis's table, truth, filters and depth noise from its 27 serial logs.

    The published labels of the two filters are exchanged: what it calls iSBL-SF is the filter on acoustic fixes alone.
    Beside its table, which removes outliers by the truth, stand the errors without that.
    """
    from bluerov_slam.survey.thesis_study import read_study, reproduced_rows

    study = read_study(data_folder)
    click.echo("\n".join(f"{count:6d} {kind.value}" for kind, count in study.census.most_common()))
    rows = reproduced_rows(study)
    tell(rows, json_file)
    if report_file is not None:
        from bluerov_slam.survey.thesis_parameters import shipped_parameters
        from bluerov_slam.survey.thesis_report import report_html

        report_file.write_text(report_html(study, rows, shipped_parameters()), encoding="utf-8")
        click.echo(f"Wrote {report_file}")
