"""How plots of reports look, and how they become SVG text. Needs matplotlib (the extra `survey`)."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from bluerov_slam.navigation.chi_square import chi_square_quantile

STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "bluerov-slam",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.grid": True,
    "grid.color": "#d0d7de",
    "grid.linewidth": 0.5,
    "axes.edgecolor": "#8c959f",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
}


def as_svg(figure: Figure) -> str:
    """The drawing without what changes from run to run, to be put into a page."""
    FigureCanvasSVG(figure)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def all_as_svg(figures: Mapping[str, Figure]) -> dict[str, str]:
    """Every drawing in the style of reports, by its name."""
    with matplotlib.rc_context(STYLE):
        return {name: as_svg(figure) for name, figure in figures.items()}


def panels(figure: Figure, rows: int, columns: int) -> list[Any]:
    """Axes side by side, row after row."""
    return [figure.add_subplot(rows, columns, place + 1) for place in range(rows * columns)]


def scatter_ellipse(axes: Any, errors: NDArray[np.float64]) -> None:
    """Of points (n, 2): their middle, and what holds 95 % of a normal distribution that spreads as they do."""
    values, vectors = np.linalg.eigh(np.cov(errors.T))
    scale = 2.0 * np.sqrt(chi_square_quantile(0.95, 2) * values)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    centre = errors.mean(axis=0)
    axes.add_patch(
        Ellipse(tuple(centre), scale[1], scale[0], angle=angle, fill=False, edgecolor="black", linewidth=1.0)
    )
    axes.plot(*centre, "+", color="black", markersize=7)
