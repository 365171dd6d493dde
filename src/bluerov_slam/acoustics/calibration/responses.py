"""What distinguishes the receivers of an array: their resonances, learnt from records of pulses without any truth.

A resonator of f0 and Q has the gain H = 1 / (1 + jx), x = Q (f/f0 - f0/f). A detuned receiver turns the carrier's phase
by 2Q df/f0 (1.3 us for 1 % at Q 16), which a delay could also do; but it also tilts the amplitude over the band, which
no delay does, and both come from the same two numbers. So from the spectra Z_i of one pulse at all receivers, aligned,

    ln Z_i - ln S = ln H_i(f0_i, Q_i) + gain + j 2 pi f delay,

S being what they have in common, gain and delay are taken out per record and receiver, and what remains over many
records is solved for all f0_i and Q_i (Gauss-Newton). Slipped records do no harm: a slip is a delay. What all receivers
have in common stays in S and is held by the nominal values' own uncertainty. Nor is a phase seen that is the same at
all frequencies of the band, as a band-pass of other corners makes (10 %: 0.2 us): only positions known otherwise tell.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.time_differences import joint
from bluerov_slam.acoustics.time_differences.band import BAND_HZ, BandSpectra, common_windows
from bluerov_slam.acoustics.time_differences.checks import check_receivers

if TYPE_CHECKING:
    from bluerov_slam.acoustics.array import ReceiverArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

NOMINAL_HZ, NOMINAL_QUALITY = 40_000.0, 16.0
"""Of the thesis's receivers (400SR160)."""

PRIOR_STD = (0.015, 0.1)
"""Relative standard deviations of resonances and qualities before any record is seen."""

FEWEST_RECORDS = 8

LEFT_STD_S = 0.04e-6
"""What the records' being cut off leaves as error of an arrival (simulated, 1 % receivers)."""

_ITERATIONS = 6
_SEARCH_STD_S = 1.4e-6  # arrivals of uncalibrated receivers miss a source's by this


@dataclass(frozen=True, eq=False)
class ReceiverResponses:
    """Resonances of receivers (n,), and what error of an arrival remains after dividing by their gains."""

    resonance_hz: Array
    quality: Array
    delay_std_s: float

    @classmethod
    def identical(cls, count: int) -> ReceiverResponses:
        """Receivers known to be equal, as simulated ones can be."""
        return cls(np.full(count, NOMINAL_HZ), np.full(count, NOMINAL_QUALITY), 0.0)

    @classmethod
    def of_resonances(cls, resonance_hz: Array) -> ReceiverResponses:
        """Of an earlier calibration, whose qualities are taken as nominal (5 % of quality: 0.02 us)."""
        return cls(resonance_hz, np.full(len(resonance_hz), NOMINAL_QUALITY), LEFT_STD_S)

    @property
    def equal(self) -> bool:
        """Whether there is nothing to divide by."""
        return bool(np.ptp(self.resonance_hz) == 0.0 and np.ptp(self.quality) == 0.0)

    def relative(self, frequencies_hz: Array) -> ComplexArray:
        """Gains (n, b) over that of a nominal receiver."""
        ratio: ComplexArray = resonance(frequencies_hz, self.resonance_hz[:, None], self.quality[:, None])
        ratio = ratio / resonance(frequencies_hz, NOMINAL_HZ, NOMINAL_QUALITY)
        return ratio


@dataclass(frozen=True, eq=False)
class ResponseEstimate:
    """Responses with their uncertainty. `reason`: why there are none (then they are nominal); empty if all is good.

    `tilt_std` (n,): standard deviation of each resonance relative to the mean of all, as a share of itself; that of
    the mean itself, `common_std`, is the weaker one and does not matter for time differences.
    """

    responses: ReceiverResponses
    tilt_std: Array
    common_std: float
    records: int
    reason: str = ""


def estimate_responses(
    records: Iterable[Array], sample_rate_hz: float, array: ReceiverArray, sound_speed_mps: float
) -> ResponseEstimate:
    """From records (n, samples) of pulses out of any directions; such with a faulty receiver drop out.

    SNR of 10 dB and more is needed; 40 records give 0.1 % of the resonance's error.
    """
    count = len(array)
    heard = [
        each
        for each in (
            _Heard.of(np.asarray(record, dtype=np.float64), sample_rate_hz, array, sound_speed_mps)
            for record in records
        )
        if each
    ]
    if len(heard) < FEWEST_RECORDS:
        reason = f"{len(heard)} records with all receivers, expected {FEWEST_RECORDS} or more"
        nominal = ReceiverResponses(np.full(count, NOMINAL_HZ), np.full(count, NOMINAL_QUALITY), np.inf)
        return ResponseEstimate(nominal, np.full(count, np.inf), np.inf, len(heard), reason)
    state = np.zeros(2 * count)  # ln of f0 and Q over their nominal values
    prior: Array = np.repeat(np.array(PRIOR_STD, dtype=np.float64) ** -2.0, count)
    covariance = np.diag(1.0 / prior)
    for _ in range(_ITERATIONS):
        information, right, variance = _normal_equations(heard, state, count)
        information += np.diag(prior * variance)
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        state += covariance @ (right - prior * variance * state)
        covariance *= variance
    return _estimate(state, covariance, count, len(heard))


def resonance(frequencies_hz: Array, centre_hz: Array | float, quality: Array | float) -> ComplexArray:
    """1 / (1 + jQ (f/f0 - f0/f)): 1 at its centre."""
    ratio = frequencies_hz / centre_hz
    gain: ComplexArray = np.reciprocal(1.0 + 1j * (quality * (ratio - 1.0 / ratio)))
    return gain


def _estimate(state: Array, covariance: Array, count: int, records: int) -> ResponseEstimate:
    difference = np.eye(count) - 1.0 / count
    tilt = difference @ covariance[:count, :count] @ difference
    tilt_std = np.sqrt(np.diag(tilt))
    common = float(np.sqrt(covariance[:count, :count].mean()))
    # An arrival moves by 2Q / omega0 times the relative error of the resonance.
    per_share = NOMINAL_QUALITY / (np.pi * NOMINAL_HZ)
    left = float(np.hypot(per_share * tilt_std.max(), LEFT_STD_S))
    responses = ReceiverResponses(NOMINAL_HZ * np.exp(state[:count]), NOMINAL_QUALITY * np.exp(state[count:]), left)
    return ResponseEstimate(responses, tilt_std, common, records)


@dataclass(eq=False)
class _Heard:
    """One record: spectra (n, b) of smooth windows on the same part of the pulse, and arrivals (n,), improved later."""

    spectra: ComplexArray
    frequencies_hz: Array
    arrivals_s: Array

    @classmethod
    def of(cls, samples: Array, sample_rate_hz: float, array: ReceiverArray, sound_speed_mps: float) -> _Heard | None:
        if len(check_receivers(samples, sample_rate_hz).usable) < len(array):
            return None
        centred = samples - samples.mean(axis=1, keepdims=True)
        spectra = BandSpectra.of(centred, sample_rate_hz)
        places = array.positions_m
        limits = np.linalg.norm(places[:, None] - places[None], axis=2) / sound_speed_mps
        cells = joint.search(
            joint.PairCoherence(spectra, spectra.values, limits),
            joint.Geometry(places, sound_speed_mps),
            spectra.carrier_hz(),
            joint.FREEDOM,
            _SEARCH_STD_S,
            skew_s=array.sample_skew_s,
        )
        if not len(cells.arrivals_s):
            return None
        # A window that rises slowly compared with the resonance commutes with it.
        windows = common_windows(centred, sample_rate_hz, cells.arrivals_s[0], 1.0, BAND_HZ)
        return cls(windows.spectra, windows.frequencies_hz, cells.arrivals_s[0].copy())


def _normal_equations(heard: list[_Heard], state: Array, count: int) -> tuple[Array, Array, float]:
    """Sums over records for (f0_i, Q_i) with gains and delays eliminated; and the variance of what is left."""
    information = np.zeros((2 * count, 2 * count))
    right = np.zeros(2 * count)
    left = 0.0
    freedom = 0.0
    for each in heard:
        frequencies = each.frequencies_hz
        centre, quality = NOMINAL_HZ * np.exp(state[:count, None]), NOMINAL_QUALITY * np.exp(state[count:, None])
        equalised = each.spectra / resonance(frequencies, centre, quality)
        weights = joint.equal_weights(equalised)
        each.arrivals_s, aligned = joint.refine(equalised, frequencies, weights, each.arrivals_s)
        pulse = aligned.mean(axis=0)
        power = np.maximum(np.abs(pulse) ** 2, 1e-300)
        share = np.sqrt(power / power.sum())
        observed = _real(share * (aligned - pulse) * np.conj(pulse) / power)  # (n, 2b)
        slopes = _slopes(frequencies, centre, quality)  # (n, 2, b)
        model = _real(share * slopes)  # (n, 2, 2b)
        still = np.stack((_real(share.astype(np.complex128)), _real(1j * share * frequencies / frequencies.mean())))
        basis = np.linalg.qr(still.T)[0]
        observed = observed - observed @ basis @ basis.T
        model = model - model @ basis @ basis.T
        # Row of receiver i: its own slope less the mean of all, the pulse being what they have in common.
        design = np.einsum("ik,kpb->ibpk", np.eye(count) - 1.0 / count, model).reshape(count, -1, 2 * count)
        information += np.einsum("ibp,ibq->pq", design, design)
        right += np.einsum("ibp,ib->p", design, observed)
        left += float(np.sum(observed**2))
        freedom += (count - 1) * 10.0
    return information, right, left / freedom


def _slopes(frequencies_hz: Array, centre_hz: Array, quality: Array) -> ComplexArray:
    """Derivatives (n, 2, b) of ln H by ln f0 and ln Q."""
    ratio = frequencies_hz / centre_hz
    x = quality * (ratio - 1.0 / ratio)
    gain = 1.0 / (1.0 + 1j * x)
    slopes: ComplexArray = np.stack((1j * quality * (ratio + 1.0 / ratio) * gain, -1j * x * gain), axis=1)
    return slopes


def _real(values: ComplexArray) -> Array:
    """Real and imaginary parts side by side along the last axis."""
    both: Array = np.concatenate((values.real, values.imag), axis=-1)
    return both
