"""Plots of a collection as SVG text. Needs matplotlib (the extra `survey`)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from bluerov_slam.evaluation.rig_table import ESTIMATES, LABELS, Collected, errors_mm
from bluerov_slam.survey.plot_style import STYLE, as_svg

_COLORS = {"acoustic": "#bf8700", "fused": "#cf222e", "raw": "#8c959f", "ours": "#0969da"}
_VIEW_MM = 200.0
_DPI = 110


def draw(sessions: Sequence[Collected], truth: str) -> dict[str, str]:
    """Every plot by its name."""
    with matplotlib.rc_context(STYLE):
        return {"scatter": as_svg(_scatter(sessions, truth)), "curves": as_svg(_curves(sessions, truth))}


def _scatter(sessions: Sequence[Collected], truth: str) -> Figure:
    places = sorted({each.place for each in sessions})
    columns = min(3, len(places))
    rows = math.ceil(len(places) / columns)
    figure = Figure(figsize=(3.0 * columns, 3.1 * rows + 0.3), dpi=_DPI, layout="constrained")
    for number, place in enumerate(places, start=1):
        axes = figure.add_subplot(rows, columns, number)
        members = [each for each in sessions if each.place == place]
        for name in ("raw", "ours"):
            error = errors_mm(members, name, truth)
            axes.plot(
                error[:, 0], error[:, 1], ".", markersize=2.0, color=_COLORS[name], rasterized=True, label=LABELS[name]
            )
        x, y, _ = members[0].transmitter_mm
        axes.set(xlim=(-_VIEW_MM, _VIEW_MM), ylim=(-_VIEW_MM, _VIEW_MM), aspect="equal")
        axes.set_title(f"Test {place}: x {x:.0f}, y {y:.0f} mm", fontsize=9)
        if number == 1:
            axes.legend(markerscale=4.0, loc="lower left")
    figure.supxlabel("error in y (mm)", fontsize=9)
    figure.supylabel("error in z (mm)", fontsize=9)
    return figure


def _curves(sessions: Sequence[Collected], truth: str) -> Figure:
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    axes = figure.add_subplot()
    shares = np.linspace(0.0, 1.0, 300)
    for name in ESTIMATES:
        length = np.linalg.norm(errors_mm(sessions, name, truth), axis=1)
        if len(length):
            axes.plot(np.quantile(length, shares), 100.0 * shares, color=_COLORS[name], label=LABELS[name])
    axes.set(xlim=(0.0, _VIEW_MM), ylim=(0.0, 100.0), xlabel="error up to (mm)", ylabel="of points (%)")
    axes.legend(loc="lower right")
    return figure
