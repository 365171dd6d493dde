"""The thesis's logs, read and replayed once, and what is measured on them: rows of figures beside their targets.

All of it is real data. Intervals of held-out scores come from resampling the logs: with 26 of them a single bad session
moves a figure, and that should show.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bluerov_slam.acoustics.slip_lattice import Floats
from bluerov_slam.acoustics.thesis_log import ThesisLog, error_mm, joined
from bluerov_slam.acoustics.thesis_replay import Replay, replay
from bluerov_slam.errors import RecordingError
from bluerov_slam.evaluation import thesis_held_out as held_out
from bluerov_slam.evaluation import thesis_table
from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.statistics import BAND, Interval
from bluerov_slam.evaluation.thesis_checks import check_truth, depth_noise_correlation
from bluerov_slam.evaluation.thesis_halves import Session, session_of
from bluerov_slam.evaluation.thesis_held_out import Parameters
from bluerov_slam.sources.isbl_thesis_log import LineKind, read_thesis_archive

FOLDER = "isbl_thesis"
_LOGS, _PUBLISHED = "raw_logs.tar.gz", "published_stats.json"
_PRINTED_MM = 0.0101
"""Two decimals were printed of the truth and of the attitude behind it."""
_RESAMPLES = 1000
_STATIONARY = "stationary"


@dataclass(frozen=True)
class ThesisStudy:
    """The logs, what their lines are, and the published numbers."""

    logs: list[ThesisLog]
    census: Counter[LineKind]
    published: dict[str, Any]

    @cached_property
    def replays(self) -> dict[str, Replay]:
        """Of whole logs, by name; a quarter of a minute."""
        return {log.name: replay(log) for log in self.logs}

    @property
    def scored_logs(self) -> list[ThesisLog]:
        """Those whose truth is right."""
        return [log for log in self.logs if log.truth_valid]

    @cached_property
    def sessions(self) -> list[Session]:
        """Those that can be scored, parted; their halves are replayed on their own."""
        return [session_of(log) for log in self.scored_logs]


def read_study(data_folder: Path) -> ThesisStudy:
    """From the folder that holds `isbl_thesis`. Raises RecordingError where it is not."""
    folder = data_folder / FOLDER
    if not all((folder / name).exists() for name in (_LOGS, _PUBLISHED)):
        raise RecordingError(f"{folder / _LOGS} is not there: the thesis's logs are needed (set BLUEROV_SLAM_DATA)")
    return study_of({name: (folder / name).read_bytes() for name in (_LOGS, _PUBLISHED)})


def study_of(files: Mapping[str, bytes]) -> ThesisStudy:
    """From the contents of that folder's files, by name. Raises RecordingError where one is not there."""
    missing = [name for name in (_LOGS, _PUBLISHED) if name not in files]
    if missing:
        raise RecordingError(f"{FOLDER}: {' and '.join(missing)} not there: the thesis's logs are needed")
    found = read_thesis_archive(files[_LOGS])
    published = json.loads(files[_PUBLISHED])
    return ThesisStudy(found.logs, found.census, published)


def reproduced_rows(study: ThesisStudy) -> list[Row]:
    """I20: what the thesis published and its receiver computed, out of the raw logs."""
    table = thesis_table.published_table(study.logs)
    cells, largest_mm = thesis_table.largest_difference_mm(table, study.published)
    read = study.census[LineKind.WHOLE] + study.census[LineKind.CUT]
    rows = [
        _plain("I20", "lines of data read (real)", read, "", None),
        _plain("I20", f"{cells} published cells, largest difference (real)", largest_mm, "mm", (None, 1e-9)),
    ]
    return _numbered(rows + _plain_statistics(study) + _replay_rows(study) + _check_rows(study))


def held_out_rows(study: ThesisStudy, parameters: Parameters) -> list[Row]:
    """I21: second halves, everything found from the first."""
    sessions = study.sessions
    measured = [session.measured for session in sessions]
    rows = []
    for name, positions in held_out.baselines(measured, {each.name: each.first for each in sessions}).items():
        rows += _scores("I21", f"{name}, as a baseline", sessions, positions, {})
    musts: Mapping[str, tuple[float, float]]
    for smoothed, musts in (
        (False, {"rmse": (38, 33), "median": (19, 16)}),
        (True, {"rmse": (35, 29), "median": (18, 14)}),
    ):
        kind = "smoothed" if smoothed else "causal"
        for anew in (True, False):
            positions = held_out.estimates(measured, parameters, smoothed=smoothed, anew=anew)
            how = "started anew in the second half" if anew else "running on from the first half"
            rows += _scores("I21", f"slip lattice {kind}, {how}", sessions, positions, musts)
            still = [session for session in sessions if session.motion == _STATIONARY]
            limit = 13.0 if smoothed else 18.0
            asked = {"rmse": (limit, limit)} if anew else {}
            rows += _scores("I21", f"slip lattice {kind}, stationary, {how}", still, positions, asked)[:1]
    blind = held_out.blind_estimates(measured, parameters, smoothed=True)
    rows += _scores("I21", "slip lattice smoothed, without any truth", sessions, blind, {"rmse": (58, 56)})
    return _numbered(rows)


def _numbered(rows: Sequence[Row]) -> list[Row]:
    """With ids of their own."""
    return [replace(row, id=f"{row.id}.{number}") for number, row in enumerate(rows, start=1)]


def _plain_statistics(study: ThesisStudy) -> list[Row]:
    """Errors across the line of sight, with and without the removal of outliers that knows the truth."""
    scored = {log.name: thesis_table.scored_rows(log) for log in study.logs if log.truth_valid}
    every = joined(list(scored.values()))
    kept = joined([thesis_table.without_outliers(rows) for rows in scored.values()])
    rows = []
    for name in thesis_table.ESTIMATES:
        for what, chosen in (("all rows", every), ("outliers removed by truth, as published", kept)):
            found = thesis_table.summary(error_mm(thesis_table.estimate(chosen, name), chosen))
            for figure, value in (("RMSE", found.rmse_mm), ("median", found.median_mm), ("p95", found.p95_mm)):
                text = f"{thesis_table.ACTUAL_LABELS[name]}, {what}: {figure} (real)"
                rows.append(_plain("I20", text, value, "mm", None))
    return rows


def _replay_rows(study: ThesisStudy) -> list[Row]:
    replays = list(study.replays.values())
    replayed = np.concatenate([each.replayed for each in replays])
    miss_mm = np.concatenate([each.acoustic_miss_mm[each.replayed] for each in replays])
    still = np.concatenate([study.replays[log.name].still_miss_mm for log in study.logs if log.motion == _STATIONARY])
    met = np.isfinite(still[:, 0])
    sample = max((log for log in study.logs if log.motion == _STATIONARY), key=lambda log: log.test == 9)
    exchanged = replace(sample.rows, acoustic_mm=sample.rows.fused_mm, fused_mm=sample.rows.acoustic_mm)
    other = replay(replace(sample, rows=exchanged), study.replays[sample.name].period_s)
    return [
        _plain("I20", "rows replayed by the acoustic filter (real)", 100 * replayed.mean(), "%", (92.5, None)),
        _plain("I20", "their RMS distance from the print (real)", _rms(miss_mm), "mm", (None, 0.005)),
        _plain(
            "I20", "stationary rows that the combined filter replays without displacement (real)",
            100 * met.mean(), "%", None,
        ),
        _plain("I20", "their RMS distance from the print (real)", _rms(still[met]), "mm", (None, 0.005)),
        _plain(
            "I20", f"rows of {sample.name} replayed with the labels exchanged as published (real)",
            100 * other.replayed.mean(), "%", None,
        ),
    ]  # fmt: skip


def _check_rows(study: ThesisStudy) -> list[Row]:
    truth = check_truth(study.logs, _PRINTED_MM)
    noise = list(depth_noise_correlation(study.logs).values())
    return [
        _plain("I20", "truth by forward kinematics, RMS (real)", truth.rms_mm, "mm", (None, 0.005)),
        _plain("I20", "rows that it meets to their print (real)", 100 * truth.met / truth.rows, "%", None),
        _plain(
            "I20", "made-up depth noise, correlation, median of stationary logs (real)",
            float(np.median(noise)), "", (0.997, None),
        ),
    ]  # fmt: skip


def _scores(
    place: str,
    name: str,
    sessions: Sequence[Session],
    positions_mm: Mapping[str, Floats],
    limits: Mapping[str, tuple[float, float]],
) -> list[Row]:
    """RMSE, median, 95th percentile over second halves; `limits` by figure: must and aim."""
    lengths = [np.linalg.norm(each.second.error_mm(positions_mm[each.name]), axis=1) for each in sessions]
    draws = np.random.default_rng(0).integers(0, len(lengths), (_RESAMPLES, len(lengths)))
    resampled = [np.concatenate([lengths[k] for k in draw]) for draw in draws]
    rows = []
    for figure, statistic in _STATISTICS.items():
        must, aim = limits.get(figure, (None, None))
        low, high = np.quantile([statistic(each) for each in resampled], BAND)
        interval = Interval(statistic(np.concatenate(lengths)), float(low), float(high))
        label = "RMSE" if figure == "rmse" else figure
        rows.append(
            Row(
                place,
                f"{name}: {label} (real)",
                interval,
                "mm",
                None if must is None else Target(high=must),
                None if aim is None else Target(high=aim),
            )
        )
    return rows


def _plain(place: str, name: str, value: float, unit: str, must: tuple[float | None, float | None] | None) -> Row:
    interval = Interval(float(value), float(value), float(value))
    return Row(place, name, interval, unit, None if must is None else Target(*must))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _median(values: Floats) -> float:
    return float(np.median(values))


def _p95(values: Floats) -> float:
    return float(np.quantile(values, 0.95))


_STATISTICS: dict[str, Callable[[Floats], float]] = {"rmse": _rms, "median": _median, "p95": _p95}
