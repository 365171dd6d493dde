"""Tables of a collection: the thesis's own metric (figures 6.18, 6.19) and errors that leave nothing out.

The thesis's metric and its recipe are those of `thesis_table`, fed with the collected points and the truth as
published. Beside it stand lengths of the error across the line of sight, of every point that has a result, against
three truths: the published one, the rig's with the attitude of the point, and, where the rig is simulated, the real
place.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.thesis_log import MOTIONS, ThesisLog, ThesisRows
from bluerov_slam.evaluation.thesis_table import ErrorSummary, TableRow, published_table, summary
from bluerov_slam.rig.collection import Point, Session

Array = NDArray[np.float64]

ESTIMATES = ("acoustic", "fused", "raw", "ours")
LABELS = {
    "acoustic": "thesis: filter on sound (iSBL)",
    "fused": "thesis: filter with dead reckoning (iSBL-SF)",
    "raw": "thesis: raw fixes",
    "ours": "our chain, single fixes",
}
TRUTHS = ("published", "rig", "real")
TRUTH_LABELS = {
    "published": "as published: attitude before, and the step",
    "rig": "rig with the point's own attitude",
    "real": "where the array really was (simulation only)",
}


@dataclass(frozen=True, eq=False)
class Collected:
    """One session's points that may be scored, n rows; NaN where something is unknown.

    `lost`: reasons of the missing points and how often each; `withheld`: points without a position of our chain.
    """

    name: str
    place: int
    motion: str
    transmitter_mm: Array
    estimates_mm: dict[str, Array]
    truths_mm: dict[str, Array]
    covariance_mm2: Array
    rows: ThesisRows
    lost: dict[str, int]
    discarded: int

    @property
    def withheld(self) -> int:
        """Points without a position of our chain."""
        return int(np.isnan(self.estimates_mm["ours"]).any(axis=1).sum())


@dataclass(frozen=True, slots=True)
class TruthQuality:
    """How far a truth lies from the real place (3-D), mm; of the rig's also its stated 3-D deviation and the mean
    normalised squared error of three coordinates (3 if honest)."""

    count: int
    mean_mm: float
    rms_mm: float
    most_mm: float
    stated_mm: float
    nees: float


def collected(
    session: Session, place: int, points: Sequence[Point], ours_mm: Array | None = None, real_mm: Array | None = None
) -> Collected:
    """`place`: number of the transmitter's place from 1. Points after a DISCARD and missing ones are not scored."""
    nothing = np.full((len(points), 3), np.nan)
    ours = nothing if ours_mm is None or not len(ours_mm) else ours_mm
    real = nothing if real_mm is None or not len(real_mm) else real_mm
    kept = np.array([point.result is not None and not point.after_discard for point in points], dtype=bool)
    chosen = [point for point, keep in zip(points, kept, strict=True) if keep]
    lost: dict[str, int] = {}
    for point in points:
        if point.missing:
            lost[point.missing] = lost.get(point.missing, 0) + 1
    results = [point.result for point in chosen if point.result is not None]
    estimates = {
        name: np.array([getattr(result, f"{name}_mm") for result in results]).reshape(-1, 3)
        for name in ("acoustic", "fused", "raw")
    }
    unknown = np.full(3, np.nan)
    truths = {
        "published": np.array([point.published_truth_mm for point in chosen]).reshape(-1, 3),
        "rig": np.array([unknown if point.truth_mm is None else point.truth_mm for point in chosen]).reshape(-1, 3),
        "real": real[kept],
    }
    covariance = np.array(
        [
            np.full((3, 3), np.nan) if point.truth_covariance_mm2 is None else point.truth_covariance_mm2
            for point in chosen
        ]
    ).reshape(-1, 3, 3)
    count = len(chosen)
    rows = ThesisRows(
        line=np.arange(1, count + 1),
        whole=np.ones(count, dtype=np.bool_),
        after_discard=np.zeros(count, dtype=np.bool_),
        segment=np.ones(count, dtype=np.int64),
        axis=np.array([point.axis for point in chosen], dtype=np.str_),
        setpoint=np.array([point.label for point in chosen]),
        acoustic_mm=estimates["acoustic"],
        fused_mm=estimates["fused"],
        raw_mm=estimates["raw"],
        true_mm=truths["published"],
        attitude_deg=np.degrees([result.attitude_rad for result in results]).reshape(-1, 3),
    )
    return Collected(
        session.name,
        place,
        session.motion.value,
        np.array(session.transmitter_mm),
        {**estimates, "ours": ours[kept]},
        truths,
        covariance,
        rows,
        lost,
        sum(point.after_discard and point.result is not None for point in points),
    )


def groups(sessions: Sequence[Collected]) -> list[tuple[str, list[Collected]]]:
    """By place of the transmitter, by motion, and all."""
    places = sorted({each.place for each in sessions})
    found = [(f"test {place}", [each for each in sessions if each.place == place]) for place in places]
    found += [(motion, [each for each in sessions if each.motion == motion]) for motion in MOTIONS]
    return [*((name, members) for name, members in found if members), ("all", list(sessions))]


def errors_mm(sessions: Iterable[Collected], estimate: str, truth: str) -> Array:
    """Estimate less truth across the line of sight (n, 2), y and z, where both are known."""
    parts = [(each.estimates_mm[estimate] - each.truths_mm[truth])[:, 1:] for each in sessions]
    error = np.concatenate(parts) if parts else np.zeros((0, 2))
    known: Array = error[np.isfinite(error).all(axis=1)]
    return known


def honest(sessions: Sequence[Collected], estimate: str, truth: str) -> ErrorSummary | None:
    """Lengths of the errors, nothing removed; None where there are none."""
    error = errors_mm(sessions, estimate, truth)
    return summary(error) if len(error) else None


def published_metric(sessions: Sequence[Collected], *, ours: bool = False) -> dict[str, TableRow]:
    """Mean and deviation by the thesis's recipe, by group; with `ours` of our chain, under the name "raw"."""
    logs = []
    for each in sessions:
        rows = each.rows
        if ours:
            there: NDArray[np.bool_] = np.asarray(np.isfinite(each.estimates_mm["ours"]).all(axis=1))
            fixes = each.estimates_mm["ours"][there]
            rows = rows.where(there)
            rows = ThesisRows(
                rows.line, rows.whole, rows.after_discard, rows.segment, rows.axis, rows.setpoint,
                fixes, fixes, fixes, rows.true_mm, rows.attitude_deg,
            )  # fmt: skip
        if len(rows):
            # Not by its log's name: one real log of that name stood still, and is left out by it.
            name = f"{each.name} collected"
            x, y, z = each.transmitter_mm.tolist()
            logs.append(ThesisLog(name, each.place, each.motion, (x, y, z), rows))
    table = published_table(logs) if logs else []
    return {f"test {row.group}" if row.group.isdigit() else row.group: row for row in table}


def truth_quality(sessions: Sequence[Collected], truth: str) -> TruthQuality | None:
    """Of a truth against the real place; None where that is not known."""
    off = np.concatenate([each.truths_mm[truth] - each.truths_mm["real"] for each in sessions])
    covariance = np.concatenate([each.covariance_mm2 for each in sessions])
    known = np.isfinite(off).all(axis=1)
    if not known.any():
        return None
    off, covariance = off[known], covariance[known]
    length = np.linalg.norm(off, axis=1)
    stated = nees = float("nan")
    if truth == "rig":
        stated = float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2))))
        nees = float(np.mean(np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])))
    return TruthQuality(
        len(off), float(length.mean()), float(np.sqrt(np.mean(length**2))), float(length.max()), stated, nees
    )


def stated_truth_mm(sessions: Sequence[Collected]) -> float:
    """The rig's truth's stated 3-D deviation, RMS over the points; NaN where there is none."""
    covariance = np.concatenate([each.covariance_mm2 for each in sessions])
    trace = np.trace(covariance, axis1=1, axis2=2)
    trace = trace[np.isfinite(trace)]
    return float(np.sqrt(trace.mean())) if len(trace) else float("nan")
