"""Plots of a run as SVG text. Needs matplotlib (the extra `survey`); no display, no network."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.protocol.navigation_json import LABELS
from bluerov_slam.records import NavMode, SensorTrust
from bluerov_slam.survey.navigation_run import NavigationRun, SensorUpdates
from bluerov_slam.survey.navigation_summary import NIS_FEW
from bluerov_slam.survey.navigation_track import MODES, NavTrack
from bluerov_slam.survey.plot_style import STYLE, as_svg
from bluerov_slam.survey.track_files import ellipse_outline, rows_apart

FloatArray = NDArray[np.float64]

MODE_COLORS = {
    NavMode.STARTING: "#8c959f",
    NavMode.ATTITUDE: "#8c959f",
    NavMode.DEAD_RECKONING: "#d1590a",
    NavMode.AIDED: "#1a7f37",
}
TRUST_COLORS = {
    SensorTrust.ABSENT: "#eaeef2",
    SensorTrust.WAITING: "#c8d1da",
    SensorTrust.USED: "#4ac26b",
    SensorTrust.REJECTED: "#e5534b",
    SensorTrust.IGNORED: "#d4a72c",
}
_LIVE, _BEST, _BAND, _WARN = "#8c959f", "#0969da", "#b6d4fe", "#cf222e"
_MOST_POINTS = 2000
_MOST_DOTS = 3000
_ELLIPSES = 60
_NIS_WINDOW = 25
_LEAST_NIS, _MOST_NIS = 0.01, 30.0
_TWO_SIGMA = 2.0
_NARROWEST_VIEW = 0.5
_MOST_REACH_M = 50.0
_COMPONENTS = {
    "imu": ("about north", "about east", "about down"),
    "compass": ("heading",),
    "gps": ("north", "east"),
    "position": ("north", "east"),
    "thrust": ("forward", "starboard", "down"),
    "dvl": ("forward", "starboard", "down"),
}


def draw(run: NavigationRun) -> dict[str, str]:
    """Every plot there is something to draw for, by name."""
    plots: dict[str, Callable[[NavigationRun], Figure | None]] = {
        "track": _track,
        "error": _error,
        "depth": _depth,
        "velocity": _velocity,
        "attitude": _attitude,
        "water": _water,
        "innovations": _innovations,
        "nis": _nis,
        "trust": _trust,
    }
    drawn = {}
    with matplotlib.rc_context(STYLE):
        for name, plot in plots.items():
            figure = plot(run)
            if figure is not None:
                drawn[name] = as_svg(figure)
    return drawn


def _track(run: NavigationRun) -> Figure | None:
    track = run.track
    if run.origin_deg is None or not track.has_position.any():
        return None
    frame = LocalFrame(*run.origin_deg)
    figure = Figure(figsize=(9.0, 7.0))
    axes = figure.add_subplot()
    for index, row in enumerate(rows_apart(track, max(1.0, (run.end_s - run.start_s) / _ELLIPSES))):
        place = frame.to_ned_m(float(track["latitude_deg"][row]), float(track["longitude_deg"][row]))
        outline = ellipse_outline(track, row)
        axes.fill(
            place[1] + outline[1], place[0] + outline[0], facecolor=_BAND, edgecolor="none", alpha=0.35,
            label="95 % error ellipse" if index == 0 else None,
        )  # fmt: skip
    if run.smoothed is not None:
        north, east = run.filtered.local(frame)
        axes.plot(*_thin(east, north), color=_LIVE, linewidth=0.8, label="as known live")
    _draw_modes(axes, track, *track.local(frame))
    _draw_fixes(axes, run, frame)
    rows = np.flatnonzero(track.has_position)
    north, east = track.local(frame)
    axes.plot(east[rows[0]], north[rows[0]], "^", color="black", markersize=8, label="start")
    axes.plot(east[rows[-1]], north[rows[-1]], "s", color="black", markersize=7, label="end")
    axes.set(xlabel="east of origin (m)", ylabel="north of origin (m)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return figure


def _draw_modes(axes: Any, track: NavTrack, north: FloatArray, east: FloatArray) -> None:
    words = {NavMode.AIDED: "held by fixes", NavMode.DEAD_RECKONING: "dead reckoning"}
    for mode, label in words.items():
        here = track["mode"] == MODES.index(mode)
        if not here.any():
            continue
        # The line reaches to where the next stretch begins.
        reach = here | np.concatenate(([False], here[:-1]))
        x, y = np.where(reach, east, np.nan), np.where(reach, north, np.nan)
        axes.plot(*_thin(x, y), color=MODE_COLORS[mode], linewidth=1.6, label=label, zorder=3)


def _draw_fixes(axes: Any, run: NavigationRun, frame: LocalFrame) -> None:
    for accepted, marker, color, label in (
        (True, ".", "#8c959f", "fix, used"),
        (None, ".", "#c8d1da", "fix, not tested"),
        (False, "x", _WARN, "fix, refused"),
    ):
        chosen = [fix for fix in run.fixes if fix.accepted is accepted]
        if not chosen:
            continue
        places = np.array([frame.to_ned_m(fix.latitude_deg, fix.longitude_deg)[:2] for fix in chosen])
        places = places[:: max(1, len(places) // _MOST_DOTS)]
        axes.plot(
            places[:, 1], places[:, 0], marker, color=color, markersize=3.0, linestyle="none", label=label, zorder=1.5
        )
    _keep_near(axes, run, frame)


def _keep_near(axes: Any, run: NavigationRun, frame: LocalFrame) -> None:
    """A refused fix a kilometre away must not shrink the dive to a dot: the view is that of the track."""
    north, east = run.track.local(frame)
    errors = run.track["major_95_m"]
    reach = float(np.nanmedian(errors)) if np.isfinite(errors).any() else 0.0
    margin = max(5.0, 0.15 * max(float(np.nanmax(north) - np.nanmin(north)), float(np.nanmax(east) - np.nanmin(east))))
    west, south, width, height = _view(north, east, margin + min(reach, _MOST_REACH_M))
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(west, west + width)
    axes.set_ylim(south, south + height)


def _view(north: FloatArray, east: FloatArray, margin: float) -> tuple[float, float, float, float]:
    """West, south, width and height of a view that is neither a ribbon nor a tower."""
    low = np.array((np.nanmin(east), np.nanmin(north))) - margin
    high = np.array((np.nanmax(east), np.nanmax(north))) + margin
    size = np.maximum(high - low, _NARROWEST_VIEW * float(np.max(high - low)))
    middle = (low + high) / 2.0
    west, south = middle - size / 2.0
    return float(west), float(south), float(size[0]), float(size[1])


def _error(run: NavigationRun) -> Figure | None:
    if not np.isfinite(run.filtered["major_95_m"]).any():
        return None
    figure, axes = _time_figure(2.4)
    axes.plot(*_thin(_minutes(run, run.filtered), run.filtered["major_95_m"]), color=_LIVE, label="as known live")
    if run.smoothed is not None:
        axes.plot(*_thin(_minutes(run, run.smoothed), run.smoothed["major_95_m"]), color=_BEST, label="smoothed")
    used = [(fix.at_s - run.start_s) / 60.0 for fix in run.fixes if fix.accepted]
    if used:
        axes.plot(used, np.zeros(len(used)), "|", color="#57606a", markersize=6, label="fix used")
    axes.set(ylabel="95 % error, long axis (m)")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left")
    return figure


def _depth(run: NavigationRun) -> Figure | None:
    track = run.track
    if not np.isfinite(track["depth_m"]).any():
        return None
    figure, axes = _time_figure(2.4)
    minutes, depth, std = _thin(_minutes(run, track), track["depth_m"], track["depth_std_m"])
    axes.fill_between(
        minutes, depth - _TWO_SIGMA * std, depth + _TWO_SIGMA * std, color=_BAND, linewidth=0, label="95 % band"
    )
    axes.plot(minutes, depth, color=_BEST, linewidth=1.0, label="depth")
    if np.isfinite(track["altitude_m"]).any():
        at, bottom = _thin(_minutes(run, track), track["depth_m"] + track["altitude_m"])
        axes.plot(at, bottom, color="#8a6d3b", linewidth=1.0, label="bottom")
    axes.invert_yaxis()
    axes.set(ylabel="depth (m)")
    axes.legend(loc="best")
    return figure


def _velocity(run: NavigationRun) -> Figure | None:
    track = run.track
    if not np.isfinite(track["north_mps"]).any():
        return None
    figure = Figure(figsize=(9.0, 4.2))
    upper, lower = figure.subplots(2, 1, sharex=True)
    minutes, speed, std = _thin(_minutes(run, track), track.speed_mps, track["speed_std_mps"])
    upper.fill_between(
        minutes, np.maximum(speed - _TWO_SIGMA * std, 0.0), speed + _TWO_SIGMA * std, color=_BAND, linewidth=0,
        label="95 % band",
    )  # fmt: skip
    upper.plot(minutes, speed, color=_BEST, linewidth=0.8, label="speed over ground")
    upper.set(ylabel="m/s")
    upper.set_ylim(0.0, _above(speed))
    upper.legend(loc="upper left")
    for name, color, label in (("north_mps", "#0969da", "north"), ("east_mps", "#bf3989", "east")):
        lower.plot(*_thin(_minutes(run, track), track[name]), color=color, linewidth=0.8, label=label)
    for name, color, label in (
        ("current_north_mps", "#0969da", "current north"),
        ("current_east_mps", "#bf3989", "current east"),
    ):
        if np.isfinite(track[name]).any():
            at, value = _thin(_minutes(run, track), track[name])
            lower.plot(at, value, color=color, linewidth=1.0, linestyle="--", label=label)
    lower.set(ylabel="m/s", xlabel="minutes since the start")
    lower.legend(loc="upper left", ncols=4)
    return figure


def _attitude(run: NavigationRun) -> Figure | None:
    track = run.track
    if not np.isfinite(track["heading_rad"]).any():
        return None
    figure = Figure(figsize=(9.0, 4.2))
    upper, lower = figure.subplots(2, 1, sharex=True)
    minutes, heading = _thin(_minutes(run, track), np.degrees(track["heading_rad"]))
    upper.plot(minutes, _without_wraps(heading), color=_BEST, linewidth=0.8)
    upper.set(ylabel="heading (deg)", yticks=range(0, 361, 90))
    for name, color, label in (("roll_rad", "#0969da", "roll"), ("pitch_rad", "#bf3989", "pitch")):
        lower.plot(*_thin(_minutes(run, track), np.degrees(track[name])), color=color, linewidth=0.8, label=label)
    lower.plot(
        *_thin(_minutes(run, track), np.degrees(track["heading_std_rad"])), color="#57606a", linewidth=0.8,
        linestyle="--", label="1 sigma of heading",
    )  # fmt: skip
    lower.set(ylabel="deg", xlabel="minutes since the start")
    lower.legend(loc="upper left", ncols=3)
    return figure


def _water(run: NavigationRun) -> Figure | None:
    column = run.water
    if column is None:
        return None
    figure = Figure(figsize=(9.0, 4.2))
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, value, std, label in (
        (left, column.sound_speed_mps, column.sound_speed_std_mps, "sound speed (m/s)"),
        (right, column.density_kg_per_m3, column.density_std_kg_per_m3, "density (kg/m3)"),
    ):
        axes.fill_betweenx(
            column.depth_m, value - _TWO_SIGMA * std, value + _TWO_SIGMA * std, color=_BAND, linewidth=0,
            label="95 % band",
        )  # fmt: skip
        axes.plot(value, column.depth_m, color=_BEST, linewidth=1.0, marker="." if len(value) < 40 else "")
        axes.ticklabel_format(useOffset=False)
        axes.set(xlabel=label)
    left.invert_yaxis()
    left.set(ylabel="depth (m)")
    left.legend(loc="best")
    return figure


def _innovations(run: NavigationRun) -> Figure | None:
    shown = _tested(run)
    if not shown:
        return None
    figure, stack = _stacked([name for name, _ in shown], run)
    for axes, (name, updates) in zip(stack, shown, strict=True):
        ratio = updates.residual / updates.sigma
        minutes = (updates.at_s - run.start_s) / 60.0
        axes.axhspan(-_TWO_SIGMA, _TWO_SIGMA, color=_BAND, alpha=0.6, linewidth=0)
        step = max(1, len(minutes) // _MOST_DOTS)
        names = _COMPONENTS.get(name, ())
        for component, color in enumerate(("#0969da", "#bf3989", "#57606a")):
            values = ratio[:, component]
            if not np.isfinite(values).any():
                continue
            used, refused = updates.accepted, ~updates.accepted
            label = names[component] if component < len(names) else str(component + 1)
            axes.plot(minutes[used][::step], values[used][::step], ".", color=color, markersize=2, label=label)
            axes.plot(minutes[refused], np.clip(values[refused], -6.0, 6.0), "x", color=_WARN, markersize=3.5)
        axes.set_ylim(-6.2, 6.2)
        if np.isfinite(ratio[:, 1]).any():
            axes.legend(loc="upper right", ncols=3, markerscale=3)
    return figure


def _nis(run: NavigationRun) -> Figure | None:
    shown = _tested(run)
    if not shown:
        return None
    figure, stack = _stacked([name for name, _ in shown], run)
    for axes, (_, updates) in zip(stack, shown, strict=True):
        at_min, mean, low, high = nis_windows(updates, run.start_s)
        axes.axhspan(low, high, color="#dafbe1", linewidth=0)
        axes.axhline(1.0, color="#57606a", linewidth=0.6)
        # A logarithm has no zero: what is smaller lies on the lower edge.
        axes.plot(
            at_min,
            np.clip(mean, _LEAST_NIS, _MOST_NIS),
            color=_BEST,
            linewidth=0.9,
            marker="." if len(mean) < 40 else "",
        )
        axes.set_yscale("log")
        axes.set_ylim(0.8 * _LEAST_NIS, 1.25 * _MOST_NIS)
        axes.set_yticks([0.01, 0.1, 1.0, 10.0], labels=["0.01", "0.1", "1", "10"])
        axes.minorticks_off()
    return figure


def nis_windows(updates: SensorUpdates, start_s: float) -> tuple[FloatArray, FloatArray, float, float]:
    """Mean of NIS per degree of freedom over windows of 25 values, and the band 95 % of them should lie in."""
    used = updates.accepted
    count = int(np.count_nonzero(used))
    size = min(_NIS_WINDOW, count)
    windows = count // size
    shape = (windows, size)
    nis, dof = (values[used][: windows * size].reshape(shape) for values in (updates.nis, updates.dof))
    at_min = (updates.at_s[used][: windows * size].reshape(shape).mean(axis=1) - start_s) / 60.0
    mean = nis.sum(axis=1) / dof.sum(axis=1)
    typical = float(np.median(dof.sum(axis=1)))
    low, high = (chi_square_quantile(p, typical) / typical for p in (0.025, 0.975))
    return at_min, mean, low, high


def _trust(run: NavigationRun) -> Figure | None:
    names = [sensor.name for sensor in run.sensors if sensor.trust is not SensorTrust.ABSENT]
    if not names:
        return None
    figure, axes = _time_figure(0.35 * len(names) + 0.9)
    for row, name in enumerate(names):
        changes = [change for change in run.trust if change.sensor == name]
        ends = [change.at_s for change in changes[1:]] + [run.end_s]
        for change, end_s in zip(changes, ends, strict=True):
            begin, width = (change.at_s - run.start_s) / 60.0, max(end_s - change.at_s, 0.0) / 60.0
            axes.barh(row, width, left=begin, height=0.7, color=TRUST_COLORS[change.trust], linewidth=0)
    axes.set_yticks(range(len(names)), labels=[LABELS.get(name, name) for name in names])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    for trust, color in TRUST_COLORS.items():
        if any(change.trust is trust for change in run.trust):
            axes.barh(0, 0.0, color=color, label=trust.value)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    axes.set_xlim(0.0, _length_min(run))
    return figure


def _tested(run: NavigationRun) -> list[tuple[str, SensorUpdates]]:
    order = {name: place for place, name in enumerate(LABELS)}
    # Priors are measured against, too, but are no sensors.
    tested = [
        (name, each)
        for name, each in run.updates.items()
        if name in order and np.count_nonzero(each.accepted) >= NIS_FEW
    ]
    return sorted(tested, key=lambda item: order[item[0]])


def _stacked(names: list[str], run: NavigationRun) -> tuple[Figure, list[Any]]:
    """A plot over time for each sensor, one above the other."""
    figure = Figure(figsize=(9.0, 1.45 * len(names) + 0.5))
    stack = [figure.add_subplot(len(names), 1, place + 1) for place in range(len(names))]
    for axes, name in zip(stack, names, strict=True):
        axes.set_ylabel(LABELS.get(name, name))
        axes.set_xlim(0.0, _length_min(run))
        axes.tick_params(labelbottom=axes is stack[-1])
    stack[-1].set_xlabel("minutes since the start")
    return figure, stack


def _time_figure(height: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(9.0, height))
    axes = figure.add_subplot()
    axes.set_xlabel("minutes since the start")
    return figure, axes


def _minutes(run: NavigationRun, track: NavTrack) -> FloatArray:
    minutes: FloatArray = (track["at_s"] - run.start_s) / 60.0
    return minutes


def _length_min(run: NavigationRun) -> float:
    return max((run.end_s - run.start_s) / 60.0, 1e-3)


def _thin(*columns: FloatArray) -> tuple[FloatArray, ...]:
    step = max(1, math.ceil(len(columns[0]) / _MOST_POINTS))
    return tuple(column[::step] for column in columns)


def _without_wraps(heading_deg: FloatArray) -> FloatArray:
    """No line across the plot where the heading passes north."""
    broken = heading_deg.copy()
    broken[1:][np.abs(np.diff(heading_deg)) > 180.0] = np.nan
    return broken


def _above(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return max(0.5, 1.5 * float(np.percentile(finite, 99.0))) if len(finite) else 1.0
