"""Plots of the thesis's logs as SVG text. Needs matplotlib (the extra `survey`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bluerov_slam.acoustics.slip_lattice import Floats
from bluerov_slam.acoustics.thesis_log import MOTIONS, TESTS_MM, ThesisRows, error_mm, joined
from bluerov_slam.evaluation.thesis_halves import ARRAY_CENTRE_MM, Session, second_half_errors_mm
from bluerov_slam.evaluation.thesis_table import estimate, scored_rows
from bluerov_slam.survey.plot_style import all_as_svg, panels, scatter_ellipse
from bluerov_slam.survey.thesis_study import ThesisStudy

_COLORS = {"stationary": "#0969da", "rapid": "#cf222e", "gradual": "#1a7f37"}
_ESTIMATE_COLORS = {"acoustic": "#8c959f", "fused": "#0969da", "raw": "#d1590a"}
_LABELS = {"acoustic": "iSBL (sound alone)", "fused": "iSBL-SF (with dead reckoning)", "raw": "raw fixes"}
VIEW_MM = 250.0
_BIN_MM = 2.0
_DPI = 110


def draw(study: ThesisStudy, smoothed_mm: Mapping[str, Floats]) -> dict[str, str]:
    """Every plot by its name; `smoothed_mm`: positions of the smoother by log."""
    figures = {
        "scatter": _scatter(study),
        "histograms": _histograms(study),
        "geometry": _against_geometry(study, smoothed_mm),
        "held_out": within_lengths(study, smoothed_mm),
    }
    return all_as_svg(figures)


def _scatter(study: ThesisStudy) -> Figure:
    """Errors of iSBL-SF by test, with the ellipse that holds 95 % of a normal distribution like them."""
    by_test: dict[int, dict[str, list[Floats]]] = {}
    for log in study.scored_logs:
        rows = scored_rows(log)
        by_test.setdefault(log.test, {}).setdefault(log.motion, []).append(error_mm(rows.fused_mm, rows))
    return error_scatter(by_test)


def error_scatter(errors_mm: Mapping[int, Mapping[str, Sequence[Floats]]], view_mm: float = VIEW_MM) -> Figure:
    """Errors (n, 2) in y and z by test and kind of motion, each test with its ellipse."""
    figure = Figure(figsize=(9.0, 9.5), dpi=_DPI, layout="constrained")
    named: dict[str, Any] = {}
    for test, axes in enumerate(panels(figure, 3, 3), start=1):
        axes.set(xlim=(-view_mm, view_mm), ylim=(-view_mm, view_mm), aspect="equal")
        axes.set_title(f"Test {test}: x {TESTS_MM[test - 1][0]:.0f}, y {TESTS_MM[test - 1][1]:.0f} mm", fontsize=9)
        if not errors_mm.get(test):
            continue
        by_motion = {motion: np.concatenate(parts) for motion, parts in errors_mm[test].items()}
        for motion in (each for each in MOTIONS if each in by_motion):
            (named[motion],) = axes.plot(
                *by_motion[motion].T, ".", markersize=1.5, color=_COLORS[motion], rasterized=True
            )
        every = np.concatenate(list(by_motion.values()))
        outside = np.max(np.abs(every), axis=1) > view_mm
        axes.text(
            0.97, 0.03, f"{outside.sum()} of {len(outside)} outside", fontsize=7, ha="right", transform=axes.transAxes
        )
        scatter_ellipse(axes, every)
    figure.supxlabel("error in y (mm)", fontsize=9)
    figure.supylabel("error in z (mm)", fontsize=9)
    motions = [motion for motion in MOTIONS if motion in named]
    figure.legend(
        [named[motion] for motion in motions], motions, markerscale=5.0, loc="outside lower center", ncols=len(motions)
    )
    return figure


def _histograms(study: ThesisStudy) -> Figure:
    """Raw errors in z of stationary logs: bands as far apart as a slip of one carrier period moves a fix."""
    still = [
        (log, s.measured) for log, s in zip(study.scored_logs, study.sessions, strict=True) if s.motion == "stationary"
    ]
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    for (log, session), axes in zip(still, panels(figure, 4, 2), strict=True):
        rows = log.rows.where(~log.rows.after_discard)
        error = error_mm(rows.raw_mm, rows)[:, 1]
        axes.hist(error, bins=np.arange(-100.0, VIEW_MM, _BIN_MM), color="#0969da")
        counts, edges = np.histogram(error, bins=np.arange(-100.0, VIEW_MM, _BIN_MM))
        fullest = edges[int(np.argmax(counts))] + 0.5 * _BIN_MM
        for level in np.unique(np.round(session.lattice_mm[:, 1], 6)):
            if -100.0 < fullest + level < VIEW_MM:
                axes.axvline(fullest + level, color="#cf222e", linewidth=0.6, alpha=0.7)
        axes.set_title(f"{session.name}, {session.range_mm / 1e3:.2f} m", fontsize=8)
        axes.set_xlim(-100.0, VIEW_MM)
    figure.supxlabel("error of raw fixes in z (mm); red: the slip lattice, laid on the fullest band", fontsize=9)
    figure.supylabel("fixes", fontsize=9)
    return figure


def _against_geometry(study: ThesisStudy, smoothed_mm: Mapping[str, Floats]) -> Figure:
    """RMS error of each test over range and over the angle off the axis."""
    by_test: dict[int, ThesisRows] = {
        test: joined([scored_rows(log) for log in study.logs if log.test == test and log.truth_valid])
        for test in range(1, len(TESTS_MM) + 1)
    }
    named = {session.name: session for session in study.sessions}
    lattice = []
    for test in by_test:
        members = [named[log.name] for log in study.logs if log.test == test and log.name in named]
        lattice.append(_rms(second_half_errors_mm(members, smoothed_mm)))
    curves = {
        _LABELS[name]: ([_rms(error_mm(estimate(rows, name), rows)) for rows in by_test.values()], "o", color)
        for name, color in _ESTIMATE_COLORS.items()
    }
    return error_geometry(curves | {"slip lattice, smoothed (second halves)": (lattice, "s", "#1a7f37")})


def error_geometry(curves: Mapping[str, tuple[Sequence[float], str, str]]) -> Figure:
    """RMS errors (one for each test) by label, with marker and colour, over range and over the angle off the axis."""
    offsets = np.array([(x - ARRAY_CENTRE_MM[0], y) for x, y in TESTS_MM])
    ranges, angles = np.hypot(*offsets.T) / 1e3, np.degrees(np.abs(np.arctan2(offsets[:, 1], offsets[:, 0])))
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    for axes, (where, label) in zip(
        panels(figure, 1, 2), ((ranges, "range to the array (m)"), (angles, "angle off the x axis (deg)")), strict=True
    ):
        for name, (rms, marker, color) in curves.items():
            axes.plot(where, rms, marker, color=color, label=name)
        axes.set(xlabel=label, ylabel="RMS error across the line of sight (mm)", ylim=(0.0, None))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def within_lengths(study: ThesisStudy, smoothed_mm: Mapping[str, Floats]) -> Figure:
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
    axes.set(xlim=(0.0, VIEW_MM), ylim=(0.0, 100.0), xlabel="error up to (mm)", ylabel="of rows (%)")
    axes.legend(loc="lower right")
    return figure


def _lengths(sessions: list[Session], positions_mm: Mapping[str, Floats]) -> Floats:
    return np.asarray(np.linalg.norm(second_half_errors_mm(sessions, positions_mm), axis=1))


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
