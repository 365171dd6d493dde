"""The report of a run: one HTML file that needs nothing else, for the diver first and the engineer second."""

from __future__ import annotations

import platform
from dataclasses import fields, is_dataclass
from html import escape
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from bluerov_slam import __version__
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.protocol.navigation_json import LABELS
from bluerov_slam.records import SensorTrust
from bluerov_slam.survey.navigation_run import NavigationRun
from bluerov_slam.survey.navigation_summary import NIS_FITS, trust_periods
from bluerov_slam.survey.report_page import figure_html, page_html

_MOST_ROWS = 60
_OPEN_ROWS = 12
_VERDICTS = {
    "fits": "as large as stated",
    "too_large": "larger than stated: the uncertainty is too small while this sensor leads",
    "too_small": "smaller than stated: the uncertainty is on the safe side",
    "unknown": "too few values to tell",
}
_TRUST_WORDS = {
    SensorTrust.WAITING: "not usable yet",
    SensorTrust.REJECTED: "refused",
    SensorTrust.IGNORED: "ignored",
}
_SHOWN_VERSIONS = ("numpy", "matplotlib", "mcap")


def report_html(
    run: NavigationRun,
    summary: dict[str, Any],
    plots: dict[str, str] | None,
    options: NavigatorOptions,
) -> str:
    """The whole page. `plots` is None where they could not be drawn."""
    parts = [
        _head(summary),
        _banners(run, summary, plots),
        _facts(summary),
        _in_short(summary),
        _section_track(run, summary, plots or {}),
        figure_html(plots, "depth", "Depth", "Below the surface. The band holds the true depth with 95 % probability."),
        figure_html(
            plots, "velocity", "Speed",
            "Over ground, and the current as far as it was found out. A wide band means that nothing measured the "
            "speed: it was inferred.",
        ),
        figure_html(plots, "attitude", "Heading, roll and pitch", "True heading, clockwise from north."),
        _section_water(summary, plots),
        _section_sensors(run, summary, plots),
        _section_events(summary),
        _section_settings(summary, options),
    ]  # fmt: skip
    return page_html(f"Navigation of {_name(summary)}", parts)


def duration_words(seconds: float) -> str:
    """`45 s`, `3 min 20 s`, `1 h 05 min`."""
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def in_short(summary: dict[str, Any]) -> list[str]:
    """The run in plain sentences."""
    seconds, total = summary["seconds_by_mode"], summary["duration_s"]
    aided, reckoned = seconds["aided"], seconds["dead_reckoning"]
    sentences = [f"The recording lasts {duration_words(total)}."]
    if summary["origin"] is None:
        sentences.append(
            "Nothing in it says where the vehicle was: no GPS fix and no position from outside. There is no track, "
            "only attitude, depth and what else the sensors told."
        )
        return sentences
    held = f"For {duration_words(aided)} ({_share(aided, total)}) the position was held by fixes"
    if reckoned:
        held += (
            f"; for {duration_words(reckoned)} ({_share(reckoned, total)}) it was dead reckoned: carried on from "
            "heading and speed, with an error that grows. The longest such stretch was "
            f"{duration_words(summary['longest_dead_reckoning_s'])}"
        )
    sentences.append(f"{held}.")
    error = summary["error_95_m"]["smoothed"] or summary["error_95_m"]["live"]
    if error["median"] is not None:
        sentences.append(
            f"With 95 % probability the vehicle was within {_metres(error['median'])} of the track for half the time, "
            f"and at the worst moment within {_metres(error['largest'])}, if the sensors behaved as assumed; whether "
            "they did is checked under Sensors."
        )
    if summary["smoothed"]:
        sentences.append(
            "The track is smoothed: every position also uses what was measured after it. It is better than what could "
            "be known live, which is drawn in grey."
        )
    else:
        sentences.append("The track is as it was known live: no position uses what was measured after it.")
    if summary["corrections"]:
        limit = summary["correction_above"]
        sentences.append(
            f"{_times(summary['corrections'])} a measurement moved the live position or heading by more than "
            f"{limit['position_m']:g} m or {limit['heading_deg']:g} degrees at once."
        )
    return sentences


def _head(summary: dict[str, Any]) -> str:
    started = summary["started_utc"]
    when = "date unknown" if started is None else f"{started[:10]} {started[11:19]} UTC"
    origin = f", imported from {summary['imported_from']}" if summary["imported_from"] else ""
    return f"<h1>Navigation of {escape(_name(summary))}</h1><p class=sub>{escape(when + origin)}</p>"


def _banners(run: NavigationRun, summary: dict[str, Any], plots: dict[str, str] | None) -> str:
    banners = []
    if summary["simulated"]:
        banners.append(("", "Simulated: the sensors of this dive were made by a program, not by a vehicle."))
    banners += [("bad", f"Not everything could be read: {problem}.") for problem in run.problems]
    if plots is None:
        banners.append(("", 'No plots: matplotlib is not installed. Get it with pip install "bluerov-slam[survey]".'))
    return "".join(f'<p class="banner {kind}">{escape(text)}</p>' for kind, text in banners)


def _facts(summary: dict[str, Any]) -> str:
    error = summary["error_95_m"]["smoothed"] or summary["error_95_m"]["live"]
    total = summary["duration_s"]
    facts = [
        (duration_words(total), "duration"),
        ("unknown" if summary["distance_m"] is None else _metres(summary["distance_m"]), "distance travelled"),
        (_or_unknown(summary["depth_m"]["greatest"]), "greatest depth"),
        (_share(summary["seconds_by_mode"]["aided"], total), "of the time held by fixes"),
        (_or_unknown(error["median"]), "95 % error, median"),
        (_or_unknown(error["largest"]), "95 % error, largest"),
    ]
    return (
        f"<div class=facts>{''.join(f'<div><b>{escape(v)}</b><span>{escape(k)}</span></div>' for v, k in facts)}</div>"
    )


def _in_short(summary: dict[str, Any]) -> str:
    return f"<h2>In short</h2><p>{escape(' '.join(in_short(summary)))}</p>"


def _section_track(run: NavigationRun, summary: dict[str, Any], plots: dict[str, str]) -> str:
    if summary["origin"] is None:
        return ""
    origin = summary["origin"]
    caption = (
        "Green: the position was held by fixes. Orange: dead reckoning. The blue ellipses each hold the true position "
        "with 95 % probability; they are the answer to how far the line may be trusted. Refused fixes disagreed with "
        "everything else by more than chance allows."
    )
    fixes = "".join(
        f"<tr><td>{escape(source)}<td class=n>{count['accepted']}<td class=n>{count['rejected']}"
        f"<td class=n>{count['not_tested']}"
        for source, count in summary["fixes"].items()
    )
    table = (
        f"<table><tr><th>Source<th class=n>used<th class=n>refused<th class=n>not tested{fixes}</table>"
        if fixes
        else ""
    )
    place = f"Origin {origin['latitude_deg']:.6f}, {origin['longitude_deg']:.6f} (WGS-84)."
    error = figure_html(
        plots or None, "error", "", "The long half-axis of the 95 % ellipse over time. Ticks at the bottom are fixes."
    )
    return figure_html(plots or None, "track", "Track", f"{caption} {place}") + error + table


def _section_water(summary: dict[str, Any], plots: dict[str, str] | None) -> str:
    water = summary["water"]
    if water is None:
        return ""
    text = (
        f"By the vehicle's own CTD, from {_metres(water['shallowest_m'])} to {_metres(water['deepest_m'])}; from "
        "descents where there were any. Depth was reckoned with this density."
    )
    mean, std = water["mean_sound_speed_mps"], water["mean_sound_speed_std_mps"]
    if mean is not None:
        text += f" Mean sound speed {mean:.1f} m/s, within {2.0 * std:.1f} m/s with 95 % probability (harmonic mean)."
    caption = "The band is what the sensors may be off by, all along alike. The figures are in water.csv."
    return f"<h2>Water</h2><p>{escape(text)}</p>" + figure_html(plots, "water", "", caption)


def _section_sensors(run: NavigationRun, summary: dict[str, Any], plots: dict[str, str] | None) -> str:
    heard = [sensor for sensor in summary["sensors"] if sensor["trust_at_end"] != "absent" or sensor["tested"]]
    absent = [sensor["label"] for sensor in summary["sensors"] if sensor not in heard]
    rows = "".join(map(_sensor_row, heard))
    text = (
        "Every measurement is compared with what all others led to expect. Its squared error over the stated one (NIS) "
        f"is 1 on average when the stated errors are right; {NIS_FITS[0]} to {NIS_FITS[1]} counts as right. What was "
        "refused is not in the average."
    )
    missing = f"<p>Not heard at all: {escape(', '.join(absent))}.</p>" if absent else ""
    parts = [
        "<h2>Sensors</h2>",
        f"<p>{escape(text)}</p>",
        "<table><tr><th>Sensor<th class=n>used<th class=n>refused<th class=n>NIS<th>Its errors were",
        rows,
        "</table>",
        missing,
        figure_html(plots, "trust", "", "When each sensor was trusted."),
        _trust_table(run),
        figure_html(
            plots,
            "innovations",
            "",
            "Differences from what was expected, in stated standard deviations. About 95 % should lie in the band; "
            "crosses were refused (drawn at 6 where they are larger).",
        ),
        figure_html(
            plots,
            "nis",
            "",
            "NIS per degree of freedom, averages over 25 used values. 95 % of them should lie in the green band; "
            "errors that change slowly, as those of compass and GPS do, wander in and out.",
        ),
    ]
    return "".join(parts)


def _sensor_row(sensor: dict[str, Any]) -> str:
    ratio = "" if sensor["nis_ratio"] is None else f"{sensor['nis_ratio']:.2f}"
    verdict = _VERDICTS[sensor["verdict"]] if sensor["tested"] else "not tested against the others"
    if sensor["verdict"] == "unknown" and sensor["accepted"] > sensor["tested"]:
        # The gyro and accelerometer carry the estimate; all others are tested against them.
        verdict = "not tested: it carries the estimate from one measurement to the next"
    return (
        f"<tr><td>{escape(sensor['label'])}<td class=n>{sensor['accepted']}<td class=n>{sensor['rejected']}"
        f"<td class=n>{ratio}<td>{escape(verdict)}"
    )


def _trust_table(run: NavigationRun) -> str:
    periods = [period for period in trust_periods(run) if period[1] - period[0] >= 1.0]
    if not periods:
        return "<p>Every sensor that was heard was used all the time.</p>"
    rows = "".join(
        f"<tr><td>{_clock(begin)}<td>{_clock(end)}<td>{escape(LABELS.get(name, name))}"
        f"<td>{escape(_TRUST_WORDS[trust])}{escape(': ' + reason) if reason else ''}"
        for begin, end, name, trust, reason in periods[:_MOST_ROWS]
    )
    more = f"<p>{len(periods) - _MOST_ROWS} more such periods.</p>" if len(periods) > _MOST_ROWS else ""
    table = f"<table><tr><th>from<th>to<th>Sensor<th>was{rows}</table>{more}"
    opened = "open" if len(periods) <= _OPEN_ROWS else ""
    return f"<details {opened}><summary>When a sensor was not used</summary>{table}</details>"


def _section_events(summary: dict[str, Any]) -> str:
    events = summary["events"]
    if not events:
        return ""
    rows = "".join(f"<tr><td>{_clock(event['at_s'])}<td>{escape(event['text'])}" for event in events[:_MOST_ROWS])
    more = f"<p>{len(events) - _MOST_ROWS} more.</p>" if len(events) > _MOST_ROWS else ""
    return f"<h2>What the navigator said</h2><table>{rows}</table>{more}"


def _section_settings(summary: dict[str, Any], options: NavigatorOptions) -> str:
    rows = "".join(f"<tr><td>{escape(name)}<td>{escape(value)}" for name, value in _flat("", options))
    records = ", ".join(f"{count} {name}" for name, count in summary["records"].items())
    versions = [f"BlueROV SLAM {__version__}", f"Python {platform.python_version()}"]
    for package in _SHOWN_VERSIONS:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return (
        "<h2>Settings and versions</h2>"
        f"<p>{escape(', '.join(versions))}.</p><p>Records read: {escape(records)}.</p>"
        f"<details><summary>Every setting of the navigator</summary><table>{rows}</table></details>"
    )


def _flat(prefix: str, value: object) -> list[tuple[str, str]]:
    if is_dataclass(value):
        pairs = ((field.name, getattr(value, field.name)) for field in fields(value))
        return [row for name, inner in pairs for row in _flat(f"{prefix}.{name}" if prefix else name, inner)]
    return [(prefix, f"{value:g}" if isinstance(value, float) else str(value))]


def _times(count: int) -> str:
    return "Once" if count == 1 else f"{count} times"


def _name(summary: dict[str, Any]) -> str:
    return str(summary["title"] or summary["imported_from"] or summary["recording"])


def _share(part_s: float, total_s: float) -> str:
    # With a space that does not break.
    return f"{100.0 * part_s / total_s:.0f}\u00a0%" if total_s > 0.0 else "0\u00a0%"


def _metres(value_m: float) -> str:
    return f"{value_m:.1f} m" if abs(value_m) < 100.0 else f"{value_m:.0f} m"


def _or_unknown(value_m: float | None) -> str:
    return "unknown" if value_m is None else _metres(value_m)


def _clock(seconds: float) -> str:
    """Minutes and seconds since the start."""
    whole = max(0, round(seconds))
    return f"{whole // 60}:{whole % 60:02d}"
