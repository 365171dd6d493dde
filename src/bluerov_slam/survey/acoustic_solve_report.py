"""What `bluerov-slam isbl solve` found, as one HTML file that needs nothing else. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from bluerov_slam import __version__
from bluerov_slam.survey.acoustic_solve import (
    SolvedRecord,
    SolveOptions,
    SteeredSurface,
    pair_correlations,
    remarks_of,
    solved_json,
    steered_surface,
)
from bluerov_slam.survey.plot_style import STYLE, as_svg
from bluerov_slam.survey.report_page import page_html

MOST_FIGURES = 8
_CLOSE = 0.1
"""Direction cosines to each side of the direction found."""


def solve_report(name: str, solved: Sequence[SolvedRecord], options: SolveOptions) -> str:
    """The whole page; the first records with their correlation surfaces."""
    rows = "".join(_row(number, each) for number, each in enumerate(solved))
    figures = [_figures(number, each, options) for number, each in enumerate(solved) if each.differences is not None]
    more = len(figures) - MOST_FIGURES
    left_out = f"<p class=sub>Figures of {more} further records are left out.</p>" if more > 0 else ""
    facts = [
        ("Array", f"{options.array.name}, {len(options.array)} receivers"),
        ("Speed of sound", f"{options.sound_speed_mps:g} m/s"),
        ("Method", options.method),
        ("Known of the source", _known(options)),
    ]
    cells = "".join(f"<div><span>{escape(label)}</span><b>{escape(text)}</b></div>" for label, text in facts)
    heads = "".join(f"<th>{title}</th>" for title in _TITLES)
    body = (
        f"<h1>Acoustic records of {escape(name)}</h1><p class=sub>bluerov-slam {__version__}; directions and positions "
        "in the array's frame: forward along its normal, right, down</p>"
        f"<div class=facts>{cells}</div><table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
        f"{''.join(figures[:MOST_FIGURES])}{left_out}"
    )
    return page_html(f"Acoustic records of {name}", [body])


_TITLES = (
    "Record", "Delays, &micro;s", "Signal to noise, dB", "Azimuth", "Elevation", "&plusmn; (1 &sigma;)", "Position, m",
    "Slip", "Remarks",
)  # fmt: skip


def _row(number: int, solved: SolvedRecord) -> str:
    content = solved_json(solved)
    delays, direction, position = content["delays"], content["direction"], content["position"]
    remarks = [solved.reason] if solved.reason else []
    if solved.differences is not None:
        remarks += remarks_of(solved.differences)
    if content["message"] is not None:
        remarks.append(f"message {content['message']['bytes']}")
    cells = (
        str(content["record_id"] or number),
        _joined((delays or {}).get("delays_us"), 2),
        _joined((delays or {}).get("snr_db"), 0),
        "-" if direction is None else f"{direction['azimuth_deg']:.2f}&deg;",
        "-" if direction is None else f"{direction['elevation_deg']:.2f}&deg;",
        "-" if direction is None else f"{direction['std_deg']:.3f}&deg;",
        "-" if position is None else _joined(position["forward_right_down_m"], 3),
        "-" if delays is None or delays["slip_probability"] is None else f"{100 * delays['slip_probability']:.1f} %",
        escape("; ".join(remarks)),
    )
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _figures(number: int, solved: SolvedRecord, options: SolveOptions) -> str:
    text = surface_svg(solved, options)
    caption = (
        "Above: the records, and the correlation of the reference with each other receiver within what the array "
        "allows. Below: how well all receivers agree for a pulse from every direction in front of the array (1: as "
        "one), each dot the best of the directions it stands for; the cross is the direction found, the dot its mirror "
        "image where there is one. Beside it the same close up: neighbouring peaks are slips by carrier periods."
    )
    return (
        f"<h2>Record {solved.record.record_id or number}</h2><figure>{text}<figcaption>{caption}</figcaption></figure>"
    )


def surface_svg(solved: SolvedRecord, options: SolveOptions) -> str:
    """Records, correlations of pairs and agreement by direction; empty without usable receivers."""
    with matplotlib.rc_context(STYLE):
        drawing = _draw(solved, options)
        return "" if drawing is None else as_svg(drawing)


def _draw(solved: SolvedRecord, options: SolveOptions) -> Figure | None:
    wide = steered_surface(solved, options)
    if wide is None:
        return None
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    (waves, lags), (map_, close) = figure.subplots(2, 2)
    _draw_waves(waves, solved)
    _draw_surface(map_, wide, "Agreement by direction")
    row, column = np.unravel_index(np.nanargmax(wide.agreement), wide.agreement.shape)
    centre = (float(wide.right[column]), float(wide.down[row]))
    if solved.solution is not None and np.isfinite(solved.solution.direction).all():
        _, right, down = solved.solution.direction.tolist()
        centre = (right, down)
        for axes in (map_, close):
            axes.plot(right, down, "+", color="#fff", markersize=12, markeredgewidth=1.5)
        if solved.solution.mirror is not None:
            map_.plot(*solved.solution.mirror[1:].tolist(), ".", color="#fff")
    near = steered_surface(solved, options, centre=centre, half_width=_CLOSE)
    assert near is not None
    figure.colorbar(_draw_surface(close, near, "Around the direction found"), ax=[map_, close], label="agreement (1)")
    found = solved.differences
    assert found is not None
    for (reference, other, lag_us, values_), delay_s in zip(
        pair_correlations(solved, options), found.delays_s.tolist(), strict=True
    ):
        (line,) = lags.plot(lag_us, values_, linewidth=0.8, label=f"{reference} with {other}")
        lags.axvline(1e6 * delay_s, color=line.get_color(), linewidth=1.2, linestyle="--")
    lags.set(xlabel="delay, \u00b5s", ylabel="correlation (1)", title="Pairs: the delays found are dashed")
    lags.legend()
    return figure


def _draw_surface(axes: Any, surface: SteeredSurface, title: str) -> Any:
    right, down = surface.right, surface.down
    extent = (float(right[0]), float(right[-1]), float(down[0]), float(down[-1]))
    mesh = axes.imshow(
        surface.agreement, origin="lower", extent=extent, cmap="viridis", vmin=0.0, vmax=1.0, interpolation="nearest"
    )
    axes.invert_yaxis()
    axes.set(xlabel="right (direction cosine)", ylabel="down (direction cosine)", title=title)
    axes.grid(visible=False)
    return mesh


def _draw_waves(axes: Any, solved: SolvedRecord) -> None:
    record = solved.record
    time_ms = 1e3 * np.arange(record.samples.shape[1]) / record.sample_rate_hz
    height = 2.2 * max(1.0, float(np.abs(record.samples.astype(float)).max()))
    for receiver, wave in enumerate(record.samples):
        axes.plot(time_ms, wave - receiver * height, linewidth=0.4, rasterized=True)
    count = record.samples.shape[0]
    axes.set_yticks([-receiver * height for receiver in range(count)], [str(receiver) for receiver in range(count)])
    axes.set(xlabel="time, ms", ylabel="receiver", title="Records")


def _known(options: SolveOptions) -> str:
    parts = []
    if options.depth is not None:
        parts.append(f"{options.depth[0]:g} \u00b1 {options.depth[1]:g} m {options.axis}")
    if options.range_ is not None:
        parts.append(f"range {options.range_[0]:g} \u00b1 {options.range_[1]:g} m")
    return ", ".join(parts) or "nothing: direction only"


def _joined(values: Sequence[float | None] | None, digits: int) -> str:
    if not values:
        return "-"
    return ", ".join("-" if value is None else f"{value:.{digits}f}" for value in values)
