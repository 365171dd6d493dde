"""What an estimate of time differences says: delays, how sure they are, and who was left out and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DelayPrior:
    """Delays to expect: `toa_0 - toa_i` (n-1,) of all receivers but receiver 0, and their covariance (s^2).

    From a prediction of the navigation filter or from an earlier fix; it chooses among carrier cells and never moves a
    delay inside its cell.
    """

    delays_s: Array
    covariance_s2: Array


@dataclass(frozen=True, eq=False)
class TimeDifferences:
    """Delays `toa_reference - toa_i` of one record.

    `receivers` (k,) are those used, the reference first; `delays_s` (k-1,) and `covariance_s2` (k-1, k-1) belong to the
    others in that order. With fewer than two usable receivers there are no delays. `slip_probability` is that of a
    wrong carrier cell, NaN from methods that do not ask. `alternatives`: other cells that remain possible, each with
    its delays and probability. `excluded`: receiver (-1: the whole record) and reason in words.
    """

    reference: int
    receivers: NDArray[np.intp]
    delays_s: Array
    covariance_s2: Array
    carrier_hz: float
    snr_db: Array
    slip_probability: float
    alternatives: tuple[tuple[Array, float], ...] = ()
    excluded: tuple[tuple[int, str], ...] = ()
    closure_s: float = float("nan")
    """How far the delays miss those of any source (RMS): near zero with identical receivers; NaN if nothing is over."""
    onset_only: bool = False
    """Whether the part after the onset alone was used because an echo follows."""
    remark: str = ""
    """What else was found in the record and did not prevent an answer, as common pick-up."""

    @property
    def usable(self) -> bool:
        """Whether there are delays at all."""
        return len(self.delays_s) > 0
