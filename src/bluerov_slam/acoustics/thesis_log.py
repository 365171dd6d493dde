"""What the thesis's receiver and positioner told, one row a fix: the real measurements that the filters are judged by.

Data: J. Frabosilio, "Design and Implementation of an Inverted Short Baseline Acoustic Positioning System", master's
thesis, Cal Poly San Luis Obispo, 2024 (CC BY-SA 4.0): 27 serial logs of 5 to 8 August 2024, in air. Everything is in
the logs' own unit, the millimetre, and in the test frame: x towards the transmitter, y right, z down, origin at the
base of the positioner. x is the "depth": it is given to the receiver, not measured.

Three positions stand in every row. The published analysis took the first for the filter with dead reckoning (iSBL-SF)
and the second for the one without (iSBL); the receiver sends them the other way round, and replaying both filters
proves it (`thesis_replay`). Names here say what the columns are.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Floats = NDArray[np.float64]

MOTIONS = ("stationary", "rapid", "gradual")
TESTS_MM = (
    (1426.0, 0.0),
    (2645.0, 0.0),
    (3880.0, 0.0),
    (1426.0, -152.0),
    (1426.0, -305.0),
    (2051.0, 305.0),
    (2051.0, 610.0),
    (2203.0, 762.0),
    (2645.0, 457.0),
)
"""Where the transmitter stood (x, y) in tests 1 to 9."""

STILL_WHILE_STEPPED = "test_x1426_y0_z-694_s"
"""The platform stood still while its set points were stepped: the truth is wrong. The thesis left it out, too."""


@dataclass(frozen=True, slots=True)
class ThesisRows:
    """Rows of one log, in its order; n rows.

    `whole`: the line has its first characters. `after_discard`: the line before said DISCARD (the platform changed its
    axis or the depth message was lost), so the logged truth does not belong to this fix. `segment`: 1, and one more
    after each press of the positioner's button, which starts its sequence anew.
    """

    line: NDArray[np.int64]
    whole: NDArray[np.bool_]
    after_discard: NDArray[np.bool_]
    segment: NDArray[np.int64]
    axis: NDArray[np.str_]
    setpoint: Floats
    acoustic_mm: Floats
    fused_mm: Floats
    raw_mm: Floats
    true_mm: Floats
    attitude_deg: Floats

    def __len__(self) -> int:
        return len(self.line)

    def where(self, mask: NDArray[np.bool_] | slice) -> ThesisRows:
        """Only the chosen rows."""
        return ThesisRows(*(getattr(self, field.name)[mask] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class ThesisLog:
    """One serial log. `test` 1 to 9 counts the places of the transmitter."""

    name: str
    test: int
    motion: str
    transmitter_mm: tuple[float, float, float]
    rows: ThesisRows

    @property
    def truth_valid(self) -> bool:
        return self.name != STILL_WHILE_STEPPED


def error_mm(estimate_mm: Floats, rows: ThesisRows) -> Floats:
    """Estimate less truth across the line of sight, (n, 2): y and z; x is not measured by sound."""
    return np.asarray(estimate_mm[:, 1:] - rows.true_mm[:, 1:])


def joined(parts: Sequence[ThesisRows]) -> ThesisRows:
    """Rows of several logs one after another."""
    return ThesisRows(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(ThesisRows)))
