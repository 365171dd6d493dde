"""The part of a pulse that no echo can have reached yet.

An echo from the floor comes half a millisecond and more after the pulse itself and lasts as long: it lies inside the
record of 2.4 ms, and where its delay differs between receivers the sum of both can prefer a wrong carrier cell. If the
record begins before the pulse (a ring buffer before the trigger), the pulse's first half millisecond is free of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.time_differences.band import BandSpectra

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ONSET_SHARE = 0.1
"""Of the highest envelope, at which the pulse counts as begun."""

ONSET_OVER_NOISE = 3.0
UNSURE_S = 0.15e-3
"""By this, onsets may differ more than delays do."""

QUIET_S = 0.15e-3
"""A record that is quiet for so long at its beginning holds the onset."""

LENGTH_S, FALL_S = 0.40e-3, 0.15e-3
"""Taken of the pulse, and then faded out over: a bit, and the 0.5 ms after which the floor is heard at 3.8 m."""

LEAD_S, RISE_S = 0.06e-3, 0.03e-3


def onsets_s(spectra: BandSpectra, values: ComplexArray, longest_s: float) -> Array | None:
    """When the pulse begins in each record (n,), to some 30 us; None where a record does not hold its beginning.

    `longest_s`: the longest delay that two receivers can have.
    """
    length = round(spectra.points * spectra.samples / spectra.size)
    envelopes = np.abs(spectra.envelopes(values))[:, :length]
    quiet = max(4, round(QUIET_S / spectra.step_s))
    # The band's filter fades in at the very beginning.
    noise = np.sqrt(np.mean(envelopes[:, quiet // 2 : quiet] ** 2, axis=1))
    highest = envelopes.max(axis=1)
    threshold = np.maximum(ONSET_SHARE * highest, ONSET_OVER_NOISE * noise)
    if np.any(threshold > 0.6 * highest):
        return None  # as much at the beginning as anywhere
    above = envelopes > threshold[:, None]
    if np.any(above[:, :quiet]):
        return None
    first: Array = np.argmax(above, axis=1) * spectra.step_s
    return first if np.ptp(first) <= longest_s + UNSURE_S else None


def early_part(samples: Array, sample_rate_hz: float, onsets: Array) -> tuple[Array, float]:
    """What follows the onsets (n,) of records (n, samples), faded out, and how many samples that is (by the square).

    Nothing but the records' common beginning is cut off with what is faded out: delays stay what they are.
    """
    first = max(0, int((onsets.min() - LEAD_S) * sample_rate_hz))
    last = int(np.ceil((onsets.max() + LENGTH_S + FALL_S) * sample_rate_hz))
    part = samples[:, first:last]
    since = (first + np.arange(part.shape[1])) / sample_rate_hz - onsets[:, None]
    gate = np.clip((since + LEAD_S) / RISE_S, 0.0, 1.0)
    gate *= 0.5 + 0.5 * np.cos(np.pi * np.clip((since - LENGTH_S) / FALL_S, 0.0, 1.0))
    return part * gate, float(np.mean(np.sum(gate**2, axis=1)))
