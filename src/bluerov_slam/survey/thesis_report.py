"""The report of the thesis's logs: its published table with the labels put right, errors, plots, held-out scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from html import escape

import numpy as np

from bluerov_slam.acoustics.slip_lattice import Floats
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.evaluation import thesis_table
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.thesis_held_out import Parameters
from bluerov_slam.survey.report_page import NO_PLOTS, drawn, figure_html, page_html, rows_html, table_html, verdict_html
from bluerov_slam.survey.thesis_study import ThesisStudy, held_out_rows

_LABEL_NOTE = (
    "The published table has the labels of its two filters exchanged. The receiver sends the position of the filter "
    "on acoustic fixes alone first and that of the filter with dead reckoning second; the analysis read them the "
    "other way round. Replaying both filters on the logged raw fixes shows it: the first column is met to the "
    "rounding of its print by the filter on sound alone, and by no other. So the best published model is iSBL-SF, "
    "and dead reckoning lowered the spread in every test, the opposite of what the text says."
)
_RECIPE_NOTE = (
    "Its rows: lines after a DISCARD and cut lines dropped, one log left out, and three times in each log every row "
    "dropped in which any of nine differences to the truth lies four standard deviations off. The numbers are the mean "
    "and the standard deviation of signed errors in mm. Neither is an error of position, and outliers cannot be "
    "removed by a truth that one does not have; the errors below are lengths, of all rows."
)

_SOURCE = (
    "<p class=sub>27 serial logs of 5 to 8 August 2024, in air: J. Frabosilio, master's thesis, Cal Poly San Luis "
    "Obispo (CC BY-SA 4.0). All figures are from real data.</p>"
)


def report_html(study: ThesisStudy, rows: Sequence[Row], parameters: Parameters) -> str:
    """The whole page; `rows` are those of `reproduced_rows`."""
    smoothed = held_out.estimates([each.measured for each in study.sessions], parameters, smoothed=True, anew=True)
    plots = _plots(study, smoothed)
    parts = [
        "<h1>Inverted short baseline: the thesis's logs</h1>",
        _SOURCE,
        "" if plots else NO_PLOTS,
        f"<h2>The published table, with its labels put right</h2><p>{escape(_LABEL_NOTE)}</p>",
        _table(thesis_table.published_table(study.logs)),
        f"<p>{escape(_RECIPE_NOTE)}</p>",
        "<h2>What the logs say</h2>",
        rows_html(rows),
        figure_html(
            plots, "scatter", "Errors by test",
            "iSBL-SF less truth, all rows. The ellipse holds 95 % of a normal distribution of the same spread; the "
            "errors are none: they lie in clusters.",
        ),
        figure_html(
            plots, "histograms", "Bands",
            "The platform stands still, yet raw fixes lie in bands: each is a carrier period slipped in one or two "
            "pairs of receivers. Their distance follows from geometry and carrier alone.",
        ),
        figure_html(
            plots, "geometry", "Error over range and angle",
            "One mark for each test. Raw fixes and the two logged filters: all rows of the test; slip lattice: second "
            "halves, started anew.",
        ),
        "<h2>Held-out halves</h2><p>All was found from the first half of each log and is scored on the second.</p>",
        figure_html(
            plots, "held_out", "",
            "How many rows of the second halves are within an error; the slip lattice started anew there.",
        ),
        rows_html(held_out_rows(study, parameters)),
    ]  # fmt: skip
    return page_html("Inverted short baseline: the thesis's logs", parts)


def held_out_report(study: ThesisStudy, rows: Sequence[Row], parameters: Parameters) -> str:
    """What `isbl heldout` states; `rows` are those of `held_out_rows`."""
    logs = [each.measured for each in study.sessions]
    smoothed, causal = (held_out.estimates(logs, parameters, smoothed=each, anew=True) for each in (True, False))

    def draw() -> dict[str, str]:
        from bluerov_slam.survey import thesis_half_plots

        return thesis_half_plots.draw_held_out(study, smoothed, causal)

    plots = drawn(draw)
    title = "Inverted short baseline: held-out halves of the thesis's logs"
    parts = [
        f"<h1>{title}</h1>",
        _SOURCE,
        "<p>All was found from the first half of each log and is scored on the second, where the filters start anew. "
        "Nothing is removed. Intervals come from resampling the logs.</p>",
        verdict_html(rows),
        "" if plots else NO_PLOTS,
        rows_html(rows),
        figure_html(
            plots, "held_out", "How many rows are within an error",
            "Rows of the second halves of all logs.",
        ),
        figure_html(
            plots, "half_scatter", "Errors by test",
            "The causal filter less truth, second halves. The ellipse holds 95 % of a normal distribution of the same "
            "spread.",
        ),
        figure_html(
            plots, "half_histograms", "Bands",
            "Logs of a standing platform, second halves: raw fixes lie in bands a slipped carrier period apart; the "
            "filter takes most of them for one place.",
        ),
        figure_html(plots, "half_geometry", "Error over range and angle", "One mark for each test, second halves."),
    ]  # fmt: skip
    return page_html(title, parts)


def training_report(study: ThesisStudy, parameters: Parameters, same: bool | None) -> str:
    """What `isbl calibrate` found; `same`: whether the package's own parameters came out, None if not asked."""

    def draw() -> dict[str, str]:
        from bluerov_slam.survey import thesis_half_plots

        return thesis_half_plots.draw_training(study, parameters)

    plots = drawn(draw)
    title = "Inverted short baseline: parameters from first halves"
    names = sorted({name for each in parameters.settings.values() for name in asdict(each)})
    settings = [(name, *(f"{getattr(each, name):g}" for each in parameters.settings.values())) for name in names]
    sessions = [
        (
            name,
            *(f"{value:.1f}" for value in told.coefficients_mm[0][:2]),
            str(told.coefficients_mm.shape[0]),
            *(f"{value:.2f}" for value in told.sd_mm),
            f"{100.0 * float(np.max(told.probability)):.0f} %",
            f"{100.0 * float(1.0 - np.max(told.probability)):.0f} %",
        )
        for name, told in sorted(parameters.calibrations.items())
    ]
    verdict = {None: "", True: "<p class=sub>The package's parameters came out, byte for byte.</p>"}.get(
        same, "<p class='banner bad'>They differ from the package's.</p>"
    )
    heads = ("Log", "bias in y, mm", "in z, mm", "terms", "noise in y, mm", "in z, mm", "fullest cell", "other cells")
    parts = [
        f"<h1>{title}</h1>",
        _SOURCE,
        "<p>From the first half of each log alone; settings are chosen by nested quarters of these halves.</p>",
        verdict,
        "" if plots else NO_PLOTS,
        "<h2>Settings by kind of motion</h2>",
        table_html(("Setting", *parameters.settings), settings, range(1, 1 + len(parameters.settings))),
        "<h2>Calibration of each session</h2>",
        table_html(heads, sessions, range(1, len(heads))),
        figure_html(
            plots, "cells", "Cells of the carrier",
            "How often fixes of the first half fell into each cell of the slip lattice, cells by size.",
        ),
        figure_html(
            plots, "half_histograms", "Bands",
            "Logs of a standing platform, first halves: raw fixes less truth, and in red where the lattice has its "
            "cells about the bias found.",
        ),
        figure_html(
            plots, "half_scatter", "Residuals by test",
            "First halves: raw fixes less truth, bias and nearest cell. The ellipse holds 95 % of a normal "
            "distribution of the same spread.",
        ),
    ]  # fmt: skip
    return page_html(title, parts)


def _plots(study: ThesisStudy, smoothed: dict[str, Floats]) -> dict[str, str] | None:
    def draw() -> dict[str, str]:
        from bluerov_slam.survey import thesis_plots

        return thesis_plots.draw(study, smoothed)

    return drawn(draw)


def _table(rows: Sequence[thesis_table.TableRow]) -> str:
    heads = "".join(
        f"<th class=n>{escape(thesis_table.ACTUAL_LABELS[name])}<br><small>published as "
        f"{escape(thesis_table.PUBLISHED_LABELS[name])}</small>: y<th class=n>z"
        for name in thesis_table.ESTIMATES
    )
    lines = []
    for row in rows:
        cells = "".join(
            f"<td class=n>{cell.y_mean:.1f} ± {cell.y_std:.1f}<td class=n>{cell.z_mean:.1f} ± {cell.z_std:.1f}"
            for cell in (row.cells[name] for name in thesis_table.ESTIMATES)
        )
        group = f"test {row.group}" if row.group.isdigit() else row.group
        lines.append(f"<tr><td>{escape(group)}<td class=n>{row.count}{cells}")
    return f"<table><tr><th>Group<th class=n>rows{heads}{''.join(lines)}</table>"
