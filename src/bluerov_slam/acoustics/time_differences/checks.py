"""Which receivers of a record can be used, and in words why the others cannot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.time_differences.band import BAND_HZ

Array = NDArray[np.float64]

SHORTEST_S = 0.45e-3
"""A record shorter than nine tenths of a bit has no envelope to tell carrier cells apart."""

DEAD_SHARE = 1e-3
"""A receiver whose samples vary less than this share of the strongest one's is not connected."""

CLIPPED_RUN = 3
"""Equal samples in a row at an extreme: a 40 kHz wave at 20 samples a period has none unless it is cut off."""

CLIPPED_RUNS = 6
CLIPPED_LEAST_COUNTS = 30.0  # below this amplitude equal neighbours are quantisation, not clipping

LEAST_EXCESS = 3.0
"""Power density in the band over that outside, below which there is no pulse (-13 dB per sample)."""

WRONG_RATE_EXCESS = 20.0
"""The strongest line's share of the mean density, times the band's, from which a pulse stands at another frequency."""

_SEARCHED_HZ = (8e3, 0.45)  # lowest, and share of the sample rate, where a displaced carrier is looked for


@dataclass(frozen=True, eq=False)
class Checked:
    """`usable` receivers in ascending order, reasons for the others; receiver -1 is the whole record."""

    usable: NDArray[np.intp]
    excluded: tuple[tuple[int, str], ...]


def check_receivers(samples: Array, sample_rate_hz: float) -> Checked:
    """Of a record (n, samples): dead, clipped and silent receivers; short records; pulses outside the band."""
    count, length = samples.shape
    if not np.isfinite(samples).all():
        return _none("the record holds samples that are not numbers")
    if length / sample_rate_hz < SHORTEST_S:
        return _none(f"the record of {1e3 * length / sample_rate_hz:.2f} ms is shorter than a bit of the pulse")
    spread = samples.std(axis=1)
    if not spread.max() > 0.0:
        return _none("the record holds no signal at all")
    excess, strongest_hz = _densities(samples, sample_rate_hz)
    reasons: dict[int, str] = {}
    for receiver in range(count):
        if spread[receiver] <= DEAD_SHARE * spread.max():
            reasons[receiver] = f"dead: its samples vary by {spread[receiver]:.2g}, the strongest by {spread.max():.3g}"
        elif _clipped(samples[receiver]):
            reasons[receiver] = f"clipped at {samples[receiver].min():.0f} and {samples[receiver].max():.0f}"
        elif excess[receiver] < LEAST_EXCESS:
            reasons[receiver] = "silent: its band holds no more than its noise"
    usable = np.array([each for each in range(count) if each not in reasons], dtype=np.intp)
    excluded = tuple(sorted(reasons.items()))
    if len(usable) < 2 and strongest_hz is not None:
        text = f"the pulse stands at {1e-3 * strongest_hz:.1f} kHz: is the sample rate {sample_rate_hz:.0f} Hz right?"
        excluded = (*excluded, (-1, text))
    elif len(usable) < 2:
        excluded = (*excluded, (-1, "fewer than two receivers heard a pulse"))
    return Checked(usable, excluded)


def _none(reason: str) -> Checked:
    return Checked(np.zeros(0, dtype=np.intp), ((-1, reason),))


def _densities(samples: Array, sample_rate_hz: float) -> tuple[Array, float | None]:
    """Power density in the band over the median outside (n,), and where a strong line outside the band stands."""
    length = samples.shape[1]
    centred = samples - samples.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(centred * np.hanning(length), axis=1)) ** 2
    frequencies = np.arange(power.shape[1]) * sample_rate_hz / length
    band = (frequencies >= BAND_HZ[0]) & (frequencies <= BAND_HZ[1])
    searched = (frequencies > _SEARCHED_HZ[0]) & (frequencies < _SEARCHED_HZ[1] * sample_rate_hz)
    outside = searched & ~band
    # The mean of an exponential variable is its median / ln 2; a floor for records without any noise.
    noise = np.median(power[:, outside], axis=1) / np.log(2.0) + 1e-12 * power.max(axis=1) + 1e-300
    excess = power[:, band].mean(axis=1) / noise
    together = power[:, outside].sum(axis=0)
    line = int(np.argmax(together))
    strong = together[line] > WRONG_RATE_EXCESS * float(np.median(together)) / np.log(2.0)
    return excess, float(frequencies[outside][line]) if strong else None


def _clipped(row: Array) -> bool:
    low, high = float(row.min()), float(row.max())
    if high - low < 2.0 * CLIPPED_LEAST_COUNTS and np.all(row == np.rint(row)):
        return False
    return any(_runs(row == extreme) >= CLIPPED_RUNS for extreme in (low, high))


def _runs(flags: NDArray[np.bool_]) -> int:
    """How many runs of at least CLIPPED_RUN true values there are."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return int(np.sum(edges[1::2] - edges[::2] >= CLIPPED_RUN))
