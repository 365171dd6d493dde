"""The report of a collection with a rig: the thesis's table, honest errors beside it, and how good the truth is."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from html import escape

from bluerov_slam.evaluation import rig_table
from bluerov_slam.evaluation.rig_table import Collected
from bluerov_slam.evaluation.thesis_table import Cell, TableRow
from bluerov_slam.survey.report_page import figure_html, page_html

_METRIC_NOTE = (
    "Mean and standard deviation of signed errors against the truth as published, after three passes in which every "
    "row is dropped that lies four standard deviations off in any of its differences to that truth. It is the thesis's "
    "metric (figures 6.18 and 6.19), with its recipe, so that its numbers can be held beside these. It is no error of "
    "position, and no user can drop outliers by a truth that is not there."
)
_HONEST_NOTE = (
    "Lengths of the error across the line of sight (y and z; x is given, not measured), of every point with a result: "
    "nothing removed, start-up of the filters included."
)


def report_html(sessions: Sequence[Collected], source: str, seed: int | None = None) -> str:
    """The whole page. `source`: "simulated" or what the rig was connected to."""
    simulated = source == "simulated"
    plots = _plots(sessions, "real" if simulated else "rig")
    kind = "Everything here is simulated" if simulated else f"Measured with the rig at {source}"
    drawn = "" if seed is None else f" Seed {seed}."
    parts = [
        "<h1>Data collection with the ground-truth rig</h1>",
        f"<p class=sub>{escape(kind)}: {len(sessions)} sessions, {_count(sessions)} points.{drawn}</p>",
        '<p class="banner"><b>Simulated.</b> Rig, air, receivers and noise come from the simulator; no figure on this '
        "page is a measurement of a real system.</p>"
        if simulated
        else "",
        "" if plots else '<p class=banner>No plots: get matplotlib with pip install "bluerov-slam[survey]".</p>',
        _facts(sessions, simulated),
        f"<h2>Errors, nothing left out</h2><p>{escape(_HONEST_NOTE)}</p>",
        *(_honest(sessions, truth) for truth in (("real", "rig", "published") if simulated else ("rig", "published"))),
        figure_html(
            plots, "scatter", "Errors by test",
            "Estimate less truth, all points with a result. Grey: the thesis's raw fixes; blue: our chain.",
        ),
        figure_html(plots, "curves", "Errors by length", "How many of the points are within an error."),
        f"<h2>The thesis's metric</h2><p>{escape(_METRIC_NOTE)}</p>",
        _metric(sessions),
        "<h2>How good the truth is</h2>",
        _truth(sessions, simulated),
        "<h2>Points without a result</h2>",
        _missing(sessions),
    ]  # fmt: skip
    return page_html("Data collection with the ground-truth rig", parts)


def _plots(sessions: Sequence[Collected], truth: str) -> dict[str, str] | None:
    try:
        from bluerov_slam.survey import rig_plots
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("matplotlib"):
            raise
        return None
    return rig_plots.draw(sessions, truth)


def _count(sessions: Sequence[Collected]) -> int:
    return sum(len(each.rows) for each in sessions)


def _facts(sessions: Sequence[Collected], simulated: bool) -> str:
    truth = "real" if simulated else "rig"
    facts = [(str(_count(sessions)), "points scored"), (str(sum(sum(s.lost.values()) for s in sessions)), "missing")]
    for name in ("fused", "raw", "ours"):
        found = rig_table.honest(sessions, name, truth)
        if found is not None:
            facts.append((f"{found.rmse_mm:.1f} mm", f"{rig_table.LABELS[name]}: RMSE"))
    facts.append((_number(rig_table.stated_truth_mm(sessions), " mm"), "truth of the rig: stated deviation, 3-D"))
    cells = "".join(f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>" for value, name in facts)
    return f"<div class=facts>{cells}</div>"


def _honest(sessions: Sequence[Collected], truth: str) -> str:
    names = [name for name in rig_table.ESTIMATES if rig_table.honest(sessions, name, truth) is not None]
    if not names:
        return ""
    heads = _heads(names, ("RMSE", "median", "p95"))
    lines = []
    for group, members in rig_table.groups(sessions):
        cells = ""
        for name in names:
            found = rig_table.honest(members, name, truth)
            values = (None,) * 3 if found is None else (found.rmse_mm, found.median_mm, found.p95_mm)
            cells += "".join(f"<td class=n>{'' if value is None else f'{value:.1f}'}" for value in values)
        lines.append(f"<tr><td>{escape(group)}<td class=n>{_count(members)}{cells}")
    caption = f"<p>Truth: {escape(rig_table.TRUTH_LABELS[truth])}. Millimetres.</p>"
    return f"{caption}<table>{heads}{''.join(lines)}</table>"


def _heads(names: Sequence[str], figures: Sequence[str], count: str = "points") -> str:
    """Two lines: the estimates over their figures."""
    over = "".join(f"<th class=n colspan={len(figures)}>{escape(rig_table.LABELS[name])}" for name in names)
    under = "".join(f"<th class=n>{escape(figure)}" for figure in figures) * len(names)
    return f"<tr><th><th>{over}<tr><th>Group<th class=n>{escape(count)}{under}"


def _metric(sessions: Sequence[Collected]) -> str:
    thesis = rig_table.published_metric(sessions)
    ours = rig_table.published_metric(sessions, ours=True)
    names = ("acoustic", "fused", "raw")
    heads = _heads((*names, "ours"), ("y", "z"), "rows left")
    lines = []
    for group, row in thesis.items():
        cells = "".join(_cell(row.cells[name]) for name in names) + _own_cell(ours.get(group))
        lines.append(f"<tr><td>{escape(group)}<td class=n>{row.count}{cells}")
    return f"<table>{heads}{''.join(lines)}</table>"


def _cell(cell: Cell) -> str:
    return f"<td class=n>{cell.y_mean:.1f} ± {cell.y_std:.1f}<td class=n>{cell.z_mean:.1f} ± {cell.z_std:.1f}"


def _own_cell(row: TableRow | None) -> str:
    return "<td><td>" if row is None else _cell(row.cells["raw"])


def _truth(sessions: Sequence[Collected], simulated: bool) -> str:
    """Stated uncertainty, and in a simulation how far each truth was off."""
    if not simulated:
        lines = "".join(
            f"<tr><td>{escape(group)}<td class=n>{_count(members)}"
            f"<td class=n>{_number(rig_table.stated_truth_mm(members))}"
            for group, members in rig_table.groups(sessions)
        )
        head = "<tr><th>Group<th class=n>points<th class=n>stated deviation, 3-D (mm)"
        return f"<p>The truth as published carries no uncertainty of its own.</p><table>{head}{lines}</table>"
    lines = ""
    for group, members in rig_table.groups(sessions):
        published = rig_table.truth_quality(members, "published")
        rig = rig_table.truth_quality(members, "rig")
        if published is None or rig is None:
            continue
        lines += (
            f"<tr><td>{escape(group)}<td class=n>{rig.count}"
            f"<td class=n>{published.mean_mm:.1f}<td class=n>{published.most_mm:.1f}"
            f"<td class=n>{rig.mean_mm:.1f}<td class=n>{rig.most_mm:.1f}<td class=n>{rig.rms_mm:.1f}"
            f"<td class=n>{_number(rig.stated_mm)}<td class=n>{_number(rig.nees, digits=2)}"
        )
    head = (
        "<tr><th>Group<th class=n>points<th class=n>as published: mean<th class=n>most"
        "<th class=n>rig with attitude: mean<th class=n>most<th class=n>RMS<th class=n>stated"
        "<th class=n>NEES (3 is honest)"
    )
    note = (
        "Distance in space between what is taken for the truth and where the simulated array really was, mm. The "
        "thesis states 7.35 mm on average and 21 mm at most for its real rig. All sessions have one rig: its errors "
        "are drawn once, so the NEES of one rig may lie well off 3 without the covariance being wrong."
    )
    return f"<p>{escape(note)}</p><table>{head}{lines}</table>"


def _missing(sessions: Sequence[Collected]) -> str:
    lost: Counter[str] = Counter()
    for each in sessions:
        lost.update(each.lost)
    discarded, withheld = sum(each.discarded for each in sessions), sum(each.withheld for each in sessions)
    lines = "".join(f"<tr><td>{escape(reason)}<td class=n>{count}" for reason, count in lost.most_common())
    table = f"<table><tr><th>Reason<th class=n>points{lines}</table>" if lines else "<p>None is missing.</p>"
    ours = ""
    if rig_table.honest(sessions, "ours", "published") is not None:
        ours = f" Our chain withheld {withheld} of the scored points; its errors are those of the others."
    return f"<p>{discarded} points follow a DISCARD and are not scored.{ours}</p>{table}"


def _number(value: float, unit: str = "", digits: int = 1) -> str:
    return f"{value:.{digits}f}{unit}" if math.isfinite(value) else "not known"
