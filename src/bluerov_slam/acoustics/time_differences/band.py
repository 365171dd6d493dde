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

WIDE_BAND_HZ = (30e3, 50e3)
"""Holds all of the pulse but 1 %: where the cell is known, the noise at its flanks does no harm any more."""

NOISE_HZ = (100e3, 300e3)
"""Where the noise's density is measured: what the edges of a cut-off pulse scatter has died away there."""

TAPER_SHARE = 0.01
"""Of a window, for both flanks: keeps the edges' scatter out of the noise's band."""

STEPS_PER_BAND = 8
"""Samples of an envelope for each 1 / bandwidth: fine enough to interpolate linearly (error below 0.1 %)."""


def next_power_of_two(count: int) -> int:
    """The smallest power of two that is not below `count`."""
    return 1 << max(0, count - 1).bit_length()


def phasor(phase_rad: Array) -> ComplexArray:
    """exp(j phase): cosine and sine alone cost a quarter of the complex exponential."""
    turned = np.empty(phase_rad.shape, dtype=np.complex128)
    np.cos(phase_rad, out=turned.real)
    np.sin(phase_rad, out=turned.imag)
    return turned


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
    """Windows of all records that cover the same part of the pulse.

    Spectra (n, b) at their frequencies (b,), phases by sample 0 of the record; how many samples a window counts for (a
    taper by its square), of how long a transform; and signal to noise power per sample (n,), dB.
    """

    spectra: ComplexArray
    frequencies_hz: Array
    effective: float
    size: int
    snr_db: Array


def common_windows(
    samples: Array,
    sample_rate_hz: float,
    arrivals_s: Array,
    taper_share: float = TAPER_SHARE,
    band_hz: tuple[float, float] = WIDE_BAND_HZ,
) -> Windows:
    """What all records (n, samples) have in common, given roughly when the pulse arrives at each (n,).

    The pulse being cut off costs no accuracy so: what lies outside one window lies outside all.
    """
    whole = np.rint(arrivals_s * sample_rate_hz).astype(np.intp)
    # Wild delays, as a baseline's slips are, must leave a window.
    starts = np.minimum(whole - whole.min(), samples.shape[1] // 2)
    count = samples.shape[1] - int(starts.max())
    flanks = taper(count, taper_share)
    windows = np.stack([row[start : start + count] for row, start in zip(samples, starts, strict=True)]) * flanks
    size = next_power_of_two(2 * count)
    spectra = np.fft.rfft(windows, size, axis=1)
    low, high = (min(round(edge * size / sample_rate_hz), size // 2) for edge in band_hz)
    frequencies = np.arange(low, high + 1) * sample_rate_hz / size
    turned = spectra[:, low : high + 1] * phasor((-2.0 * np.pi / sample_rate_hz) * frequencies * starts[:, None])
    effective = float(np.sum(flanks**2))
    snr_db = _snr_db(spectra, sample_rate_hz, effective, np.sum(windows**2, axis=1))
    return Windows(turned, frequencies, effective, size, snr_db)


def _snr_db(spectra: ComplexArray, sample_rate_hz: float, effective: float, energy: Array) -> Array:
    """Noise has everywhere the density that it has far above the pulse."""
    size = 2 * (spectra.shape[1] - 1)
    low, high = (min(round(edge * size / sample_rate_hz), size // 2) for edge in NOISE_HZ)
    noise = np.mean(np.abs(spectra[:, low:high]) ** 2, axis=1) if high > low else np.zeros(len(spectra))
    noise = np.maximum(noise / effective, 1e-9 * energy / effective + 1e-300)
    snr_db: Array = 10.0 * np.log10(np.maximum(energy / effective / noise - 1.0, 1e-9))
    return snr_db


def taper(count: int, share: float = TAPER_SHARE) -> Array:
    """Window (count,) with cosine flanks over `share` of its length in all: keeps offsets out of the band."""
    flank = min(max(1, round(0.5 * share * count)), count // 2)
    weights = np.ones(count)
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(flank) + 0.5) / flank)
    weights[:flank] = rise
    weights[-flank:] = rise[::-1]
    return weights
