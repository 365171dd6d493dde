"""A run in figures: what the report says in words and a program reads as JSON. Unknown is None."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam import __version__
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.pipeline.navigator_water import water_json
from bluerov_slam.protocol.navigation_json import LABELS
from bluerov_slam.records import NavMode, SensorTrust
from bluerov_slam.sources.recording_reader import Recording
from bluerov_slam.survey.navigation_run import NavigationRun
from bluerov_slam.survey.navigation_track import MODES, NavTrack
from bluerov_slam.survey.track_files import utc_text

FORMAT_VERSION = 1

# A mean NIS per degree of freedom within these says that the stated errors are right (docs/navigation.md, N6).
NIS_FITS = (0.7, 1.4)
# Fewer values than this say nothing.
NIS_FEW = 20
# Between two rows of a track there may be this much, or the time in between is nobody's.
_LONGEST_STEP_S = 5.0


def summarize(run: NavigationRun, recording: Recording, options: NavigatorOptions) -> dict[str, Any]:
    """Everything that is one number, or a handful."""
    track = run.track
    utc_offset_s = recording.utc_offset_s
    started = None if utc_offset_s is None else utc_text(run.start_s + utc_offset_s)
    return {
        "version": FORMAT_VERSION,
        "bluerov_slam_version": __version__,
        "recording": recording.path.resolve().name,
        "title": recording.session.get("title") or None,
        "imported_from": recording.imported_from,
        "simulated": recording.simulated,
        "started_utc": started,
        "duration_s": round(run.end_s - run.start_s, 3),
        "records": dict(sorted(run.records.items())),
        "states": run.states,
        "smoothed": run.smoothed is not None,
        "origin": None
        if run.origin_deg is None
        else {"latitude_deg": round(run.origin_deg[0], 8), "longitude_deg": round(run.origin_deg[1], 8)},
        "distance_m": _finite(float(run.filtered["distance_m"][-1]), 1) if len(run.filtered) else None,
        "corrections": int(np.count_nonzero(np.diff(run.filtered["reset_counter"]))) if len(run.filtered) else 0,
        "correction_above": {
            "position_m": options.jump_m,
            "heading_deg": round(math.degrees(options.jump_heading_rad), 3),
        },
        "depth_m": _range(track["depth_m"]),
        "seconds_by_mode": seconds_by_mode(run.filtered),
        "longest_dead_reckoning_s": longest_in_mode(run.filtered, NavMode.DEAD_RECKONING),
        "error_95_m": {
            "live": _error(run.filtered),
            "smoothed": None if run.smoothed is None else _error(run.smoothed),
        },
        "end": _end(track),
        "fixes": _fixes(run),
        "water": None if run.water is None else water_json(run.water),
        "sensors": [sensor_summary(run, sensor.name) for sensor in run.sensors],
        "events": [
            {"at_s": round(event.at_s - run.start_s, 2), "level": event.level.value, "text": event.text}
            for event in run.events
        ],
        "problems": run.problems,
    }


def sensor_summary(run: NavigationRun, name: str) -> dict[str, Any]:
    """One sensor over the whole run. `nis_ratio` is over the values that were used, `nis_ratio_all` over all tested."""
    sensor = next(sensor for sensor in run.sensors if sensor.name == name)
    updates = run.updates.get(name)
    ratio = ratio_all = band = None
    tested = count = 0
    if updates is not None and len(updates.nis):
        tested, count = len(updates.nis), int(np.count_nonzero(updates.accepted))
        ratio_all = float(updates.nis.sum() / updates.dof.sum())
    if updates is not None and count:
        dof = float(updates.dof[updates.accepted].sum())
        ratio = float(updates.nis[updates.accepted].sum()) / dof
        band = [round(chi_square_quantile(p, dof) / dof, 3) for p in (0.025, 0.975)]
    return {
        "id": name,
        "label": LABELS.get(name, name),
        "trust_at_end": sensor.trust.value,
        "reason_at_end": sensor.reason,
        "accepted": sensor.accepted,
        "rejected": sensor.rejected,
        "tested": tested,
        "nis_ratio": None if ratio is None else _finite(ratio, 3),
        "nis_ratio_all": None if ratio_all is None else _finite(ratio_all, 3),
        "nis_band_95": band,
        "verdict": nis_verdict(ratio, count),
    }


def nis_verdict(ratio: float | None, count: int) -> str:
    """`fits`, `too_large` (errors larger than assumed), `too_small`, or `unknown`."""
    if ratio is None or count < NIS_FEW or not math.isfinite(ratio):
        return "unknown"
    return "too_small" if ratio < NIS_FITS[0] else "too_large" if ratio > NIS_FITS[1] else "fits"


def seconds_by_mode(track: NavTrack) -> dict[str, float]:
    """How long each mode lasted, as it was live."""
    seconds = dict.fromkeys((mode.value for mode in MODES), 0.0)
    if len(track) > 1:
        steps = np.minimum(np.diff(track["at_s"]), _LONGEST_STEP_S)
        for place, mode in enumerate(MODES):
            seconds[mode.value] = round(float(steps[track["mode"][:-1] == place].sum()), 1)
    return seconds


def longest_in_mode(track: NavTrack, mode: NavMode) -> float:
    """The longest unbroken stretch in a mode, seconds."""
    here = track["mode"] == MODES.index(mode)
    longest = 0.0
    begin: float | None = None
    for at_s, inside in zip(track["at_s"], here, strict=True):
        if inside and begin is None:
            begin = float(at_s)
        elif not inside and begin is not None:
            longest, begin = max(longest, float(at_s) - begin), None
    if begin is not None:
        longest = max(longest, float(track["at_s"][-1]) - begin)
    return round(longest, 1)


def trust_periods(run: NavigationRun) -> list[tuple[float, float, str, SensorTrust, str]]:
    """From, to (seconds since the start), sensor, trust, reason: whenever a sensor that was heard was not used."""
    periods = []
    for name in [sensor.name for sensor in run.sensors]:
        changes = [change for change in run.trust if change.sensor == name]
        ends = [change.at_s for change in changes[1:]] + [run.end_s]
        for change, end_s in zip(changes, ends, strict=True):
            if change.trust not in (SensorTrust.USED, SensorTrust.ABSENT):
                periods.append((change.at_s - run.start_s, end_s - run.start_s, name, change.trust, change.reason))
    return sorted(periods, key=lambda period: period[0])


def _fixes(run: NavigationRun) -> dict[str, dict[str, int]]:
    counts: dict[str, Counter[str]] = {}
    for fix in run.fixes:
        word = {True: "accepted", False: "rejected", None: "not_tested"}[fix.accepted]
        counts.setdefault(fix.source, Counter())[word] += 1
    return {
        source: {word: count[word] for word in ("accepted", "rejected", "not_tested")}
        for source, count in counts.items()
    }


def _end(track: NavTrack) -> dict[str, Any] | None:
    rows = np.flatnonzero(track.has_position)
    if not len(rows):
        return None
    row = int(rows[-1])
    return {
        "latitude_deg": _finite(float(track["latitude_deg"][row]), 8),
        "longitude_deg": _finite(float(track["longitude_deg"][row]), 8),
        "depth_m": _finite(float(track["depth_m"][row]), 2),
        "error_95_m": _finite(float(track["major_95_m"][row]), 2),
    }


def _error(track: NavTrack) -> dict[str, float | None]:
    errors = track["major_95_m"]
    errors = errors[np.isfinite(errors)]
    if not len(errors):
        return {"median": None, "largest": None}
    return {"median": _finite(float(np.median(errors)), 2), "largest": _finite(float(np.max(errors)), 2)}


def _range(values: NDArray[np.float64]) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return {"least": None, "greatest": None}
    return {"least": _finite(float(finite.min()), 2), "greatest": _finite(float(finite.max()), 2)}


def _finite(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
