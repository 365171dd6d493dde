"""All receivers at once: the delays at which the sum over all pairs of receivers is highest, as any source allows them.

For an unknown pulse the most likely arrivals are those that make the steered sum strongest,

    P(t) = sum_f |sum_i w_i X_i(f) exp(j 2 pi f t_i)|^2 = const + 2 sum_{i<j} w_i w_j Re C_ij(t_i - t_j),

the correlations of all pairs together. P has a peak in every carrier cell, so the search has three steps:

1. Per receiver the in-phase lags to the reference with the strongest envelope, within the physical limit.
2. Receiver by receiver the combinations of those with the highest coherence of all pairs (a beam search: any number of
   receivers), each held against the geometry: does a source exist (direction, and a range beyond the aperture) whose
   delays these are? One slipped receiver of the square breaks the closure by a whole period.
3. The best cells get their exact place by Newton's method on windows that cover the same part of the pulse.

Coherence is that of the part two records share, so a pulse cut off by the window favours no lag. What the residual
leaves is taken as noise of unknown level: the odds between two cells are (1 - coherence) to the power of the degrees of
freedom, with which unequal receivers, not the noise, decide when a cell is sure.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import FLAT_SHARE
from bluerov_slam.acoustics.time_differences.band import BandSpectra, phasor

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LAG_MARGIN = 1.02
"""Physical limits are widened by this: sound speed and positions are not exact."""

CANDIDATES = 20
"""In-phase lags kept per receiver: the cells about the right one, and those of the bits before and after. So many times
the receivers met so far is also how many combinations are kept from receiver to receiver."""

EARLY_CANDIDATES = 12
"""The same where only one bit is looked at."""

CELLS = 10
"""Combinations placed exactly and told as alternatives."""

LEAST_OVERLAP = 0.25
"""Share of the record that two receivers must have in common for a lag to count."""

END_S = 0.1e-3
"""Left out at both ends of a record when cells are compared: the band's filter rings so long."""

SUM_STRIDE = 3
"""Energies are summed over every third sample of an envelope: that is still twice the band's rate."""

NEAREST_RANGE_IN_APERTURES = 2.0
"""A source is at least so many times the array's largest extent away."""

CONTRADICTION_S = 25e-6
"""RMS by which arrivals miss any source's, from which receivers may be exchanged: two slips of a period, or more."""

CONTRADICTION_ODDS = 8.0
"""By so much in log-odds must impossible arrivals cohere better than possible ones."""

SHORT_OF_ONE = 0.1
"""By so much more may a measured direction in space be shorter than 1: wave fronts are bent."""

NEWTON_STEPS = 4
NEWTON_ENOUGH_S = 1e-12

FREEDOM = 5.0
"""Independent numbers in a pulse 2 kHz wide and 2.4 ms long."""


EARLY_FREEDOM = 3.0
"""The same of its first half millisecond."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Receivers about their centre, and what arrivals (n,) no source can cause."""

    receivers_m: Array  # (n, 3)
    sound_speed_mps: float

    @cached_property
    def _basis(self) -> _Basis:
        return _Basis.of(self.receivers_m, self.sound_speed_mps)

    def misfit(self, arrivals_s: Array) -> tuple[Array, Array]:
        """How far arrivals (m, n) miss the nearest possible ones: residuals (m, n), and whether a direction exists.

        Arrivals are a time, minus m.u / c, plus the wave front's bend (|m|^2 - (m.u)^2) / (2 c r).
        """
        basis = self._basis
        directions = arrivals_s @ basis.direction
        along = directions @ basis.places.T
        bend = ((basis.squares - along**2) / (2.0 * self.sound_speed_mps)) @ basis.across
        residual = arrivals_s @ basis.across
        inverse = np.sum(bend * residual, axis=1) / np.maximum(np.sum(bend**2, axis=1), 1e-30)
        inverse = np.clip(inverse, 0.0, basis.largest_inverse_range)
        length = np.sqrt(np.sum(directions**2, axis=1))
        return residual - inverse[:, None] * bend, (length <= LAG_MARGIN) & (length >= basis.least_length)


@dataclass(frozen=True, eq=False)
class _Basis:
    """What depends on the receivers alone: arrivals @ direction is the direction, arrivals @ across what none makes."""

    places: Array  # (n, 3) about their centre
    squares: Array
    direction: Array  # (n, 3)
    across: Array  # (n, n)
    largest_inverse_range: float
    least_length: float  # of a direction: 1 where all three components are measured

    @classmethod
    def of(cls, receivers_m: Array, sound_speed_mps: float) -> _Basis:
        places = receivers_m - receivers_m.mean(axis=0)
        count = len(places)
        left, values, right = np.linalg.svd(-places / sound_speed_mps, full_matrices=False)
        kept = values > FLAT_SHARE * values[0]
        level = np.eye(count) - 1.0 / count
        basis = np.column_stack((np.full(count, count**-0.5), left[:, kept]))
        aperture = float(np.max(np.linalg.norm(places[:, None] - places[None], axis=2)))
        return cls(
            places,
            np.sum(places**2, axis=1),
            level @ left[:, kept] / values[kept] @ right[kept],
            np.eye(count) - basis @ basis.T,
            1.0 / (NEAREST_RANGE_IN_APERTURES * aperture),
            2.0 - LAG_MARGIN - SHORT_OF_ONE if kept.sum() == 3 else 0.0,
        )


@dataclass(frozen=True, eq=False)
class Cells:
    """Carrier cells (m): arrivals (m, n) after the reference's, coherence and log-odds, the best first."""

    arrivals_s: Array
    coherence: Array
    log_odds: Array
    misfit_s: Array  # (m,) RMS
    free_s: Array | None = None  # (n,) arrivals that cohere better by far, but that no source can cause


class PairCoherence:
    """Coherence of every pair of records at any lag, as envelopes."""

    def __init__(self, spectra: BandSpectra, values: ComplexArray, limits_s: Array) -> None:
        """`limits_s` (n, n): the largest delay of each pair."""
        self.count = len(values)
        self.centre_hz = spectra.centre_hz
        self.step_s = spectra.step_s
        first, second = np.triu_indices(self.count, 1)
        self._pair = np.zeros((self.count, self.count), dtype=np.intp)
        self._pair[first, second] = np.arange(len(first))
        reach = int(np.ceil(float(limits_s.max()) * LAG_MARGIN / self.step_s)) + 1
        self.reach = min(reach, spectra.points // 2 - 1)
        offsets = np.arange(-self.reach, self.reach + 1)
        self.records = spectra.envelopes(values) / np.sqrt(spectra.points)
        self.length = round(spectra.points * spectra.samples / spectra.size)
        cross = spectra.envelopes(values[first] * np.conj(values[second]))[:, offsets % spectra.points]
        energy = self._overlap(first, second, offsets)
        self._envelope = np.where(energy > 0.0, cross / np.sqrt(np.maximum(energy, 1e-300)), 0.0)
        beyond = np.abs(offsets * self.step_s)[None, :] > LAG_MARGIN * limits_s[first, second][:, None] + self.step_s
        self._envelope[beyond] = 0.0
        self.offsets_s: Array = np.asarray(offsets * self.step_s, dtype=np.float64)

    def _overlap(self, first: NDArray[np.intp], second: NDArray[np.intp], offsets: NDArray[np.intp]) -> Array:
        """Product of the two energies (pairs, lags) in what the pair has in common; 0 where that is too short."""
        length, power = self.length, np.abs(self.records[:, : self.length]) ** 2
        total = np.concatenate((np.zeros((self.count, 1)), np.cumsum(power, axis=1)), axis=1)
        late, early = np.clip(offsets, 0, length), np.clip(-offsets, 0, length)
        begin, end = total[:, np.stack((late, early))], total[:, np.stack((length - early, length - late))]
        one = end[first, 0] - begin[first, 0]
        other = end[second, 1] - begin[second, 1]
        enough = np.minimum(one, other) > LEAST_OVERLAP * np.minimum(total[first, -1], total[second, -1])[:, None]
        return np.where(enough, one * other, 0.0)

    def of_all(self, arrivals_s: Array) -> tuple[Array, Array]:
        """Mean coherence (m,) of all pairs at arrivals (m, n) over the part of the pulse that all records have in
        common, and that part's share (m,) of their energy.

        The records' ends are left out: there the filter of the band has mixed the pulse with the nothing beyond.
        """
        late = arrivals_s - arrivals_s.min(axis=1, keepdims=True)
        # The common part starts where the latest record's pulse does: times of the earliest one's own samples.
        place = late / self.step_s
        whole = np.floor(place).astype(np.intp)
        part = (place - whole)[:, :, None]
        margin = int(np.ceil(END_S / self.step_s))
        counts = self.length - 2 * margin - whole.max(axis=1) - 1
        times = np.arange(0, max(1, int(counts.max())), SUM_STRIDE)
        within = times < counts[:, None, None]
        rows = np.arange(self.count)[None, :, None]
        at = np.where(within, margin + whole[:, :, None] + times, 0)
        taken = self.records[rows, at] * (1.0 - part) + self.records[rows, at + 1] * part
        taken *= phasor(2.0 * np.pi * self.centre_hz * late)[:, :, None]
        taken = np.where(within, taken, 0.0)
        energy = np.sum(np.abs(taken) ** 2, axis=2)
        together = np.sum(taken / np.sqrt(np.maximum(energy, 1e-300))[:, :, None], axis=1)
        mean: Array = (np.sum(np.abs(together) ** 2, axis=1) / self.count - 1.0) / (self.count - 1)
        whole_energy = np.sum(np.abs(self.records[:, : self.length : SUM_STRIDE]) ** 2, axis=1)
        share: Array = np.mean(energy / np.maximum(whole_energy, 1e-300), axis=1)
        return mean, share

    def envelope(self, first: int, second: int) -> ComplexArray:
        """Complex coherence at the lags `offsets_s` = toa_first - toa_second; first < second."""
        row: ComplexArray = self._envelope[self._pair[first, second]]
        return row

    def at(self, first: int, second: int, lags_s: Array) -> Array:
        """Real coherence at lags `toa_first - toa_second` of any shape; 0 beyond the physical limit."""
        if first > second:
            return self.at(second, first, -lags_s)
        row = self.envelope(first, second)
        place = lags_s / self.step_s + self.reach
        below = np.floor(place).astype(np.intp)
        inside = (below >= 0) & (below < len(row) - 1)
        below = np.where(inside, below, 0)
        part = place - below
        value = row[below]
        value += (row[below + 1] - value) * part
        phase = 2.0 * np.pi * self.centre_hz * lags_s
        turned: Array = value.real * np.cos(phase) - value.imag * np.sin(phase)
        return np.where(inside, turned, 0.0)

    def in_phase(self, first: int, second: int, carrier_hz: float, most: int) -> Array:
        """The lags `toa_first - toa_second` of the strongest positive peaks, the strongest first."""
        row = self.envelope(first, second)
        phase = np.angle(row * phasor(2.0 * np.pi * self.centre_hz * self.offsets_s))
        lags = self.offsets_s - phase / (2.0 * np.pi * carrier_hz)
        own = np.abs(lags - self.offsets_s) <= 0.55 * self.step_s  # a peak between two lags must not be lost
        strength = np.where(own, np.abs(row), 0.0)
        order = np.argsort(-strength, kind="stable")[:most]
        chosen: Array = lags[order[strength[order] > 0.0]]
        near = np.abs(chosen[:, None] - chosen[None]) < 0.3 / carrier_hz
        distinct: Array = chosen[~np.any(np.tril(near, -1), axis=1)]
        return distinct


def search(
    coherence: PairCoherence,
    geometry: Geometry,
    carrier_hz: float,
    freedom: float,
    response_std_s: float,
    expected_s: tuple[Array, Array] | None = None,
    skew_s: Array | None = None,
    most: int = CANDIDATES,
) -> Cells:
    """The likeliest carrier cells, all arrivals by the records' own samples.

    Args:
        freedom: Independent numbers in one receiver's pulse.
        response_std_s: How far arrivals may miss those of a source.
        expected_s: Prior arrivals (n,) after receiver 0's and the inverse covariance (n-1, n-1).
        most: In-phase lags tried per receiver.
        skew_s: (n,) how much later than its number says a receiver's sample is taken.
    """
    count = coherence.count
    kept = np.zeros((1, 1))
    score = np.zeros(1)
    for newest in range(1, count):
        lags = -coherence.in_phase(0, newest, carrier_hz, most)  # arrival after receiver 0's
        if not len(lags):
            return Cells(np.zeros((0, count)), np.zeros(0), np.zeros(0), np.zeros(0))
        # All of those kept with all new lags (m, q); receiver 0 is at zero in each.
        gained = np.broadcast_to(coherence.at(0, newest, -lags), (len(kept), len(lags)))
        for other in range(1, newest):
            gained = gained + coherence.at(other, newest, kept[:, other, None] - lags)
        total = (score[:, None] + gained).reshape(-1)
        width = most * (1 + newest)
        best = np.argpartition(-total, width)[:width] if len(total) > width else np.arange(len(total))
        row, column = np.divmod(best, len(lags))
        kept, score = np.concatenate((kept[row], lags[column, None]), axis=1), total[best]
    residual, exists = geometry.misfit(kept if skew_s is None else kept + skew_s)
    squared = np.sum(residual**2, axis=1)
    against = 0.5 * squared / response_std_s**2
    if expected_s is not None:
        off = kept[:, 1:] - expected_s[0][1:]
        against = against + 0.5 * np.einsum("mi,ij,mj->m", off, expected_s[1], off)
    against = np.where(exists, against, np.inf)
    doubt = _doubt(score / (0.5 * count * (count - 1)), count, freedom)
    order = np.argsort(against + doubt, kind="stable")[:CELLS]
    order = order[np.isfinite(against[order])]
    free = _contradicting(kept, doubt, squared / count, order)
    if not len(order):
        return Cells(np.zeros((0, count)), np.zeros(0), np.zeros(0), np.zeros(0), free)
    kept, against, squared = kept[order], against[order], squared[order]
    mean, share = coherence.of_all(kept)
    odds = -against - _doubt(mean, count, freedom * share)
    order = np.argsort(-odds, kind="stable")
    return Cells(kept[order], mean[order], odds[order], np.sqrt(squared[order] / count), free)


def _contradicting(arrivals_s: Array, doubt: Array, squared_s2: Array, possible: NDArray[np.intp]) -> Array | None:
    """Arrivals (n,) far from any source's that cohere far better than the possible ones."""
    best = int(np.argmin(doubt))
    if squared_s2[best] < CONTRADICTION_S**2:
        return None
    if len(possible) and doubt[possible].min() < doubt[best] + CONTRADICTION_ODDS:
        return None
    found: Array = arrivals_s[best]
    return found


def _doubt(coherence: Array, count: int, freedom: float | Array) -> Array:
    """Negative log-likelihood of cells with this mean coherence: what the sum leaves is noise of unknown level."""
    return (count - 1) * freedom * np.log1p(-np.clip(coherence, -1.0, 1.0 - 1e-9))


def refine(
    spectra: ComplexArray, frequencies_hz: Array, weights: Array, arrivals_s: Array
) -> tuple[Array, ComplexArray]:
    """Arrivals (n,) at the peak of P in their cell by Newton's method (the first stays), and the aligned spectra."""
    omega = 2.0 * np.pi * frequencies_hz
    arrivals = arrivals_s.copy()
    weighted = weights[:, None] * spectra
    limit = 0.25 / float(frequencies_hz.mean())
    for step in range(NEWTON_STEPS + 1):
        aligned = weighted * phasor(omega * arrivals[:, None])
        if step == NEWTON_STEPS:
            break
        total = aligned.sum(axis=0)
        against = np.conj(total) * aligned
        slope = -2.0 * against.imag @ omega
        scaled = aligned * omega
        bend = 2.0 * np.real(scaled @ np.conj(scaled).T)
        bend[np.diag_indices_from(bend)] -= 2.0 * against.real @ omega**2
        try:
            move = np.linalg.solve(bend[1:, 1:], -slope[1:])
        except np.linalg.LinAlgError:  # a receiver without any power
            break
        arrivals[1:] += np.clip(move, -limit, limit)
        if np.abs(move).max() < NEWTON_ENOUGH_S:
            aligned = weighted * phasor(omega * arrivals[:, None])
            break
    return arrivals, aligned


def equal_weights(spectra: ComplexArray) -> Array:
    """Weights (n,) that make all receivers count alike."""
    power = np.sum(np.abs(spectra) ** 2, axis=1)
    equal: Array = np.sqrt(power.mean() / np.maximum(power, 1e-300))
    return equal
