"""The coherence of all pairs over directions: what a report shows of a record, carrier cells and all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.acoustics.time_differences.band import BandSpectra
from bluerov_slam.acoustics.time_differences.joint import PairCoherence

if TYPE_CHECKING:
    from bluerov_slam.acoustics.array import ReceiverArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CoherenceSurface:
    """Mean coherence (elevations, azimuths) of all pairs of receivers for a far source in each direction; 1 at most.

    Angles (rad) are the array's: azimuth from x to y (right), elevation from the xy plane to z (down). NaN where there
    is no such direction in front.
    """

    azimuths_rad: Array
    elevations_rad: Array
    coherence: Array


def coherence_surface(
    record_samples: ArrayLike,
    sample_rate_hz: float,
    array: ReceiverArray,
    sound_speed_mps: float,
    azimuths_rad: ArrayLike,
    elevations_rad: ArrayLike,
    range_m: float = np.inf,
) -> CoherenceSurface:
    """Of one record (n, samples), for sources at one range."""
    samples = np.asarray(record_samples, dtype=np.float64)
    samples = samples - samples.mean(axis=1, keepdims=True)
    azimuths, elevations = (np.asarray(each, dtype=np.float64) for each in (azimuths_rad, elevations_rad))
    up, aside = np.meshgrid(elevations, azimuths, indexing="ij")
    directions = np.stack((np.cos(up) * np.cos(aside), np.cos(up) * np.sin(aside), np.sin(up)), axis=-1)
    places = array.positions_m
    if np.isfinite(range_m):
        away = np.linalg.norm(range_m * directions[..., None, :] - places, axis=-1)
        arrivals = away / sound_speed_mps
    else:
        arrivals = -(directions @ places.T) / sound_speed_mps
    arrivals = arrivals - array.sample_skew_s
    spectra = BandSpectra.of(samples, sample_rate_hz)
    limits = np.linalg.norm(places[:, None] - places[None], axis=2) / sound_speed_mps
    pairs = PairCoherence(spectra, spectra.values, limits)
    total = sum(
        pairs.at(int(first), int(second), arrivals[..., first] - arrivals[..., second]) for first, second in array.pairs
    )
    return CoherenceSurface(azimuths, elevations, np.asarray(total) / len(array.pairs))
