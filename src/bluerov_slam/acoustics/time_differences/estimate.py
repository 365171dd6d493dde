"""One entry to every method: a record in, delays with covariance, doubts and reasons out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.bounds import delay_covariance
from bluerov_slam.acoustics.receiver_faults import find_swapped
from bluerov_slam.acoustics.time_differences import joint, pairwise
from bluerov_slam.acoustics.time_differences.band import WIDE_BAND_HZ, BandSpectra, Windows, common_windows, phasor
from bluerov_slam.acoustics.time_differences.checks import check_receivers
from bluerov_slam.acoustics.time_differences.onset import early_part, onsets_s
from bluerov_slam.acoustics.time_differences.pickup import remove_common_line
from bluerov_slam.acoustics.time_differences.result import DelayPrior, TimeDifferences

if TYPE_CHECKING:
    from bluerov_slam.acoustics.calibration.responses import ReceiverResponses

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Method = Literal["thesis", "parabola", "band_limited", "matched", "phat", "envelope", "joint"]
METHODS: tuple[Method, ...] = ("thesis", "parabola", "band_limited", "matched", "phat", "envelope", "joint")

UNCALIBRATED_STD_S = 0.6e-6
"""Arrival error of a receiver of unknown response: one per cent of resonance at a quality of 16 (simulated)."""

LEAST_MISFIT_S = 0.2e-6
"""Delays of a cell may miss a source's by this: before they are placed exactly they are good to the lag's grid."""

ECHO_DEVIATES = 3.09
"""The record's beginning alone is trusted where it differs from the whole as noise lets it once in a thousand times."""

ECHO_LEAST_S, ECHO_RESPONSE_SHARE = 0.1e-6, 0.5
"""By this, and this share of the receivers' own error, whole and beginning differ without any echo."""

LEAST_ALTERNATIVE = 1e-3
"""Cells less probable than this are not told."""


def estimate_delays(
    record_samples: ArrayLike,
    sample_rate_hz: float,
    array: ReceiverArray,
    sound_speed_mps: float,
    method: Method = "joint",
    template: Array | None = None,
    prior: DelayPrior | None = None,
    responses: ReceiverResponses | None = None,
) -> TimeDifferences:
    """Time differences `toa_reference - toa_i` of one pulse.

    Args:
        record_samples: (n, samples), the receivers in the array's order; any unit.
        template: For "matched": the pulse as a receiver would record it, at the same rate.
        prior: Which delays to expect ("joint" alone asks): chooses among carrier cells.
        responses: What distinguishes the receivers, from a calibration ("joint" alone asks). None: not known, and so
            much uncertainty is added; `ReceiverResponses.identical` where they are known to be equal.
    """
    samples = np.asarray(record_samples, dtype=np.float64)
    if samples.ndim != 2 or samples.shape[0] != len(array):
        raise ValueError(f"record of shape {samples.shape}, expected {len(array)} receivers")
    checked = check_receivers(samples, sample_rate_hz)
    if len(checked.usable) < 2:
        return nothing(samples.shape[0], checked.excluded)
    record = _Record.of(samples, sample_rate_hz, array, sound_speed_mps, checked.usable)
    if method == "joint":
        return _joint(record, prior, responses, checked.excluded)
    return _pairwise(record, method, template, checked.excluded)


def nothing(count: int, excluded: tuple[tuple[int, str], ...]) -> TimeDifferences:
    """An answer without delays."""
    return TimeDifferences(
        0,
        np.zeros(0, dtype=np.intp),
        np.zeros(0),
        np.zeros((0, 0)),
        float("nan"),
        np.full(count, np.nan),
        float("nan"),
        excluded=excluded,
    )


@dataclass(frozen=True, eq=False)
class _Record:
    """The usable part of a record, its mean removed."""

    samples: Array  # (k, samples)
    sample_rate_hz: float
    receivers: NDArray[np.intp]
    receivers_m: Array  # (k, 3)
    skew_s: Array  # (k,)
    limits_s: Array  # (k, k)
    sound_speed_mps: float
    count: int  # receivers of the array

    @classmethod
    def of(
        cls,
        samples: Array,
        sample_rate_hz: float,
        array: ReceiverArray,
        sound_speed_mps: float,
        usable: NDArray[np.intp],
    ) -> _Record:
        taken = samples[usable]
        places = array.positions_m[usable]
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        return cls(
            taken - taken.mean(axis=1, keepdims=True),
            sample_rate_hz,
            usable,
            places,
            array.sample_skew_s[usable],
            apart / sound_speed_mps,
            sound_speed_mps,
            len(samples),
        )

    @property
    def skew_of_delays_s(self) -> Array:
        """What delays between samples lack to be delays in time (k-1,)."""
        skew: Array = self.skew_s[0] - self.skew_s[1:]
        return skew

    def per_receiver(self, values: Array) -> Array:
        """(k,) spread over all receivers (n,), NaN for those left out."""
        full = np.full(self.count, np.nan)
        full[self.receivers] = values
        return full


def _pairwise(
    record: _Record, method: Method, template: Array | None, excluded: tuple[tuple[int, str], ...]
) -> TimeDifferences:
    rate = record.sample_rate_hz
    spectra = BandSpectra.of(record.samples, rate)
    limits = record.limits_s[0, 1:] * pairwise.LAG_MARGIN + pairwise.LAG_MARGIN_S
    skew = record.skew_of_delays_s
    if method == "thesis":
        delays = pairwise.thesis(record.samples, rate)  # the skew is left in: as published
    elif method == "parabola":
        delays = pairwise.parabola(record.samples, rate) + skew
    elif method == "phat":
        delays = pairwise.phat(record.samples, rate) + skew
    elif method == "envelope":
        delays = pairwise.envelope(spectra, limits) + skew
    elif method == "matched":
        if template is None:
            raise ValueError("the matched filter needs a template of the pulse")
        delays = pairwise.matched(spectra, template, limits) + skew
    else:
        delays = pairwise.band_limited(spectra, limits) + skew
    quality = _quality(record, np.concatenate(([0.0], -delays)))
    covariance = quality.covariance_s2
    if method in ("thesis", "phat"):
        covariance = covariance + np.eye(len(delays)) / (12.0 * rate**2)
    return TimeDifferences(
        int(record.receivers[0]),
        record.receivers,
        delays,
        covariance,
        quality.carrier_hz,
        record.per_receiver(quality.snr_db),
        float("nan"),
        excluded=excluded,
    )


@dataclass(frozen=True, eq=False)
class _Quality:
    covariance_s2: Array
    snr_db: Array
    carrier_hz: float


def _quality(record: _Record, arrivals_s: Array) -> _Quality:
    """Of delays already found: from the windows that they align."""
    windows = common_windows(record.samples, record.sample_rate_hz, arrivals_s)
    turns = phasor(2.0 * np.pi * windows.frequencies_hz * arrivals_s[:, None])
    return _of_aligned(windows.spectra * turns, windows)


def _of_aligned(aligned: ComplexArray, windows: Windows) -> _Quality:
    """What the common pulse leaves is noise, which gives the least covariance of the delays."""
    count, bins = aligned.shape
    norms = np.sqrt(np.sum(np.abs(aligned) ** 2, axis=1))
    pulse = np.mean(aligned / np.maximum(norms, 1e-300)[:, None], axis=0)
    power = np.abs(pulse) ** 2
    energy = max(float(power.sum()), 1e-300)
    gains = np.real(aligned @ np.conj(pulse)) / energy
    left = np.sum(np.abs(aligned - gains[:, None] * pulse) ** 2, axis=1) * count / (count - 1)
    # Bins of a zero-padded transform are not independent: so many samples share so large a transform. A bin's noise
    # is spread over both its components, of which a shift of the pulse moves one.
    share = windows.effective / windows.size
    independent = bins * share
    noise = np.maximum(left, 1e-12 * norms**2) / bins * independent / (independent - 1.0)  # gain and arrival are fitted
    curvature = float(2.0 * share * ((2.0 * np.pi * windows.frequencies_hz) ** 2 @ power))
    covariance = delay_covariance(gains**2 * curvature, noise)
    return _Quality(covariance, windows.snr_db, float(power @ windows.frequencies_hz) / energy)


def _joint(
    record: _Record,
    prior: DelayPrior | None,
    responses: ReceiverResponses | None,
    excluded: tuple[tuple[int, str], ...],
) -> TimeDifferences:
    spectra = BandSpectra.of(record.samples, record.sample_rate_hz)
    begun = onsets_s(spectra, spectra.values, float(record.limits_s.max()))
    remark = ""
    if begun is not None:
        cleaned = remove_common_line(record.samples, record.sample_rate_hz, begun)
        remark = cleaned.remark
        if cleaned.samples is not record.samples:
            record = replace(record, samples=cleaned.samples)
            spectra = BandSpectra.of(record.samples, record.sample_rate_hz)
    seeker = _Seeker.of(record, prior, responses)
    values = seeker.equalised(spectra.values, spectra.frequencies_hz)
    found = seeker.seek(spectra, values, joint.FREEDOM)
    early = None if begun is None else seeker.seek_early(begun, found)
    judged = early or found
    exchanged = None if judged is None or judged.cells.free_s is None else seeker.exchanged(judged.cells.free_s)
    if exchanged is not None:
        return nothing(record.count, (*excluded, *exchanged))
    onset_only = early is not None and early.sure and (found is None or seeker.contradict(found, early))
    if onset_only:
        found = early
    if found is None:
        return nothing(record.count, (*excluded, (-1, "no delays that a source could cause")))
    delays = -found.arrivals_s[1:] + record.skew_of_delays_s
    cells, probability = found.cells, found.probability
    if early is not None and early.probability[0] > probability[0]:
        # Both say the same cell; an echo that makes the whole record doubtful has not reached its beginning.
        cells, probability = early.cells, early.probability
    other = tuple(
        (delays - (cells.arrivals_s[each, 1:] - cells.arrivals_s[0, 1:]), float(probability[each]))
        for each in range(1, len(probability))
        if probability[each] > LEAST_ALTERNATIVE
    )
    residual, _ = seeker.geometry.misfit((found.arrivals_s + record.skew_s)[None])
    return TimeDifferences(
        int(record.receivers[0]),
        record.receivers,
        delays,
        found.quality.covariance_s2 + seeker.std_s**2 * (np.eye(len(delays)) + 1.0),
        found.quality.carrier_hz,
        record.per_receiver(found.quality.snr_db),
        float(1.0 - probability[0]),
        other,
        excluded,
        float(np.sqrt(np.mean(residual**2))),
        onset_only,
        remark,
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """The best cell's arrivals (k,) by the records' own samples, exactly, and all that were considered."""

    cells: joint.Cells
    arrivals_s: Array
    quality: _Quality

    @property
    def sure(self) -> bool:
        """Whether the best cell is likelier than all others together."""
        return bool(self.probability[0] > 0.5)

    @property
    def probability(self) -> Array:
        """Of each cell, the best first."""
        odds = np.exp(self.cells.log_odds - self.cells.log_odds[0])
        share: Array = odds / odds.sum()
        return share


@dataclass(frozen=True, eq=False)
class _Seeker:
    """What the search over carrier cells needs besides a record's spectra."""

    record: _Record
    responses: ReceiverResponses | None
    geometry: joint.Geometry
    std_s: float  # of an arrival, from the receiver's response
    expected: tuple[Array, Array] | None

    @classmethod
    def of(cls, record: _Record, prior: DelayPrior | None, responses: ReceiverResponses | None) -> _Seeker:
        std_s = UNCALIBRATED_STD_S if responses is None else responses.delay_std_s
        geometry = joint.Geometry(record.receivers_m, record.sound_speed_mps)
        return cls(record, responses, geometry, std_s, _expected(record, prior))

    def equalised(self, spectra: ComplexArray, frequencies_hz: Array) -> ComplexArray:
        """Spectra (k, b) as nominal receivers would have heard them."""
        if self.responses is None or self.responses.equal:
            return spectra
        equalised: ComplexArray = spectra / self.responses.relative(frequencies_hz)[self.record.receivers]
        return equalised

    def cells(
        self, spectra: BandSpectra, values: ComplexArray, freedom: float, most: int = joint.CANDIDATES
    ) -> joint.Cells:
        """The likeliest carrier cells."""
        return joint.search(
            joint.PairCoherence(spectra, values, self.record.limits_s),
            self.geometry,
            spectra.carrier_hz(),
            freedom,
            2.0 * self.std_s + LEAST_MISFIT_S,
            self.expected,
            self.record.skew_s,
            most,
        )

    def seek(self, spectra: BandSpectra, values: ComplexArray, freedom: float) -> _Found | None:
        """From the whole record."""
        cells = self.cells(spectra, values, freedom)
        if not len(cells.arrivals_s):
            return None
        start = cells.arrivals_s[0]
        windows = common_windows(self.record.samples, self.record.sample_rate_hz, start)
        return self._placed(cells, windows)

    def seek_early(self, begun_s: Array, whole: _Found | None) -> _Found | None:
        """From what follows the onset: the cell from about each record's own, the place from about the common one."""
        samples, rate = self.record.samples, self.record.sample_rate_hz
        spectra = BandSpectra.of(early_part(samples, rate, begun_s)[0], rate)
        values = self.equalised(spectra.values, spectra.frequencies_hz)
        cells = self.cells(spectra, values, joint.EARLY_FREEDOM, joint.EARLY_CANDIDATES)
        if not len(cells.arrivals_s):
            return None
        start = cells.arrivals_s[0]
        part, effective = early_part(samples, rate, start + np.median(begun_s - start))
        wide = BandSpectra.of(part, rate, WIDE_BAND_HZ)
        snr_db = (common_windows(samples, rate, start) if whole is None else whole.quality).snr_db
        windows = Windows(wide.values, wide.frequencies_hz, effective, wide.size, snr_db)
        return self._placed(cells, windows)

    def contradict(self, whole: _Found, early: _Found) -> bool:
        """Whether the whole record says something else than its beginning: then an echo has reached it."""
        difference = whole.arrivals_s[1:] - early.arrivals_s[1:]
        # Both see the same noise at the beginning, so the variance of their difference is that of the variances.
        covariance = early.quality.covariance_s2 - whole.quality.covariance_s2
        values, vectors = np.linalg.eigh(covariance)
        floor = ECHO_LEAST_S**2 + (ECHO_RESPONSE_SHARE * self.std_s) ** 2
        turned = vectors.T @ difference
        squared = float(np.sum(turned**2 / (np.maximum(values, 0.0) + floor)))
        # Wilson and Hilferty (1931), doi:10.1073/pnas.17.12.684: the cube root of chi-square is nearly normal.
        spread = 2.0 / (9.0 * len(difference))
        return bool(np.cbrt(squared / len(difference)) > 1.0 - spread + ECHO_DEVIATES * np.sqrt(spread))

    def exchanged(self, arrivals_s: Array) -> tuple[tuple[int, str], ...] | None:
        """Receivers whose exchange would explain impossible arrivals (k,)."""
        used = ReceiverArray(self.record.receivers_m, self.record.skew_s)
        delays = -(arrivals_s[1:] + self.record.skew_s[1:] - arrivals_s[0] - self.record.skew_s[0])
        fault = find_swapped(delays, used, self.record.sound_speed_mps)
        if fault is None:
            return None
        text = f"{fault.fault.value}: {fault.text}"
        return tuple((int(self.record.receivers[each]), text) for each in fault.receivers)

    def _placed(self, cells: joint.Cells, windows: Windows) -> _Found:
        heard = self.equalised(windows.spectra, windows.frequencies_hz)
        weights = joint.equal_weights(heard)
        arrivals, aligned = joint.refine(heard, windows.frequencies_hz, weights, cells.arrivals_s[0])
        return _Found(cells, arrivals, _of_aligned(aligned / weights[:, None], windows))


def _expected(record: _Record, prior: DelayPrior | None) -> tuple[Array, Array] | None:
    """The prior as arrivals (k,) between samples after the first usable receiver's, and their inverse covariance."""
    if prior is None:
        return None
    arrivals = np.concatenate(([0.0], -np.asarray(prior.delays_s, dtype=np.float64)))
    size = len(arrivals)
    covariance = np.zeros((size, size))
    covariance[1:, 1:] = prior.covariance_s2
    change = np.eye(size)[record.receivers[1:]] - np.eye(size)[record.receivers[0]]
    chosen = change @ arrivals
    inverse = np.linalg.inv(change @ covariance @ change.T + 1e-20 * np.eye(len(chosen)))
    return np.concatenate(([0.0], chosen)) + record.skew_s[0] - record.skew_s, inverse
