"""Plots of what `isbl evaluate` ran, by case, as SVG text. Needs matplotlib (the extra `survey`)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bluerov_slam.acoustics.message.frame import MESSAGE_FRAME_BITS
from bluerov_slam.acoustics.pulse_train import REAL_CARRIER_HZ
from bluerov_slam.evaluation.acoustic_cases import AcousticJob
from bluerov_slam.evaluation.acoustic_timing import METHOD_NAMES, SLIP_CELL, SLIP_S, sources_ahead
from bluerov_slam.survey.plot_style import all_as_svg, panels, scatter_ellipse

Array = NDArray[np.float64]
Found = Sequence[tuple[AcousticJob, Any]]
Cells = Mapping[str, Found]

_OURS, _BOUND, _THESIS, _OTHER = "#0969da", "black", "#cf222e", "#1a7f37"
_ANGLE_BINS = 8
_LEAST_SHARE = 0.01
"""Per cent: where a logarithmic axis shows that nothing happened."""


def draw(found: Found) -> dict[str, str]:
    """Every plot that these outcomes have something for, by its case or by case and kind."""
    figures: dict[str, Figure] = {}
    for case, plots in _PLOTS.items():
        cells: dict[str, list[tuple[AcousticJob, Any]]] = {}
        own = [each for each in found if each[0].case == case]
        for job, outcome in sorted(own, key=lambda each: (_figures_of(each[0].cell), each[0].seed)):
            cells.setdefault(job.cell, []).append((job, outcome))
        if cells:
            for name, make in plots.items():
                figure = make(cells)
                if figure is not None:
                    figures[f"{case}.{name}"] = figure
    return all_as_svg(figures)


def _figures_of(cell: str) -> list[float]:
    """The numbers in a cell's name, by which cells are in order."""
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?", cell)]


def _timing(cells: Cells) -> Figure | None:
    """RMS timing error without slips over the signal to noise ratio, each method, beside the bound."""
    snrs = sorted((int(cell) for cell in cells if cell != SLIP_CELL), key=float)
    if not snrs:
        return None
    figure, axes = _axes()
    outcomes = {snr: [outcome for _, outcome in cells[str(snr)]] for snr in snrs}
    for method, label in METHOD_NAMES.items():
        rms = []
        for snr in snrs:
            errors = np.concatenate([each.errors_s[method] for each in outcomes[snr]])
            kept = errors[np.all(np.abs(errors) <= SLIP_S, axis=1)]
            rms.append(1e6 * _rms(kept) if len(kept) > 1 else math.nan)
        ours = method == "joint"
        axes.semilogy(snrs, rms, "o-", label=label, linewidth=2.0 if ours else 0.8, zorder=3 if ours else 2)
    bound = [1e6 * _rms(np.concatenate([each.bound_s for each in outcomes[snr]])) for snr in snrs]
    axes.semilogy(snrs, bound, "--", color=_BOUND, label="least possible (Cramer-Rao)")
    axes.set(xlabel="signal to noise (dB)", ylabel="RMS timing error without slips (\u00b5s)")
    axes.legend(ncols=2)
    return figure


def _timing_bands(cells: Cells) -> Figure | None:
    """Timing errors at the lowest signal to noise: bands a carrier period apart are slips."""
    snrs = sorted((int(cell) for cell in cells if cell != SLIP_CELL), key=float)
    if not snrs:
        return None
    outcomes = [outcome for _, outcome in cells[str(snrs[0])]]
    period_us = 1e6 / float(np.mean(REAL_CARRIER_HZ))
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    methods = ("thesis", "band_limited", "matched", "joint")
    for axes, method in zip(panels(figure, 2, 2), methods, strict=True):
        errors = 1e6 * np.concatenate([each.errors_s[method] for each in outcomes]).ravel()
        view = 3.5 * period_us
        axes.hist(np.clip(errors, -view, view), bins=np.arange(-view, view + 1.0, 1.0), color=_OURS, log=True)
        for slip in range(-3, 4):
            axes.axvline(slip * period_us, color=_THESIS, linewidth=0.6, alpha=0.7)
        axes.set_title(f"{METHOD_NAMES[method]}, {snrs[0]} dB", fontsize=9)
    figure.supxlabel("timing error of a pair (\u00b5s); red: whole carrier periods; the last bins hold all beyond")
    figure.supylabel("pairs")
    return figure


def _scatter(cells: Cells) -> Figure:
    """Errors of position of every cell, with the 95 % ellipse of what came out and of the bound."""
    columns = min(3, len(cells))
    rows = -(-len(cells) // columns)
    figure = Figure(figsize=(3.0 * columns, 3.1 * rows), layout="constrained")
    for axes, (cell, found) in zip(panels(figure, rows, columns), cells.items(), strict=False):
        chain = _chain(found)
        errors = 1e3 * np.concatenate([outcome.errors_m[chain] for _, outcome in found])
        axes.plot(*errors.T, ".", markersize=2.0, color=_OURS, rasterized=True)
        if len(errors) > 2:
            scatter_ellipse(axes, errors)
        half = 1.6 * max(float(np.quantile(np.abs(errors), 0.99)), 1e-6)
        outside = int(np.sum(np.max(np.abs(errors), axis=1) > half))
        axes.text(0.97, 0.03, f"{outside} of {len(errors)} outside", fontsize=7, ha="right", transform=axes.transAxes)
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.set_title(f"{cell}, {chain}", fontsize=9)
    figure.supxlabel("error in y (mm)", fontsize=9)
    figure.supylabel("error in z (mm)", fontsize=9)
    return figure


def _over_range_and_angle(cells: Cells) -> Figure:
    """RMS errors of position over the range, and over the angle off the array's axis."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    near, aside = panels(figure, 1, 2)
    series: dict[str, list[tuple[float, float]]] = {}
    for cell, found in cells.items():
        range_m, _, rest = cell.partition(" m")
        for chain in found[0][1].errors_m:
            errors = 1e3 * np.linalg.norm(np.concatenate([outcome.errors_m[chain] for _, outcome in found]), axis=1)
            series.setdefault(f"{chain}{rest and ','}{rest}", []).append((float(range_m), _rms(errors)))
        bounds = [outcome.bound_m for _, outcome in found if outcome.bound_m is not None]
        if bounds:
            least = 1e3 * np.linalg.norm(np.concatenate(bounds), axis=1)
            series.setdefault(f"least possible{rest and ','}{rest}", []).append((float(range_m), _rms(least)))
        chain = _chain(found)
        errors = 1e3 * np.linalg.norm(np.concatenate([outcome.errors_m[chain] for _, outcome in found]), axis=1)
        where = [sources_ahead(job.seed, job.draws, float(range_m)) for job, _ in found]
        angles = np.degrees(np.arccos(np.clip(np.concatenate(where)[:, 0] / float(range_m), -1.0, 1.0)))
        edges = np.linspace(0.0, float(angles.max()) + 1e-9, _ANGLE_BINS + 1)
        bins = np.digitize(angles, edges) - 1
        full = [k for k in range(_ANGLE_BINS) if np.sum(bins == k) > 1]
        aside.semilogy(
            [0.5 * (edges[k] + edges[k + 1]) for k in full], [_rms(errors[bins == k]) for k in full], ".-", label=cell
        )
    for label, points in series.items():
        style = "k--" if label.startswith("least") else "o-"
        near.loglog(*zip(*sorted(points), strict=True), style, markersize=4, linewidth=0.9, label=label)
    near.set(xlabel="range (m)", ylabel="RMS error of position (mm)")
    aside.set(xlabel="angle off the axis (deg)", ylabel="RMS error of position, our chain (mm)")
    near.legend(fontsize=7)
    aside.legend(fontsize=7)
    return figure


def _chain(found: Found) -> str:
    """Ours comes first."""
    return str(next(iter(found[0][1].errors_m)))


def _echo(cells: Cells) -> Figure:
    """Share of fixes in a wrong cell by the strength of the echo, one panel for each range."""
    ranges = sorted({float(cell.partition(" m ")[0]) for cell in cells})
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    for axes, range_m in zip(panels(figure, 1, len(ranges)), ranges, strict=True):
        own = {
            float(cell.partition(" m ")[2]): found for cell, found in cells.items() if cell.startswith(f"{range_m} m ")
        }
        echoes = sorted(own)
        for chain in own[echoes[0]][0][1].off_cell:
            shares = [100.0 * float(np.mean(_joined(own[echo], "off_cell", chain))) for echo in echoes]
            axes.plot(echoes, shares, "o-", label=chain)
        axes.set_title(f"{range_m:g} m", fontsize=9)
        axes.set(xlabel="echo (1)", ylim=(-2.0, 100.0))
    figure.supylabel("fixes in a wrong cell (%)", fontsize=9)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _radial(cells: Cells) -> Figure:
    """Radial errors over what was stated: they should be those of a normal distribution."""
    figure, axes = _axes()
    grid = np.linspace(-4.0, 4.0, 65)
    for cell, found in cells.items():
        radial, std = (np.concatenate([outcome.by_name[name] for _, outcome in found]) for name in ("radial", "std"))
        axes.hist(np.clip(radial / std, -4.0, 4.0), bins=grid, density=True, histtype="step", label=cell)
    axes.plot(grid, np.exp(-0.5 * grid**2) / math.sqrt(math.tau), "--", color=_BOUND, label="as stated")
    axes.set(xlabel="radial error over its stated deviation (1); the last bins hold all beyond", ylabel="density")
    axes.legend()
    return figure


def _bench(cells: Cells) -> Figure:
    """Errors of the whole chain by range, ours and the thesis's."""
    figure, axes = _axes()
    for name, color, label in (("new", _OURS, "our chain"), ("thesis", _THESIS, "thesis's chain")):
        for number, found in enumerate(cells.values()):
            lengths = 1e3 * np.linalg.norm(np.concatenate([outcome.by_name[name] for _, outcome in found]), axis=1)
            lengths = np.sort(lengths[np.isfinite(lengths)])
            style = ("-", "--", ":")[number % 3]
            cell = list(cells)[number]
            axes.semilogx(
                lengths, 100.0 * np.arange(1, len(lengths) + 1) / len(lengths), style, color=color,
                label=f"{label}, {cell}",
            )  # fmt: skip
    axes.set(xlabel="error of position up to (mm)", ylabel="of fixes (%)", ylim=(0.0, 100.0))
    axes.legend()
    return figure


def _dives(cells: Cells) -> Figure | None:
    """Every dive: its error beside its bound, and how honest it was."""
    dives = [outcome for _, outcome in cells.get("dive", ())]
    if not dives:
        return None
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    left, right = panels(figure, 1, 2)
    seeds = [each.seed for each in dives]
    smoothed = [each for each in dives if each.smoothed is not None]
    left.plot(seeds, [each.causal.ate_m for each in dives], "o", color=_OTHER, label="causal")
    left.plot(
        [each.seed for each in smoothed], [each.smoothed.ate_m for each in smoothed], "s", color=_OURS, label="smoothed"
    )
    left.plot(
        seeds, [each.bound_m for each in dives], "_", color=_BOUND, markersize=9, label="least possible, smoothed"
    )
    left.axhline(3.5, color=_THESIS, linewidth=0.8)
    left.set(xlabel="seed", ylabel="ATE (m); red: what the smoothed median must reach", ylim=(0.0, None))
    left.legend()
    right.plot(seeds, [100.0 * each.causal.position_in_band for each in dives], "o", color=_OTHER, label="causal")
    right.plot(
        [each.seed for each in smoothed], [100.0 * each.smoothed.position_in_band for each in smoothed], "s",
        color=_OURS, label="smoothed",
    )  # fmt: skip
    right.axhline(95.0, color=_BOUND, linewidth=0.8, linestyle="--")
    right.set(xlabel="seed", ylabel="epochs within the stated 95 % (%)", ylim=(0.0, 102.0))
    return figure


def _yaw(cells: Cells) -> Figure | None:
    found = cells.get("yaw", ())
    if not found:
        return None
    figure, axes = _axes()
    start, stated = (np.concatenate([outcome.by_name[name] for _, outcome in found]) for name in ("start", "stated"))
    grid = np.linspace(-4.0, 4.0, 41)
    axes.hist(np.clip(start / stated, -4.0, 4.0), bins=grid, density=True, color=_OURS)
    axes.plot(grid, np.exp(-0.5 * grid**2) / math.sqrt(math.tau), "--", color=_BOUND, label="as stated")
    axes.set(xlabel="error of the start yaw over its stated deviation (1)", ylabel="density")
    axes.legend()
    return figure


def _message(cells: Cells) -> Figure:
    """Lost frames and wrong bits over the signal to noise ratio, beside theory."""
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    frames, bits = panels(figure, 1, 2)
    plain = sorted((float(cell), found) for cell, found in cells.items() if " " not in cell)
    if plain:
        snrs = [snr for snr, _ in plain]
        for axes, names in (
            (frames, (("lost", "measured", _OURS), ("lost_by_ideal_receiver", "ideal receiver", _BOUND))),
            (bits, (("bits_wrong", "measured", _OURS),)),
        ):
            for name, label, color in names:
                shares = []
                for _, found in plain:
                    count = sum(getattr(each, name) for _, each in found)
                    total = sum(each.frames for _, each in found) * (1 if axes is frames else MESSAGE_FRAME_BITS)
                    shares.append(max(100.0 * count / total, _LEAST_SHARE))
                axes.semilogy(snrs, shares, "o-" if color == _OURS else "--", color=color, label=label)
        theory = [max(100.0 * found[0][1].bit_error_rate_in_theory, _LEAST_SHARE) for _, found in plain]
        bits.semilogy(snrs, theory, "--", color=_BOUND, label="theory, coherent on-off keying")
    for axes, label in ((frames, "frames lost (%)"), (bits, "bits wrong before correction (%)")):
        axes.set(
            xlabel="signal to noise (dB)", ylabel=f"{label}; the lowest line: none", ylim=(0.8 * _LEAST_SHARE, 120.0)
        )
        axes.legend()
    return figure


def _joined(found: Found, name: str, chain: str) -> NDArray[Any]:
    return np.concatenate([getattr(outcome, name)[chain] for _, outcome in found])


def _axes() -> tuple[Figure, Any]:
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    return figure, figure.add_subplot()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


_POSITION: dict[str, Callable[[Cells], Figure | None]] = {"scatter": _scatter, "range": _over_range_and_angle}
_PLOTS: dict[str, dict[str, Callable[[Cells], Figure | None]]] = {
    "I1": {"timing": _timing, "bands": _timing_bands},
    "I2": _POSITION,
    "I3": _POSITION,
    "I4": {"echo": _echo},
    "I5": _POSITION,
    "I6": {"radial": _radial},
    "I7": {"bench": _bench},
    "I8": {"yaw": _yaw, "dives": _dives},
    "I9": {"message": _message},
}
