"""What else the thesis's logs contain: truth from the positioner's kinematics, and the made-up noise of the depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.thesis_depth_noise import aligned, normal_sequence
from bluerov_slam.geometry.platform_stack import stack_tip_mm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bluerov_slam.acoustics.thesis_log import Floats, ThesisLog

_SEQUENCE = 20000
_NOISE_MM = (0.3, 0.8)
"""Logs whose depth noise has a spread between these have that of the generator; two tests have none."""
_SENT_DECIMALS = 1
"""The receiver was told x in metres with four decimals."""
_OUTLIER_MM = 3.0
"""A larger difference is a row whose truth is not its own."""


@dataclass(frozen=True, slots=True)
class TruthCheck:
    """Rows whose truth the kinematics can give, how many of them it gives (worst axis), and the RMS of those."""

    rows: int
    met: int
    rms_mm: float


def kinematic_truth_mm(log: ThesisLog) -> tuple[Floats, Floats]:
    """(row numbers, positions): every row whose set point and whose row before are known.

    The positioner turns its stack by the attitude that the receiver told with the row before, and the step since. The
    first step after a change of axis was told before it was made.
    """
    rows = log.rows
    here = np.arange(1, len(rows))
    known = rows.whole[here] & rows.whole[here - 1] & (rows.axis[here] == rows.axis[here - 1])
    here = here[known & ~rows.after_discard[here] & (np.diff(rows.line)[here - 1] == 1)]
    step = np.where(rows.after_discard[here - 1], 0.0, rows.setpoint[here] - rows.setpoint[here - 1])
    translation, attitude = np.zeros((len(here), 3)), rows.attitude_deg[here - 1].copy()
    for column, (moves, turns) in enumerate((("X", "A"), ("Y", "B"), ("Z", "C"))):
        translation[:, column] = np.where(rows.axis[here] == moves, rows.setpoint[here], 0.0)
        attitude[:, column] += np.where(rows.axis[here] == turns, step, 0.0)
    return here.astype(float), stack_tip_mm(translation, np.radians(attitude))


def check_truth(logs: Sequence[ThesisLog], tolerance_mm: float) -> TruthCheck:
    """Over all logs whose truth is right."""
    misses = []
    for log in logs:
        if log.truth_valid:
            here, position = kinematic_truth_mm(log)
            misses.append(position - log.rows.true_mm[here.astype(int)])
    miss = np.concatenate(misses)
    met = np.max(np.abs(miss), axis=1) <= tolerance_mm
    return TruthCheck(len(miss), int(met.sum()), float(np.sqrt(np.mean(miss[met] ** 2))))


def depth_noise_correlation(logs: Sequence[ThesisLog]) -> dict[str, float]:
    """By stationary log, where there is such noise: how well the generator's sequence explains x told less x used."""
    sequence = normal_sequence(_SEQUENCE)
    found = {}
    for log in logs:
        noise = np.round(log.rows.true_mm[:, 0], _SENT_DECIMALS) - log.rows.raw_mm[:, 0]
        noise = noise[(np.abs(noise) < _OUTLIER_MM) & ~log.rows.after_discard]
        if log.motion == "stationary" and _NOISE_MM[0] < noise.std() < _NOISE_MM[1]:
            found[log.name] = aligned(noise, sequence)[1]
    return found
