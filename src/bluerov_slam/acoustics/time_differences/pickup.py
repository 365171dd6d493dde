"""Interference that reaches all receivers at the same instant: a supply's ripple, the transmitter's own wires.

Correlated, it makes a peak at lag 0 that belongs to no source. Before the pulse it stands alone, so a record that
holds the onset shows it: what is equal in all receivers there. A steady line is fitted to that part and taken out of
the whole record; where that part is too short to carry its phase to the end, or it is no line, it is only named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.time_differences.band import NOISE_HZ, WIDE_BAND_HZ
from bluerov_slam.acoustics.time_differences.onset import LEAD_S

Array = NDArray[np.float64]

SHORTEST_S = 0.2e-3

COMMON_SHARE = 0.8
"""Share of the quiet part's power in the band that is equal in all receivers; 1/n for independent noise."""

OVER_NOISE = 10.0
"""In power density above what stands outside the band."""

LEFT_SHARE = 0.2
"""Of the common power, at most, that may be left by one line in the quiet part."""

LARGEST_PHASE_RAD = 0.15
"""By which the line's phase may be wrong at the record's end."""

_TRIED = 400  # frequencies over the band before the last interpolation


@dataclass(frozen=True, eq=False)
class Cleaned:
    """Records (n, samples) without the line, and what was found, in words; empty if nothing was."""

    samples: Array
    remark: str


def remove_common_line(samples: Array, sample_rate_hz: float, onsets_s: Array) -> Cleaned:
    """Of records whose mean has been removed and whose pulse begins at `onsets_s` (n,)."""
    count = len(samples)
    quiet = int((float(onsets_s.min()) - LEAD_S) * sample_rate_hz)
    if count < 3 or quiet < SHORTEST_S * sample_rate_hz:
        return Cleaned(samples, "")
    before = samples[:, :quiet] - samples[:, :quiet].mean(axis=1, keepdims=True)
    spectra = np.fft.rfft(before * np.hanning(quiet), axis=1)
    band, outside = (
        slice(int(low * quiet / sample_rate_hz), int(np.ceil(high * quiet / sample_rate_hz)) + 1)
        for low, high in (WIDE_BAND_HZ, NOISE_HZ)
    )
    total = float(np.sum(np.abs(spectra[:, band]) ** 2))
    common = count * float(np.sum(np.abs(spectra[:, band].mean(axis=0)) ** 2))
    noise = float(np.mean(np.abs(spectra[:, outside]) ** 2))
    bins = count * (band.stop - band.start)
    if common < COMMON_SHARE * total or total < OVER_NOISE * noise * bins:
        return Cleaned(samples, "")
    return _subtract(samples, before, sample_rate_hz)


def _subtract(samples: Array, before: Array, sample_rate_hz: float) -> Cleaned:
    times = np.arange(samples.shape[1]) / sample_rate_hz
    quiet = before.shape[1]
    frequency, power = _strongest_line(before, sample_rate_hz)
    columns = np.column_stack((np.cos(2.0 * np.pi * frequency * times), np.sin(2.0 * np.pi * frequency * times)))
    fit = np.linalg.lstsq(columns[:quiet], before.T, rcond=None)[0]
    left = float(np.mean((before - (columns[:quiet] @ fit).T) ** 2))
    amplitude = float(np.sqrt(2.0 * power))
    text = f"common pick-up of {amplitude:.3g} at {1e-3 * frequency:.2f} kHz"
    if left > LEFT_SHARE * float(np.mean(before**2)):
        return Cleaned(samples, f"{text}, no steady line: left in")
    # Cramer-Rao of a line's frequency, and what it becomes until the record's end.
    ratio = power / max(left, 1e-12 * power) * before.size
    std_hz = float(np.sqrt(6.0 / ratio)) / (2.0 * np.pi * quiet / sample_rate_hz)
    if 2.0 * np.pi * std_hz * (times[-1] - 0.5 * times[quiet - 1]) > LARGEST_PHASE_RAD:
        return Cleaned(samples, f"{text}, too weak to be followed: left in")
    return Cleaned(samples - (columns @ fit).T, f"{text} subtracted")


def _strongest_line(before: Array, sample_rate_hz: float) -> tuple[float, float]:
    """Frequency of the line that explains most of all receivers, and its mean power."""
    times = np.arange(before.shape[1]) / sample_rate_hz
    frequencies = np.linspace(*WIDE_BAND_HZ, _TRIED)
    window = np.hanning(before.shape[1])
    power = np.sum(np.abs(np.exp(-2j * np.pi * frequencies[:, None] * times) @ (before * window).T) ** 2, axis=1)
    at = int(np.clip(np.argmax(power), 1, _TRIED - 2))
    below, here, above = np.log(power[at - 1 : at + 2])
    bend = below - 2.0 * here + above
    frequency = frequencies[at] + (0.5 * (below - above) / bend if bend < 0.0 else 0.0) * (
        frequencies[1] - frequencies[0]
    )
    strength = power[at] / len(before) / float(window.sum()) ** 2 * 2.0
    return float(frequency), float(strength)
