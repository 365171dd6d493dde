"""Which receivers of a record can be used, and in words why the others cannot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.receiver_faults import examine_record, hanning
from bluerov_slam.acoustics.time_differences.band import BAND_HZ

Array = NDArray[np.float64]

ENOUGH = 3
"""A clipped receiver is left out where so many others remain: its wave's zeros are right, its envelope is not."""

LEAST_EXCESS = 3.0
"""Power density in the band over that outside, below which there is no pulse (-13 dB per sample)."""

_OUTSIDE_HZ = (60e3, 300e3)  # where the noise's density is taken from


@dataclass(frozen=True, eq=False)
class Checked:
    """`usable` receivers in ascending order, and remarks (receiver, reason); receiver -1 is the whole record."""

    usable: NDArray[np.intp]
    excluded: tuple[tuple[int, str], ...]


def check_receivers(samples: Array, sample_rate_hz: float) -> Checked:
    """Of a record (n, samples): what `examine_record` finds, and receivers whose band holds no pulse."""
    count = len(samples)
    if not np.isfinite(samples).all():
        return Checked(np.zeros(0, dtype=np.intp), ((-1, "the record holds samples that are not numbers"),))
    remarks: list[tuple[int, str]] = []
    lost: set[int] = set()
    weak: set[int] = set()
    for finding in examine_record(samples, sample_rate_hz):
        (weak if finding.usable else lost).update(finding.receivers or range(count))
        remarks += [(each, f"{finding.fault.value}: {finding.text}") for each in finding.receivers or (-1,)]
    heard = sorted(set(range(count)) - lost)
    if heard:
        for receiver, excess in zip(heard, _excess(samples[heard], sample_rate_hz), strict=True):
            if excess < LEAST_EXCESS:
                lost.add(receiver)
                remarks.append((receiver, "silent: its band holds no more than noise"))
    if count - len(lost | weak) >= ENOUGH:
        lost |= weak
    usable = np.array(sorted(set(range(count)) - lost), dtype=np.intp)
    if len(usable) < 2 and all(receiver >= 0 for receiver, _ in remarks):
        remarks.append((-1, "fewer than two receivers heard a pulse"))
    return Checked(usable, tuple(sorted(remarks)))


def _excess(samples: Array, sample_rate_hz: float) -> Array:
    """Power density in the band over the median of that above it (n,)."""
    length = samples.shape[1]
    spectra = np.fft.rfft((samples - samples.mean(axis=1, keepdims=True)) * hanning(length), axis=1)
    power = np.abs(spectra) ** 2
    places = [round(edge * length / sample_rate_hz) for edge in (*BAND_HZ, *_OUTSIDE_HZ)]
    band = power[:, places[0] : places[1] + 1]
    # The mean of an exponential variable is its median / ln 2; a floor for records without any noise.
    noise = np.median(power[:, places[2] : places[3]], axis=1) / np.log(2.0)
    excess: Array = band.mean(axis=1) / np.maximum(noise, 1e-12 * power.max(axis=1) + 1e-300)
    return excess
