"""The halves of the thesis's logs, kept apart by type: what may be learnt from, what a filter sees, what only scores.

The second half of a log begins at the middle one of the rows whose truth is theirs (not after a DISCARD): the line
kinds say that, neither truth nor measurement does.

- `FirstHalf` is all that training gets: the rows before, with their truth. Even the transmitter's period, which sets
  the carrier and so the lattice, and the recovered intervals and displacements come from these rows alone.
- `Measured` is all that a filter gets: what the receiver had, in both halves, and no truth.
- `SecondTruth` gives nothing but errors of estimates.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.slip_lattice import lattice_mm, lattice_vectors_mm
from bluerov_slam.acoustics.thesis_replay import USUAL_PERIODS, Replay, find_period_s, replay

if TYPE_CHECKING:
    from bluerov_slam.acoustics.slip_lattice import Floats
    from bluerov_slam.acoustics.thesis_log import ThesisLog, ThesisRows

Rows = NDArray[np.int64]

ARRAY_CENTRE_MM = (110.0, 0.0, -648.38)
"""Of the platform at home; ranges to the transmitter are from here."""
SIDE_MM = 353.6
SOUND_SPEED_MPS = 343.0
DRIVE_STEP_S = 12.375e-6
"""Half a period of the carrier in the transmitter's clock, whose second is the logged period of the pulses."""
REACH = 8.0
"""Slips of up to so many lattice spacings; what lies further off is an outlier."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What the receiver had, row by row, across the line of sight (n, 2: y, z). `second_from`: first row of the second
    half (the number of rows where there is none)."""

    name: str
    motion: str
    raw_mm: Floats
    fused_mm: Floats
    attitude_deg: Floats
    interval_s: Floats
    displacement_mm: Floats
    second_from: int
    range_mm: float
    lattice_mm: Floats


@dataclass(frozen=True, slots=True)
class FirstHalf:
    """Rows of a first half alone, with their truth. `scored`: rows whose logged truth is theirs."""

    measured: Measured
    true_mm: Floats
    scored: Rows

    @property
    def error_mm(self) -> Floats:
        """Of the raw fixes."""
        return np.asarray(self.measured.raw_mm - self.true_mm)

    def quarter(self, which: int) -> Rows:
        """Rows of the log's first (0) or second (1) quarter."""
        middle = len(self.scored) // 2
        return self.scored[:middle] if which == 0 else self.scored[middle:]


@dataclass(frozen=True, slots=True)
class SecondTruth:
    """Where the array was at rows of the second half. Only errors come out."""

    rows: Rows
    true_mm: Floats

    def error_mm(self, positions_mm: Floats) -> Floats:
        """Estimates of a whole log (n, 2) less truth, at the second half's rows."""
        return np.asarray(positions_mm[self.rows] - self.true_mm)


@dataclass(frozen=True, slots=True)
class Session:
    """One log, parted."""

    first: FirstHalf
    measured: Measured
    second: SecondTruth

    @property
    def name(self) -> str:
        return self.measured.name

    @property
    def motion(self) -> str:
        return self.measured.motion


def session_of(log: ThesisLog) -> Session:
    """Parts a log and replays its halves; a second."""
    rows = log.rows
    scored = np.flatnonzero(~rows.after_discard)
    middle = len(scored) // 2
    second_from = int(scored[middle])
    early = _part(log, rows.where(slice(second_from)))
    period_s = find_period_s(early)
    first = _measured(early, replay(early, period_s), second_from)
    # The same period for the whole log: a receiver does not know the transmitter's period of the future.
    measured = _measured(log, replay(log, period_s), second_from)
    return Session(
        FirstHalf(first, early.rows.true_mm[:, 1:], scored[:middle]),
        measured,
        SecondTruth(scored[middle:], rows.true_mm[scored[middle:], 1:]),
    )


def second_half_errors_mm(sessions: Iterable[Session], positions_mm: Mapping[str, Floats]) -> Floats:
    """Estimate less truth of all second halves, (n, 2); `positions_mm` by log."""
    return np.concatenate([session.second.error_mm(positions_mm[session.name]) for session in sessions])


def _part(log: ThesisLog, rows: ThesisRows) -> ThesisLog:
    return type(log)(log.name, log.test, log.motion, log.transmitter_mm, rows)


def _measured(log: ThesisLog, found: Replay, second_from: int) -> Measured:
    """Across the line of sight: y and z of everything."""
    rows = log.rows
    dx, dy, _ = np.subtract(log.transmitter_mm, ARRAY_CENTRE_MM)
    range_mm = float(np.linalg.norm(np.subtract(log.transmitter_mm, ARRAY_CENTRE_MM)))
    wavelength_mm = SOUND_SPEED_MPS * 1e3 * 2.0 * DRIVE_STEP_S * found.period_s
    vectors = lattice_vectors_mm(range_mm, math.atan2(dy, dx), wavelength_mm, SIDE_MM)
    usual_s = USUAL_PERIODS[log.motion] * found.period_s
    return Measured(
        name=log.name,
        motion=log.motion,
        raw_mm=rows.raw_mm[:, 1:],
        fused_mm=rows.fused_mm[:, 1:],
        attitude_deg=rows.attitude_deg,
        interval_s=np.where(np.isnan(found.interval_s), usual_s, found.interval_s),
        displacement_mm=np.nan_to_num(found.displacement_mm[:, 1:]),
        second_from=second_from,
        range_mm=range_mm,
        lattice_mm=lattice_mm(vectors, REACH),
    )
