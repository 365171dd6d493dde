"""Time differences to a reference receiver, one pair at a time: the thesis's method and what improves on it.

`thesis` is the published method with its defects (all lags, whole samples, no band, no rank skew); the others are
steps from there: `parabola` through the three highest samples, `band_limited` (36 to 44 kHz, physical lags only, exact
interpolation), `matched` (each receiver against a template of the pulse), `phat` (phases alone) and `envelope`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.time_differences.band import BAND_HZ, BandSpectra, next_power_of_two

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

THESIS_SIZE = 4096
"""Length of the thesis's zero-padded transform; longer records get the next power of two that holds all lags."""

LAG_MARGIN, LAG_MARGIN_S = 1.02, 5e-6
"""Physical limits are widened by this: sound speed, positions and receivers are not exact."""

_FINE = 6  # lags tried per period of the carrier before the exact peak is sought
_NEWTON_STEPS = 3


def thesis(samples: Array, sample_rate_hz: float) -> Array:
    """Delays (n-1,) to receiver 0 as published: the highest positive correlation over all lags, in whole samples."""
    return _whole_lags(_full_correlations(samples)) / sample_rate_hz


def parabola(samples: Array, sample_rate_hz: float) -> Array:
    """The same with the vertex of the parabola through the highest sample and its neighbours."""
    correlations = _full_correlations(samples)
    lags = _whole_lags(correlations)
    size = correlations.shape[1]
    for row, lag in enumerate(lags.astype(int)):
        before, here, after = (correlations[row, (lag + step) % size] for step in (-1, 0, 1))
        bend = before - 2.0 * here + after
        lags[row] += 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return lags / sample_rate_hz


def phat(samples: Array, sample_rate_hz: float) -> Array:
    """Phase transform (all magnitudes in the band made equal): the wrong tool for so narrow a pulse, kept to show it.

    Source: Knapp and Carter (1976), doi:10.1109/TASSP.1976.1162830.
    """
    return _whole_lags(_full_correlations(samples, whiten_at_hz=sample_rate_hz)) / sample_rate_hz


def band_limited(spectra: BandSpectra, limits_s: Array) -> Array:
    """Highest peak of the band-limited correlation within the physical limits (n-1,), interpolated exactly."""
    cross = spectra.values[:1] * np.conj(spectra.values[1:])
    delays = [_highest(row, spectra.frequencies_hz, limit) for row, limit in zip(cross, limits_s, strict=True)]
    return np.array(delays)


def matched(spectra: BandSpectra, template: Array, limits_s: Array) -> Array:
    """Each receiver against a template (samples,) of the received pulse at the record's rate; then the differences.

    Receiver 0 may have heard the pulse at any time; the others follow within the physical limits (n-1,).
    """
    low = spectra.first_bin
    known = np.fft.rfft(template[: spectra.size // 2] - template.mean(), spectra.size)
    pattern = np.conj(known[low : low + len(spectra.frequencies_hz)])
    longest = spectra.size / spectra.sample_rate_hz / 2.0
    # X P* = |P|^2 exp(-j w toa): the real part of its sum against exp(j w t) is highest at t = toa.
    first = _highest(spectra.values[0] * pattern, spectra.frequencies_hz, longest)
    turn = np.exp(2j * np.pi * spectra.frequencies_hz * first) * pattern
    later = [
        _highest(row * turn, spectra.frequencies_hz, limit)
        for row, limit in zip(spectra.values[1:], limits_s, strict=True)
    ]
    return -np.array(later)


def envelope(spectra: BandSpectra, limits_s: Array) -> Array:
    """Highest magnitude of the complex correlation: immune to slips, ten times less sharp than the carrier's phase."""
    cross = spectra.values[:1] * np.conj(spectra.values[1:])
    return np.array(
        [
            _highest(row, spectra.frequencies_hz, limit, magnitude=True)
            for row, limit in zip(cross, limits_s, strict=True)
        ]
    )


def correlation(spectra: BandSpectra, first: int, second: int, lags_s: Array) -> Array:
    """Band-limited correlation of two receivers at lags `toa_first - toa_second`, 1 at most: for plots."""
    cross = spectra.values[first] * np.conj(spectra.values[second])
    power = [float(np.sum(np.abs(spectra.values[each]) ** 2)) for each in (first, second)]
    turned: Array = np.real(_at(cross, spectra.frequencies_hz, lags_s)) / max(np.sqrt(power[0] * power[1]), 1e-300)
    return turned


def _full_correlations(samples: Array, whiten_at_hz: float | None = None) -> Array:
    """Circular correlations (n-1, size) of receiver 0 with the others, mean removed and divided by the deviation.

    `whiten_at_hz`: the sample rate, if all magnitudes inside the band are to be equal and those outside zero.
    """
    size = max(THESIS_SIZE, next_power_of_two(2 * samples.shape[1]))
    centred = samples - samples.mean(axis=1, keepdims=True)
    spread = centred.std(axis=1, keepdims=True)
    spectra = np.fft.rfft(centred / np.where(spread > 0.0, spread, 1.0), size, axis=1)
    cross = spectra[:1] * np.conj(spectra[1:])
    if whiten_at_hz is not None:
        frequencies = np.arange(cross.shape[1]) * whiten_at_hz / size
        inside = (frequencies >= BAND_HZ[0]) & (frequencies <= BAND_HZ[1])
        cross = np.where(inside, cross / np.maximum(np.abs(cross), 1e-300), 0.0)
    return np.fft.irfft(cross, size, axis=1)


def _whole_lags(correlations: Array) -> Array:
    """Signed lag of the highest value of each row."""
    size = correlations.shape[1]
    highest = np.argmax(correlations, axis=1)
    lags: Array = np.where(highest >= size // 2, highest - size, highest).astype(np.float64)
    return lags


def _at(cross: ComplexArray, frequencies_hz: Array, lags_s: Array) -> ComplexArray:
    turned: ComplexArray = np.exp(2j * np.pi * lags_s[:, None] * frequencies_hz) @ cross
    return turned


@lru_cache(maxsize=16)
def _steering(low_hz: float, step_hz: float, count: int, limit_s: float) -> tuple[Array, ComplexArray]:
    """Lags within +-limit, `_FINE` per period, and the matrix that takes a cross-spectrum to them."""
    frequencies = low_hz + step_hz * np.arange(count)
    step = 1.0 / (_FINE * frequencies[count // 2])
    lags = np.arange(-np.ceil(limit_s / step), np.ceil(limit_s / step) + 1.0) * step
    return lags, np.exp(2j * np.pi * lags[:, None] * frequencies)


def _highest(cross: ComplexArray, frequencies_hz: Array, limit_s: float, magnitude: bool = False) -> float:
    """Lag of the highest real part (or magnitude) within +-limit, by a grid and Newton's method on the exact sum."""
    step_hz = float(frequencies_hz[1] - frequencies_hz[0])
    lags, steering = _steering(float(frequencies_hz[0]), step_hz, len(frequencies_hz), float(limit_s))
    tried = steering @ cross
    best = float(lags[int(np.argmax(np.abs(tried) if magnitude else tried.real))])
    omega = 2.0 * np.pi * frequencies_hz
    found = best
    for _ in range(_NEWTON_STEPS):
        turned = cross * np.exp(1j * omega * found)
        value, slope, bend = turned.sum(), 1j * (omega @ turned), -(omega**2 @ turned)
        if magnitude:  # of |value|^2
            slope, bend = 2.0 * (np.conj(value) * slope), 2.0 * (np.conj(value) * bend + abs(slope) ** 2)
        if bend.real >= 0.0:
            break
        found -= float(slope.real / bend.real)
    return (
        found if abs(found - best) <= 1.0 / (_FINE * float(frequencies_hz[0])) * (20.0 if magnitude else 2.0) else best
    )
