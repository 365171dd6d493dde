"""Plots of halves of the thesis's logs as SVG text: what training found, what it gave. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure

from bluerov_slam.acoustics.slip_lattice import Floats
from bluerov_slam.acoustics.thesis_log import TESTS_MM
from bluerov_slam.evaluation.thesis_halves import Session
from bluerov_slam.evaluation.thesis_held_out import Parameters
from bluerov_slam.survey.plot_style import all_as_svg, panels
from bluerov_slam.survey.thesis_plots import VIEW_MM, error_geometry, error_scatter, within_lengths
from bluerov_slam.survey.thesis_study import ThesisStudy

_RAW, _OURS, _BAND = "#8c959f", "#0969da", "#cf222e"
_BIN_MM = 2.0
_NEAR_MM = 60.0
_CELLS_SHOWN = 12

Errors = Callable[[Session], Floats]


def draw_held_out(
    study: ThesisStudy, smoothed_mm: Mapping[str, Floats], causal_mm: Mapping[str, Floats]
) -> dict[str, str]:
    """Second halves; positions by log."""

    def causal(session: Session) -> Floats:
        return session.second.error_mm(causal_mm[session.name])

    def smoothed(session: Session) -> Floats:
        return session.second.error_mm(smoothed_mm[session.name])

    def raw(session: Session) -> Floats:
        return session.second.error_mm(session.measured.raw_mm)

    curves = {
        "raw fixes": (_by_test(study, raw), "o", _RAW),
        "slip lattice, causal": (_by_test(study, causal), "s", _OURS),
        "slip lattice, smoothed": (_by_test(study, smoothed), "^", "#1a7f37"),
    }
    return all_as_svg(
        {
            "held_out": within_lengths(study, smoothed_mm),
            "half_scatter": _scatter(study, causal, VIEW_MM),
            "half_histograms": _histograms(study, {"raw fixes": (raw, _RAW), "slip lattice, causal": (causal, _OURS)}),
            "half_geometry": error_geometry(curves),
        }
    )


def draw_training(study: ThesisStudy, parameters: Parameters) -> dict[str, str]:
    """First halves."""

    def error(session: Session) -> Floats:
        half = session.first
        return np.asarray(half.error_mm[half.scored])

    def unbiased(session: Session) -> Floats:
        half = session.first
        bias = parameters.calibrations[session.name].bias_mm(half.measured.attitude_deg[half.scored])
        return np.asarray(half.error_mm[half.scored] - bias)

    def residual(session: Session) -> Floats:
        left = unbiased(session)[:, None, :] - session.first.measured.lattice_mm[None]
        nearest = np.argmin((left**2).sum(axis=2), axis=1)
        return np.asarray(left[np.arange(len(left)), nearest])

    def bands(session: Session) -> Floats:
        half = session.first
        bias = parameters.calibrations[session.name].bias_mm(half.measured.attitude_deg[half.scored])
        return np.asarray(np.unique(np.round(half.measured.lattice_mm[:, 1], 6)) + bias[:, 1].mean())

    return all_as_svg(
        {
            "cells": _cells(parameters),
            "half_scatter": _scatter(study, residual, _NEAR_MM),
            "half_histograms": _histograms(study, {"raw fixes": (error, _OURS)}, bands),
        }
    )


def _scatter(study: ThesisStudy, error: Errors, view_mm: float) -> Figure:
    by_test: dict[int, dict[str, list[Floats]]] = {}
    for log, session in zip(study.scored_logs, study.sessions, strict=True):
        by_test.setdefault(log.test, {}).setdefault(log.motion, []).append(error(session))
    return error_scatter(by_test, view_mm)


def _by_test(study: ThesisStudy, error: Errors) -> list[float]:
    """RMS of each test; NaN, and so no mark, where a test has no log that can be scored."""
    rms = []
    for test in range(1, len(TESTS_MM) + 1):
        pairs = zip(study.scored_logs, study.sessions, strict=True)
        parts = [error(session) for log, session in pairs if log.test == test]
        every = np.concatenate(parts) if parts else np.full((1, 2), np.nan)
        rms.append(float(np.sqrt(np.mean(np.sum(every**2, axis=1)))))
    return rms


def _histograms(study: ThesisStudy, errors: Mapping[str, tuple[Errors, str]], bands: Errors | None = None) -> Figure:
    """Errors in z of logs of a standing platform."""
    still = [session for session in study.sessions if session.motion == "stationary"]
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    for session, axes in zip(still, panels(figure, -(-len(still) // 2), 2), strict=False):
        for label, (error, color) in errors.items():
            axes.hist(
                error(session)[:, 1], bins=np.arange(-VIEW_MM, VIEW_MM, _BIN_MM), color=color, alpha=0.75, label=label
            )
        for level in () if bands is None else bands(session).tolist():
            if abs(level) < VIEW_MM:
                axes.axvline(level, color=_BAND, linewidth=0.6, alpha=0.7)
        axes.set_title(f"{session.name}, {session.measured.range_mm / 1e3:.2f} m", fontsize=8)
        axes.set_xlim(-0.5 * VIEW_MM, VIEW_MM)
    figure.supxlabel("error in z (mm)", fontsize=9)
    figure.supylabel("fixes", fontsize=9)
    if len(errors) > 1:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=len(errors))
    return figure


def _cells(parameters: Parameters) -> Figure:
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for told in parameters.calibrations.values():
        shares = 100.0 * np.sort(told.probability)[::-1][:_CELLS_SHOWN]
        axes.plot(np.arange(1, len(shares) + 1), shares, ".-", color=_OURS, linewidth=0.6, alpha=0.5)
    axes.set(xlabel="cells of one session, the fullest first", ylabel="of fixes (%)", ylim=(0.0, 100.0))
    return figure
