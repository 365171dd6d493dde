"""What is wrong with a record or with a receiver, in words, before anybody computes with it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from itertools import combinations
from statistics import median

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.pulse_train import REAL_CARRIER_HZ, STEPS_PER_BIT

FloatArray = NDArray[np.float64]

DEAD_STD_COUNTS = 0.25
"""A living input shows the converter's own noise, half a count or more; a torn wire reads one value."""

SILENT_STD_COUNTS = 10.0
SILENT_SHARE = 0.15
"""A receiver that hears this much less than the median of the others, and little in counts, hears nothing of use."""

CLIPPED_RUN = 3
"""Samples in a row at the end of the scale: one alone may be a peak that just fits."""

CARRIER_BAND_HZ = (38_300.0, 41_700.0)
"""Where the middle of the energy may lie: the real carriers and the resonances' 40 kHz, 4 % either way."""

LEAST_RATE_HZ = 100_000.0
"""Below, the carrier's band is not in the samples."""

LEAST_SWAP_S = 15e-6
"""One receiver a whole carrier period off misfits by half of it (12.5 us) in a square; an exchange by tens of them."""

_SPECTRUM_HZ = (12_000.0, 110_000.0)
_SWAP_GAIN, _ALIKE_S = 5.0, 1e-6
_WATCHED_PINGS, _FEWEST_PINGS = 12, 6


class Fault(Enum):
    """What is wrong."""

    DEAD = "dead"
    SILENT = "silent"
    CLIPPED = "clipped"
    SHORT = "short"
    SAMPLE_RATE = "sample rate"
    SWAPPED = "swapped"


@dataclass(frozen=True, slots=True)
class RecordFault:
    """One finding; `receivers` is empty where the whole record is meant. `usable`: a delay can still be had from it."""

    fault: Fault
    text: str
    receivers: tuple[int, ...] = ()
    usable: bool = False


def examine_record(samples: ArrayLike, sample_rate_hz: float, bits: int = 12) -> tuple[RecordFault, ...]:
    """Findings about a record (receivers, n) in counts about zero or about mid-scale."""
    record = np.asarray(samples, dtype=np.float64)
    bit_s = STEPS_PER_BIT * 0.5 / REAL_CARRIER_HZ[0]
    if not sample_rate_hz >= LEAST_RATE_HZ:
        text = f"{sample_rate_hz:.0f} samples a second cannot hold a carrier of 40 kHz, {LEAST_RATE_HZ:.0f} are needed"
        return (RecordFault(Fault.SAMPLE_RATE, text),)
    length_s = record.shape[1] / sample_rate_hz
    if length_s < bit_s:
        text = f"the record lasts {1e3 * length_s:.2f} ms, one bit of a pulse {1e3 * bit_s:.2f} ms"
        return (RecordFault(Fault.SHORT, text),)
    findings = _receiver_faults(record, bits)
    deaf = {each for finding in findings if not finding.usable for each in finding.receivers}
    hearing = [each for each in range(len(record)) if each not in deaf]
    if hearing and (finding := _rate_fault(record[hearing], sample_rate_hz)) is not None:
        findings.append(finding)
    return tuple(findings)


def find_swapped(delays_s: ArrayLike, array: ReceiverArray, sound_speed_mps: float) -> RecordFault | None:
    """Two receivers whose wires are exchanged, from the delays (pings, n-1) of some pings to receiver 0.

    A far source gives arrival times that are linear in the receivers' places. Where most pings' are not, by more than a
    wrong carrier period or a near source explains, and exchanging one pair makes them so, that pair is named. Not seen:
    an exchange that the array's symmetry turns into another direction (opposite corners of the cross, with a stalk or
    without), and a source so near the array's normal that an exchange hardly matters.
    """
    delays = np.atleast_2d(np.asarray(delays_s, dtype=np.float64))
    arrivals = np.concatenate((np.zeros((len(delays), 1)), -delays), axis=1)
    across = _across(array.positions_m)
    if not across.shape[1]:
        return None
    straight = _misfit(arrivals, across)
    if straight < LEAST_SWAP_S:
        return None
    found: list[tuple[float, tuple[int, int]]] = []
    for first, second in combinations(range(len(array)), 2):
        order = list(range(len(array)))
        order[first], order[second] = second, first
        found.append((_misfit(arrivals[:, order], across), (first, second)))
    best = min(found)[0]
    if best * _SWAP_GAIN > straight:
        return None
    alike = [pair for misfit, pair in found if misfit < 1.5 * best + _ALIKE_S]
    names = " or ".join(f"{a} and {b}" for a, b in sorted(alike))
    text = (
        f"receivers {names} seem exchanged: {1e6 * straight:.0f} us off a plane wave, {1e6 * best:.1f} us if put right"
    )
    return RecordFault(Fault.SWAPPED, text, tuple(sorted({each for pair in alike for each in pair})))


class SwapWatch:
    """Looks for exchanged receivers in the last pings that all receivers heard."""

    def __init__(self, array: ReceiverArray) -> None:
        self._array = array
        self._arrivals: deque[FloatArray] = deque(maxlen=_WATCHED_PINGS)

    def hear(self, arrivals_s: ArrayLike, sound_speed_mps: float) -> RecordFault | None:
        """Take one ping's arrival times (n,) relative to any of them, NaN for none; what is wrong by now."""
        arrivals = np.asarray(arrivals_s, dtype=np.float64)
        if arrivals.shape == (len(self._array),) and np.isfinite(arrivals).all():
            self._arrivals.append(arrivals)
        if len(self._arrivals) < _FEWEST_PINGS:
            return None
        heard = np.stack(list(self._arrivals))
        return find_swapped(heard[:, :1] - heard[:, 1:], self._array, sound_speed_mps)


@lru_cache(maxsize=4)
def hanning(length: int) -> FloatArray:
    """The window, made once."""
    window: FloatArray = np.hanning(length)
    return window


def _receiver_faults(record: FloatArray, bits: int) -> list[RecordFault]:
    findings: list[RecordFault] = []
    std_counts = record.std(axis=1)
    for receiver, std in enumerate(std_counts.tolist()):
        others = median([*std_counts[:receiver].tolist(), *std_counts[receiver + 1 :].tolist()] or [std])
        if std < DEAD_STD_COUNTS:
            findings.append(RecordFault(Fault.DEAD, f"stands still at {record[receiver, 0]:.0f} counts", (receiver,)))
        elif std < SILENT_STD_COUNTS and std < SILENT_SHARE * others:
            text = f"hears {std:.1f} counts where the others hear {others:.0f}"
            findings.append(RecordFault(Fault.SILENT, text, (receiver,)))
        elif (share := _clipped_share(record[receiver], bits)) > 0.0:
            text = f"{100.0 * share:.1f} % of its samples stand at the end of the scale"
            findings.append(RecordFault(Fault.CLIPPED, text, (receiver,), usable=True))
    return findings


def _clipped_share(wave: FloatArray, bits: int) -> float:
    """Share of the samples in runs at either end of the scale, which lies about zero or begins there."""
    half = 1 << (bits - 1)
    lowest, highest = float(wave.min()), float(wave.max())
    low, high = (0, 2 * half - 1) if lowest >= 0.0 and highest > half else (-half, half - 1)
    if lowest > low and highest < high:
        return 0.0
    at_end = (wave <= low) | (wave >= high)
    run = at_end[: len(wave) - CLIPPED_RUN + 1].copy()
    for shift in range(1, CLIPPED_RUN):
        run &= at_end[shift : len(wave) - CLIPPED_RUN + 1 + shift]
    return float(at_end.mean()) if run.any() else 0.0


def _rate_fault(record: FloatArray, sample_rate_hz: float) -> RecordFault | None:
    """Whether the energy lies where no transmitter sends: then the record was not sampled at the rate it says."""
    count = record.shape[1]
    power = np.abs(np.fft.rfft((record - record.mean(axis=1, keepdims=True)) * hanning(count), axis=1)) ** 2
    total = power.sum(axis=0)
    frequency_hz = np.arange(len(total)) * (sample_rate_hz / count)
    inside = (frequency_hz > _SPECTRUM_HZ[0]) & (frequency_hz < min(_SPECTRUM_HZ[1], 0.5 * sample_rate_hz))
    floor = float(np.median(total[inside]))
    strong = np.where(inside & (total > 0.1 * total[inside].max()), total, 0.0)
    if strong.max() < 20.0 * floor:
        return None  # noise: nothing can be said
    middle_hz = float((strong * frequency_hz).sum() / strong.sum())
    if CARRIER_BAND_HZ[0] <= middle_hz <= CARRIER_BAND_HZ[1]:
        return None
    likely_hz = sample_rate_hz * 39_850.0 / middle_hz
    text = (
        f"the carrier comes out at {1e-3 * middle_hz:.1f} kHz: "
        f"not sampled at {sample_rate_hz:.0f} Hz, more like {likely_hz:.0f}"
    )
    return RecordFault(Fault.SAMPLE_RATE, text)


def _across(positions_m: FloatArray) -> FloatArray:
    """Combinations of arrival times (n, q) that vanish for every plane wave."""
    columns = np.column_stack((np.ones(len(positions_m)), positions_m))
    left, singular, _ = np.linalg.svd(columns, full_matrices=True)
    result: FloatArray = left[:, int((singular > 1e-9 * singular[0]).sum()) :]
    return result


def _misfit(arrivals_s: FloatArray, across: FloatArray) -> float:
    """How far arrival times (pings, n) are from plane waves, by the middle one of the pings: some may be wrong."""
    return float(np.median(np.sqrt(np.mean(np.square(arrivals_s @ across), axis=1))))
