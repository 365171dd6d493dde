"""Coherence over directions: highest where the source is, with its neighbours a carrier cell away."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.time_differences.band import BandSpectra, taper
from bluerov_slam.acoustics.time_differences.pairwise import correlation
from bluerov_slam.acoustics.time_differences.surface import coherence_surface
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_records

ARRAY = ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])
SOUND_MPS = 343.0
AZIMUTH, ELEVATION, RANGE_M = np.radians(12.0), np.radians(-5.0), 2.6
SOURCE = RANGE_M * np.array(
    [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
)
RECORD = simulate_records(AcousticSetup(ARRAY, snr_db=20.0), SOURCE[None], 1)


def test_the_surface_is_highest_at_the_source_and_shows_the_next_cells() -> None:
    azimuths, elevations = np.radians(np.arange(8.0, 16.0, 0.05)), np.radians(np.arange(-8.0, -2.0, 0.05))
    surface = coherence_surface(
        RECORD.samples[0], RECORD.sample_rate_hz, ARRAY, SOUND_MPS, azimuths, elevations, RANGE_M
    )
    assert surface.coherence.shape == (len(elevations), len(azimuths))
    row, column = np.unravel_index(int(np.argmax(surface.coherence)), surface.coherence.shape)
    assert azimuths[column] == pytest.approx(AZIMUTH, abs=np.radians(0.06))
    assert elevations[row] == pytest.approx(ELEVATION, abs=np.radians(0.06))
    assert 0.9 < surface.coherence.max() < 1.02
    # One period of the carrier on both pairs along y: 8.6 mm on 353.6 mm.
    step = SOUND_MPS / 39_850.0 / 0.35355 / np.cos(AZIMUTH)
    beside = int(np.argmin(np.abs(azimuths - (AZIMUTH + step))))
    between = int(np.argmin(np.abs(azimuths - (AZIMUTH + 0.5 * step))))
    assert surface.coherence[row, beside] > surface.coherence[row, between] + 0.5
    assert surface.coherence[row, beside] < surface.coherence[row, column]


def test_a_pair_correlates_best_at_its_delay() -> None:
    samples = RECORD.samples[0] - RECORD.samples[0].mean(axis=1, keepdims=True)
    spectra = BandSpectra.of(samples, RECORD.sample_rate_hz)
    seen = RECORD.delays_s[0, 0] - (ARRAY.sample_skew_s[0] - ARRAY.sample_skew_s[1])
    lags = seen + np.arange(-40, 41) * 1e-6
    row = correlation(spectra, 0, 1, lags)
    assert abs(int(np.argmax(row)) - 40) <= 1
    assert row.max() <= 1.0


def test_envelopes_keep_the_power_of_the_band() -> None:
    rng = np.random.default_rng(2)
    spectra = BandSpectra.of(rng.standard_normal((2, 2048)), 851_393.0)
    envelopes = spectra.envelopes(spectra.values)
    power = np.sum(np.abs(envelopes) ** 2, axis=1) / spectra.points
    assert power == pytest.approx(np.sum(np.abs(spectra.values) ** 2, axis=1))


def test_a_taper_is_flat_between_its_flanks() -> None:
    weights = taper(200, 0.1)
    assert weights[10:-10] == pytest.approx(np.ones(180))
    assert 0.0 < weights[0] < 0.1
    assert weights == pytest.approx(weights[::-1])
