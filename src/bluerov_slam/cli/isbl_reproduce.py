"""`bluerov-slam isbl reproduce`: the thesis's published table and filters, out of its raw logs."""

from __future__ import annotations

from pathlib import Path

import click

from bluerov_slam.cli.evaluation_options import LOGS, data_option, json_option, report_option, tell, write_report


@click.command(name="reproduce", short_help="The thesis's published results, from its raw logs.")
@data_option(LOGS)
@json_option
@report_option
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

    def report() -> str:
        from bluerov_slam.survey.thesis_parameters import shipped_parameters
        from bluerov_slam.survey.thesis_report import report_html

        return report_html(study, rows, shipped_parameters())

    write_report(report_file, report)
