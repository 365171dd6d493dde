"""Records as complex envelopes: the band of the pulse, cut out of the spectrum and shifted to zero frequency.

A record of 2048 samples holds some forty independent numbers between 36 and 44 kHz. All that follows works on these:
correlating them costs microseconds, and the noise of the remaining 418 kHz stays outside (17 dB).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

BAND_HZ = (36e3, 44e3)
"""Where a pulse of half-millisecond bits at a carrier of 39.7 to 40.4 kHz has its power."""

WIDE_BAND_HZ = (25e3, 55e3)
"""Outside this there is nothing of the pulse but one part in a thousand."""

STEPS_PER_BAND = 16
"""Samples of an envelope for each 1 / bandwidth: fine enough to interpolate linearly (error below 0.1 %)."""


def next_power_of_two(count: int) -> int:
    """The smallest power of two that is not below `count`."""
    return 1 << max(0, count - 1).bit_length()


@dataclass(frozen=True, eq=False)
class BandSpectra:
    """Spectra (n, b) of zero-padded records at the frequencies (b,) of the band."""

    frequencies_hz: Array
    values: ComplexArray
    sample_rate_hz: float
    size: int  # of the padded transform
    samples: int  # of the record

    @classmethod
    def of(cls, samples: Array, sample_rate_hz: float, band_hz: tuple[float, float] = BAND_HZ) -> BandSpectra:
        """Of records (n, samples) whose mean has been removed."""
        count = samples.shape[1]
        size = next_power_of_two(2 * count)
        low = int(np.ceil(band_hz[0] * size / sample_rate_hz))
        high = min(int(np.floor(band_hz[1] * size / sample_rate_hz)), size // 2)
        values = np.fft.rfft(samples, size, axis=1)[:, low : high + 1]
        return cls(np.arange(low, high + 1) * sample_rate_hz / size, values, sample_rate_hz, size, count)

    @property
    def first_bin(self) -> int:
        """Number of the band's lowest frequency in the padded transform."""
        return round(float(self.frequencies_hz[0]) * self.size / self.sample_rate_hz)

    @property
    def centre_hz(self) -> float:
        """The frequency that becomes zero."""
        return float(self.frequencies_hz[len(self.frequencies_hz) // 2])

    @property
    def points(self) -> int:
        """Samples of an envelope over the padded length."""
        return next_power_of_two(STEPS_PER_BAND * len(self.frequencies_hz))

    @property
    def step_s(self) -> float:
        """Between samples of an envelope."""
        return self.size / self.points / self.sample_rate_hz

    def envelopes(self, spectra: ComplexArray) -> ComplexArray:
        """Sums over the band (..., points): sum_f X(f) exp(j 2 pi (f - centre) t) at multiples t of `step_s`."""
        middle = len(self.frequencies_hz) // 2
        padded = np.zeros((*spectra.shape[:-1], self.points), dtype=np.complex128)
        padded[..., : spectra.shape[-1] - middle] = spectra[..., middle:]
        if middle:
            padded[..., -middle:] = spectra[..., :middle]
        return np.fft.ifft(padded, axis=-1) * self.points

    def carrier_hz(self, noise_power: float | Array = 0.0) -> float:
        """Mean frequency of the power above the noise: the slope of the correlation's phase, hence its period."""
        power = np.maximum(np.mean(np.abs(self.values) ** 2, axis=0) - noise_power, 0.0)
        total = float(power.sum())
        return float(power @ self.frequencies_hz / total) if total > 0.0 else float("nan")


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of all records that cover the same part of the pulse: their spectra (n, b), phases by sample 0 of the
    record; how many samples they count for (a taper by its square); and signal to noise power per sample (n,), dB."""

    spectra: ComplexArray
    effective: float
    snr_db: Array


def common_windows(spectra: BandSpectra, samples: Array, arrivals_s: Array) -> Windows:
    """What all records (n, samples) have in common, given roughly when the pulse arrives at each (n,).

    The pulse being cut off costs no accuracy so: what lies outside one window lies outside all.
    """
    whole = np.rint(arrivals_s * spectra.sample_rate_hz).astype(np.intp)
    # Wild delays, as a baseline's slips are, must leave a window.
    starts = np.minimum(whole - whole.min(), samples.shape[1] // 2)
    count = samples.shape[1] - int(starts.max())
    flanks = taper(count)
    windows = np.stack([row[start : start + count] for row, start in zip(samples, starts, strict=True)]) * flanks
    whole_spectra = np.fft.rfft(windows, spectra.size, axis=1)
    values = whole_spectra[:, spectra.first_bin : spectra.first_bin + len(spectra.frequencies_hz)]
    late = starts[:, None] / spectra.sample_rate_hz
    effective = float(np.sum(flanks**2))
    turned = values * np.exp(-2j * np.pi * spectra.frequencies_hz * late)
    return Windows(turned, effective, _snr_db(spectra, whole_spectra, np.sum(windows**2, axis=1)))


def _snr_db(spectra: BandSpectra, whole_spectra: ComplexArray, energy: Array) -> Array:
    """Noise is what stands outside the pulse's widest band, as if it were white."""
    low, high = (round(edge * spectra.size / spectra.sample_rate_hz) for edge in WIDE_BAND_HZ)
    inside = 2.0 / spectra.size * np.sum(np.abs(whole_spectra[:, low:high]) ** 2, axis=1)
    white = np.maximum(energy - inside, 1e-9 * energy) / (1.0 - 2.0 * (high - low) / spectra.size)
    snr_db: Array = 10.0 * np.log10(np.maximum(energy - white, 1e-9 * energy) / white)
    return snr_db


def taper(count: int, share: float = 0.03) -> Array:
    """Window (count,) with cosine flanks over `share` of its length in all: keeps offsets out of the band."""
    flank = max(1, round(0.5 * share * count))
    weights = np.ones(count)
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(flank) + 0.5) / flank)
    weights[:flank] = rise
    weights[-flank:] = rise[::-1]
    return weights
