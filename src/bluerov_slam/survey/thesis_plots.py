"""Plots of the thesis's logs as SVG text. Needs matplotlib (the extra `survey`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from bluerov_slam.acoustics.slip_lattice import Floats
from bluerov_slam.acoustics.thesis_log import MOTIONS, TESTS_MM, ThesisRows, error_mm, joined
from bluerov_slam.evaluation.thesis_halves import ARRAY_CENTRE_MM, Session, second_half_errors_mm
from bluerov_slam.evaluation.thesis_table import ESTIMATES, estimate, scored_rows
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.survey.plot_style import STYLE, as_svg
from bluerov_slam.survey.thesis_study import ThesisStudy

_COLORS = {"stationary": "#0969da", "rapid": "#cf222e", "gradual": "#1a7f37"}
_ESTIMATE_COLORS = {"acoustic": "#8c959f", "fused": "#0969da", "raw": "#d1590a"}
_LABELS = {"acoustic": "iSBL (sound alone)", "fused": "iSBL-SF (with dead reckoning)", "raw": "raw fixes"}
_VIEW_MM = 250.0
_BIN_MM = 2.0
_DPI = 110


def draw(study: ThesisStudy, smoothed_mm: Mapping[str, Floats]) -> dict[str, str]:
    """Every plot by its name; `smoothed_mm`: positions of the smoother by log."""
    figures = {
        "scatter": _scatter(study),
        "histograms": _histograms(study),
        "geometry": _against_geometry(study, smoothed_mm),
        "held_out": _held_out(study, smoothed_mm),
    }
    with matplotlib.rc_context(STYLE):
        return {name: as_svg(figure) for name, figure in figures.items()}


def _scatter(study: ThesisStudy) -> Figure:
    """Errors of iSBL-SF by test, with the ellipse that holds 95 % of a normal distribution like them."""
    figure = Figure(figsize=(9.0, 9.5), dpi=_DPI, layout="constrained")
    for test, axes in enumerate(_panels(figure, 3, 3), start=1):
        every = []
        for motion in MOTIONS:
            parts = [scored_rows(log) for log in study.scored_logs if (log.test, log.motion) == (test, motion)]
            if not parts:
                continue
            rows = joined(parts)
            error = error_mm(rows.fused_mm, rows)
            every.append(error)
            axes.plot(
                error[:, 0], error[:, 1], ".", markersize=1.5, color=_COLORS[motion], rasterized=True, label=motion
            )
        outside = np.concatenate([np.max(np.abs(error), axis=1) > _VIEW_MM for error in every])
        axes.text(
            0.97, 0.03, f"{outside.sum()} of {len(outside)} outside", fontsize=7, ha="right", transform=axes.transAxes
        )
        _ellipse(axes, np.concatenate(every))
        axes.set(xlim=(-_VIEW_MM, _VIEW_MM), ylim=(-_VIEW_MM, _VIEW_MM), aspect="equal")
        axes.set_title(f"Test {test}: x {TESTS_MM[test - 1][0]:.0f}, y {TESTS_MM[test - 1][1]:.0f} mm", fontsize=9)
        if test == 2:
            axes.legend(markerscale=5.0, loc="lower left")
    figure.supxlabel("error in y (mm)", fontsize=9)
    figure.supylabel("error in z (mm)", fontsize=9)
    return figure


def _ellipse(axes: Any, error: Floats) -> None:
    values, vectors = np.linalg.eigh(np.cov(error.T))
    scale = 2.0 * np.sqrt(chi_square_quantile(0.95, 2) * values)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    centre = error.mean(axis=0)
    axes.add_patch(
        Ellipse(tuple(centre), scale[1], scale[0], angle=angle, fill=False, edgecolor="black", linewidth=1.0)
    )
    axes.plot(*centre, "+", color="black", markersize=7)


def _histograms(study: ThesisStudy) -> Figure:
    """Raw errors in z of stationary logs: bands as far apart as a slip of one carrier period moves a fix."""
    still = [
        (log, s.measured) for log, s in zip(study.scored_logs, study.sessions, strict=True) if s.motion == "stationary"
    ]
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    for (log, session), axes in zip(still, _panels(figure, 4, 2), strict=True):
        rows = log.rows.where(~log.rows.after_discard)
        error = error_mm(rows.raw_mm, rows)[:, 1]
        axes.hist(error, bins=np.arange(-100.0, _VIEW_MM, _BIN_MM), color="#0969da")
        counts, edges = np.histogram(error, bins=np.arange(-100.0, _VIEW_MM, _BIN_MM))
        fullest = edges[int(np.argmax(counts))] + 0.5 * _BIN_MM
        for level in np.unique(np.round(session.lattice_mm[:, 1], 6)):
            if -100.0 < fullest + level < _VIEW_MM:
                axes.axvline(fullest + level, color="#cf222e", linewidth=0.6, alpha=0.7)
        axes.set_title(f"{session.name}, {session.range_mm / 1e3:.2f} m", fontsize=8)
        axes.set_xlim(-100.0, _VIEW_MM)
    figure.supxlabel("error of raw fixes in z (mm); red: the slip lattice, laid on the fullest band", fontsize=9)
    figure.supylabel("fixes", fontsize=9)
    return figure


def _against_geometry(study: ThesisStudy, smoothed_mm: Mapping[str, Floats]) -> Figure:
    """RMS error of each test over range and over the angle off the axis."""
    by_test: dict[int, ThesisRows] = {
        test: joined([scored_rows(log) for log in study.logs if log.test == test and log.truth_valid])
        for test in range(1, len(TESTS_MM) + 1)
    }
    offsets = np.array([(x - ARRAY_CENTRE_MM[0], y) for x, y in TESTS_MM])
    ranges, angles = np.hypot(*offsets.T) / 1e3, np.degrees(np.abs(np.arctan2(offsets[:, 1], offsets[:, 0])))
    named = {session.name: session for session in study.sessions}
    lattice = []
    for test in by_test:
        members = [named[log.name] for log in study.logs if log.test == test and log.name in named]
        lattice.append(_rms(second_half_errors_mm(members, smoothed_mm)))
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    for axes, (where, label) in zip(
        _panels(figure, 1, 2), ((ranges, "range to the array (m)"), (angles, "angle off the x axis (deg)")), strict=True
    ):
        for name in ESTIMATES:
            rms = [_rms(error_mm(estimate(rows, name), rows)) for rows in by_test.values()]
            axes.plot(where, rms, "o", color=_ESTIMATE_COLORS[name], label=_LABELS[name])
        axes.plot(where, lattice, "s", color="#1a7f37", label="slip lattice, smoothed (second halves)")
        axes.set(xlabel=label, ylabel="RMS error across the line of sight (mm)", ylim=(0.0, None))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _held_out(study: ThesisStudy, smoothed_mm: Mapping[str, Floats]) -> Figure:
    """Share of second-half rows with an error up to a length."""
    sessions = study.sessions
    curves = {
        "raw fixes": (_lengths(sessions, {s.name: s.measured.raw_mm for s in sessions}), "#d1590a"),
        "logged iSBL-SF": (_lengths(sessions, {s.name: s.measured.fused_mm for s in sessions}), "#0969da"),
        "slip lattice, smoothed": (_lengths(sessions, smoothed_mm), "#1a7f37"),
    }
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for label, (lengths, color) in curves.items():
        shares = np.linspace(0.0, 1.0, 400)
        axes.plot(np.quantile(lengths, shares), 100.0 * shares, color=color, label=label)
    axes.set(xlim=(0.0, _VIEW_MM), ylim=(0.0, 100.0), xlabel="error up to (mm)", ylabel="of rows (%)")
    axes.legend(loc="lower right")
    return figure


def _lengths(sessions: list[Session], positions_mm: Mapping[str, Floats]) -> Floats:
    return np.asarray(np.linalg.norm(second_half_errors_mm(sessions, positions_mm), axis=1))


def _panels(figure: Figure, rows: int, columns: int) -> list[Any]:
    return [figure.add_subplot(rows, columns, place + 1) for place in range(rows * columns)]


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
