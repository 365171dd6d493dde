"""The report of the thesis's logs: its published table with the labels put right, errors, plots, held-out scores."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from bluerov_slam.acoustics.slip_lattice import Floats
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.evaluation import thesis_table
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.thesis_held_out import Parameters
from bluerov_slam.survey.report_page import figure_html, page_html
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


def report_html(study: ThesisStudy, rows: Sequence[Row], parameters: Parameters) -> str:
    """The whole page; `rows` are those of `reproduced_rows`."""
    smoothed = held_out.estimates([each.measured for each in study.sessions], parameters, smoothed=True, anew=True)
    plots = _plots(study, smoothed)
    parts = [
        "<h1>Inverted short baseline: the thesis's logs</h1>",
        "<p class=sub>27 serial logs of 5 to 8 August 2024, in air: J. Frabosilio, master's thesis, Cal Poly San Luis "
        "Obispo (CC BY-SA 4.0). All figures are from real data.</p>",
        "" if plots else '<p class=banner>No plots: get matplotlib with pip install "bluerov-slam[survey]".</p>',
        f"<h2>The published table, with its labels put right</h2><p>{escape(_LABEL_NOTE)}</p>",
        _table(thesis_table.published_table(study.logs)),
        f"<p>{escape(_RECIPE_NOTE)}</p>",
        "<h2>What the logs say</h2>",
        _rows(rows),
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
        _rows(held_out_rows(study, parameters)),
    ]  # fmt: skip
    return page_html("Inverted short baseline: the thesis's logs", parts)


def _plots(study: ThesisStudy, smoothed: dict[str, Floats]) -> dict[str, str] | None:
    try:
        from bluerov_slam.survey import thesis_plots
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("matplotlib"):
            raise
        return None
    return thesis_plots.draw(study, smoothed)


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


def _rows(rows: Sequence[Row]) -> str:
    lines = []
    for row in rows:
        met = {True: "yes", False: "no", None: ""}[row.met]
        spread = "" if row.interval.low == row.interval.high else f"{row.interval.low:.3g} to {row.interval.high:.3g}"
        asked = "".join(
            f"<td class=n>{escape('' if target is None else str(target))}" for target in (row.must, row.aim)
        )
        lines.append(
            f"<tr><td>{escape(row.id)}<td>{escape(row.name)}<td class=n>{_shown(row.interval.value)} {escape(row.unit)}"
            f"<td class=n>{spread}{asked}<td>{met}"
        )
    head = "<tr><th>Id<th>Figure<th class=n>value<th class=n>95 %<th class=n>must<th class=n>aim<th>met"
    return f"<table>{head}{''.join(lines)}</table>"


def _shown(value: float) -> str:
    return f"{value:.0f}" if value == round(value) else f"{value:.4g}"
