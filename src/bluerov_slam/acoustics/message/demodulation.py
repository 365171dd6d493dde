"""From the samples of a whole frame to the message in it.

Every receiver's record goes through the matched filter of one "1" bit. Carrier and bit clock are one clock (a bit is 20
periods), so the phase from bit to bit gives the bit period far better than the bits' edges do: found from the known
bits first, then from all. After that the decision is coherent, all receivers together, with the one bit that the
resonances ring on into the next kept in the metric (Ungerboeck's form, two states, max-log forward and backward).
A frame whose CRC fails is tried again with the echoes of its own first decision taken out by a linear equaliser.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.message.coding import decode
from bluerov_slam.acoustics.message.frame import (
    BODY_START,
    COUNTER_PLACES,
    KNOWN_BITS,
    KNOWN_PLACES,
    MESSAGE_FRAME_BITS,
)
from bluerov_slam.acoustics.pulse_train import STEPS_PER_BIT, PulseTrain, ReceptionChain

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

CARRIER_RANGE_HZ = (39_300.0, 40_700.0)  # nominal 40.404 kHz, really 39.75 to 39.90, and some more on both sides
_CARRIER_GRID = 0.005  # relative; the known 27 bits may drift by 0.07 of a bit
_HALF_BAND_HZ = 6_000.0
_OVERSAMPLING = 8
_PERIODS_PER_BIT = STEPS_PER_BIT // 2
_MIN_SAMPLE_RATE_HZ = 2.0 * (CARRIER_RANGE_HZ[1] + _HALF_BAND_HZ)
_WIDEST_ARRAY_S = 1.6e-3  # the thesis's diagonal in air is 1.46 ms
_PHASE_WINDOW_BITS = 41
_ECHO_BITS = 8  # 4 ms: 6 m of way more than the direct path's
_EQUALISER_TRIES = 3


@dataclass(frozen=True, slots=True)
class DemodulatedFrame:
    """What was heard in a record.

    `payload` is None where the CRC did not agree. `start_s` is the arrival of the frame's first step after sample 0 at
    the receiver that heard it first,
    `carrier_hz` by the receiver's clock, `snr_db` the energy of a "1" over the noise density, all receivers together,
    `sync` between 0 and 1: the share of the known bits' contrast that was found.
    """

    payload: bytes | None
    counter: int
    corrected_errors: int
    start_s: float
    carrier_hz: float
    snr_db: float
    sync: float
    equalised: bool
    hard_bits: NDArray[np.int8]
    """All 327 bits before error correction."""


def demodulate(
    samples: FloatArray, sample_rate_hz: float, chain: ReceptionChain | None = None
) -> DemodulatedFrame | None:
    """The frame in a record (receivers, samples) in any unit; None where the record is too short or silent.

    Raises ValueError for a sample rate that cannot hold the carrier's band, or samples that are not finite.
    """
    samples = np.atleast_2d(np.asarray(samples, np.float64))
    if sample_rate_hz < _MIN_SAMPLE_RATE_HZ:
        raise ValueError(f"sample rate {sample_rate_hz:.0f} Hz, a message needs {_MIN_SAMPLE_RATE_HZ:.0f} Hz or more")
    if not np.isfinite(samples).all():
        raise ValueError("a record holds values that are no numbers")
    scale = samples.std(axis=1)
    shortest_s = MESSAGE_FRAME_BITS * _PERIODS_PER_BIT / CARRIER_RANGE_HZ[1]
    if samples.shape[1] < shortest_s * sample_rate_hz or not scale.any():
        return None
    centred = samples[scale > 0.0] - samples[scale > 0.0].mean(axis=1, keepdims=True)
    band = _Band.of(centred / scale[scale > 0.0, None], sample_rate_hz, chain or ReceptionChain())
    return _demodulate(band)


def _demodulate(band: _Band) -> DemodulatedFrame | None:
    found = _coarse(band)
    if found is None:
        return None
    start_s, carrier_hz, sync = found
    values, start_s, carrier_hz, ringing = _refined(band, start_s, carrier_hz)
    first = _decide(values, ringing)
    result = _result(first.ratio, values, start_s, carrier_hz, first.snr, sync, equalised=False)
    ratio = first.ratio
    for _ in range(_EQUALISER_TRIES if result.payload is None else 0):
        ratio = _equalised(values, _word(ratio))
        again = _result(ratio, values, start_s, carrier_hz, first.snr, sync, equalised=True)
        if again.payload is not None:
            return again
    return result


@dataclass(frozen=True, slots=True)
class _Band:
    """The spectrum of the record about the carrier, which everything is computed from."""

    spectrum: ComplexArray  # (receivers, bins)
    frequency_hz: FloatArray
    duration_s: float
    chain: ReceptionChain

    @classmethod
    def of(cls, samples: FloatArray, sample_rate_hz: float, chain: ReceptionChain) -> _Band:
        count = samples.shape[1]
        length = _smooth_length(count + int(2e-3 * sample_rate_hz))
        resolution_hz = sample_rate_hz / length
        first = int((CARRIER_RANGE_HZ[0] - _HALF_BAND_HZ) / resolution_hz)
        last = int((CARRIER_RANGE_HZ[1] + _HALF_BAND_HZ) / resolution_hz) + 1
        spectrum = np.fft.rfft(samples, length, axis=1)[:, first:last]
        frequency_hz = np.arange(first, last, dtype=np.float64) * resolution_hz
        return cls(spectrum, frequency_hz, count / sample_rate_hz, chain)

    def matched(self, carrier_hz: float) -> tuple[ComplexArray, float, complex]:
        """Matched filter for a "1" at this carrier: baseband (receivers, times), time step (s), ringing into the next.

        The output at a bit's onset is its amplitude; noise-free and alone, a "1" of the template gives 1.
        """
        bit = PulseTrain.at_carrier((1,), carrier_hz)
        template = bit.spectrum(self.frequency_hz) * self.chain.response(self.frequency_hz)
        power = np.square(np.abs(template))
        resolution_hz = self.frequency_hz[1] - self.frequency_hz[0]
        filtered = self.spectrum * (np.conj(template) / power.sum())
        ringing = complex(np.sum(power * np.exp(2j * np.pi * self.frequency_hz * bit.bit_s)) / power.sum())
        middle = round(carrier_hz / resolution_hz) - round(self.frequency_hz[0] / resolution_hz)
        length = _smooth_length(_OVERSAMPLING * filtered.shape[1])
        padded = np.zeros((len(filtered), length), np.complex128)
        padded[:, : filtered.shape[1]] = filtered
        baseband = np.fft.ifft(np.roll(padded, -middle, axis=1), axis=1) * length
        step_s = 1.0 / (resolution_hz * length)
        # The roll brought the nearest bin to frequency 0; what is left to the carrier itself is turned back here.
        rest_hz = carrier_hz - self.frequency_hz[middle]
        baseband = baseband * np.exp(-2j * np.pi * rest_hz * step_s * np.arange(length))
        return baseband, step_s, ringing


def _coarse(band: _Band) -> tuple[FloatArray, float, float] | None:
    """Onset at each receiver (s), carrier and quality of the best match of the known bits' energies.

    In air the receivers of one array hear the same bit up to three bits apart: each has an onset of its own, within
    `_WIDEST_ARRAY_S` of the others.
    """
    best: tuple[FloatArray, float, float] | None = None
    highest = 0.0
    ones = KNOWN_BITS > 0
    weights = np.where(ones, 1.0 / ones.sum(), -1.0 / (~ones).sum())
    for carrier_hz in np.arange(CARRIER_RANGE_HZ[0], CARRIER_RANGE_HZ[1], _CARRIER_GRID * CARRIER_RANGE_HZ[0]):
        baseband, step_s, _ = band.matched(float(carrier_hz))
        energy = np.square(np.abs(baseband))
        bit_s = _PERIODS_PER_BIT / carrier_hz
        starts = int((band.duration_s - MESSAGE_FRAME_BITS * bit_s) / step_s)
        if starts < 1:
            continue
        contrast, level = np.zeros((2, len(energy), starts))
        for place, weight in zip(KNOWN_PLACES, weights, strict=True):
            shift = round(place * bit_s / step_s)
            contrast += weight * energy[:, shift : shift + starts]
            level += abs(weight) * energy[:, shift : shift + starts]
        spread = min(max(round(_WIDEST_ARRAY_S / step_s), 1), starts)
        windows = np.lib.stride_tricks.sliding_window_view(contrast, spread, axis=1)
        together = windows.max(axis=2).sum(axis=0)
        at = int(together.argmax())
        if together[at] > highest:
            highest = float(together[at])
            each = at + windows[:, at].argmax(axis=1)
            heard = level[np.arange(len(level)), each].sum()
            best = (each * step_s, float(carrier_hz), highest / max(float(heard), 1e-30))
    return best


def _refined(band: _Band, start_s: FloatArray, carrier_hz: float) -> tuple[ComplexArray, FloatArray, float, complex]:
    """Values per receiver and bit (phase turned to 0), and the onsets, carrier and ringing they were taken with."""
    places = np.arange(MESSAGE_FRAME_BITS)
    for stage in range(3):
        baseband, step_s, ringing = band.matched(carrier_hz)
        values = _at_bits(baseband, step_s, start_s, carrier_hz)
        known = KNOWN_PLACES[KNOWN_BITS > 0]
        used = known if stage == 0 else places
        widest = np.pi if stage == 0 else 2.0 * np.pi / 40.0
        turn = _phase_per_bit(values[:, used], used, widest)
        carrier_hz = carrier_hz / (1.0 - turn / (2.0 * np.pi * _PERIODS_PER_BIT))
        carrier_hz = min(max(carrier_hz, CARRIER_RANGE_HZ[0]), CARRIER_RANGE_HZ[1])
        start_s = _onset(band, start_s, carrier_hz)
    baseband, step_s, ringing = band.matched(carrier_hz)
    return _at_bits(baseband, step_s, start_s, carrier_hz), start_s, carrier_hz, ringing


def _at_bits(baseband: ComplexArray, step_s: float, start_s: FloatArray, carrier_hz: float) -> ComplexArray:
    """Baseband at each bit's onset by linear interpolation (the grid is 8 times finer than the band needs)."""
    bits_s = np.arange(MESSAGE_FRAME_BITS) * (_PERIODS_PER_BIT / carrier_hz)
    times = np.clip((start_s[:, None] + bits_s) / step_s, 0.0, baseband.shape[1] - 2.0)
    before = times.astype(np.intp)
    part = times - before
    rows = np.arange(len(baseband))[:, None]
    result: ComplexArray = baseband[rows, before] * (1.0 - part) + baseband[rows, before + 1] * part
    return result


def _phase_per_bit(values: ComplexArray, places: NDArray[np.intp], widest_rad: float) -> float:
    """The steady turn from bit to bit that adds the values up best, all receivers together."""
    grid = np.linspace(-widest_rad, widest_rad, 1025)
    for _ in range(2):
        sums = values @ np.exp(-1j * places[:, None] * grid)
        power = np.square(np.abs(sums)).sum(axis=0)
        best = float(grid[int(power.argmax())])
        spacing = grid[1] - grid[0]
        grid = np.linspace(best - spacing, best + spacing, 65)
    return best


def _onset(band: _Band, start_s: FloatArray, carrier_hz: float) -> FloatArray:
    """The onset at each receiver, within a quarter of a bit, at which its values are strongest."""
    baseband, step_s, _ = band.matched(carrier_hz)
    quarter_s = 0.25 * _PERIODS_PER_BIT / carrier_hz
    shifts_s = np.arange(-quarter_s, quarter_s, 2.0 * step_s)
    strength = np.array(
        [np.square(np.abs(_at_bits(baseband, step_s, start_s + shift, carrier_hz))).sum(axis=1) for shift in shifts_s]
    )
    onsets: FloatArray = np.maximum(0.0, start_s + shifts_s[strength.argmax(axis=0)])
    return onsets


@dataclass(frozen=True, slots=True)
class _Decision:
    ratio: FloatArray
    snr: float


def _decide(values: ComplexArray, ringing: complex) -> _Decision:
    """Log-likelihood ratio of every bit and the summed energy-to-noise ratio of a "1"."""
    known = np.full(MESSAGE_FRAME_BITS, np.nan)
    known[KNOWN_PLACES] = KNOWN_BITS
    amplitude = values[:, KNOWN_PLACES[KNOWN_BITS > 0]].mean(axis=1)
    noise = np.full(len(values), max(float(np.median(np.square(np.abs(values)))), 1e-30))
    decision = _Decision(np.zeros(MESSAGE_FRAME_BITS), 0.0)
    for _ in range(3):
        weight = np.conj(amplitude) / noise
        combined = weight @ values
        gain = float(np.sum(np.square(np.abs(amplitude)) / noise))
        decision = _Decision(_forward_backward(combined, gain, ringing), gain)
        bits = (decision.ratio > 0.0).astype(np.float64)
        bits[KNOWN_PLACES] = KNOWN_BITS
        shape = _rung(bits, ringing)
        values = values * np.exp(-1j * _slow_phase(combined, shape))
        amplitude = values @ np.conj(shape) / max(float(np.square(np.abs(shape)).sum()), 1e-30)
        rest = values - amplitude[:, None] * shape
        noise = np.maximum(np.square(np.abs(rest)).mean(axis=1), 1e-30)
    return decision


def _rung(bits: FloatArray, ringing: complex) -> ComplexArray:
    """Matched filter output for these bits at amplitude 1."""
    shape = bits.astype(np.complex128)
    shape[1:] += ringing * bits[:-1]
    shape[:-1] += np.conj(ringing) * bits[1:]
    return shape


def _slow_phase(combined: ComplexArray, shape: ComplexArray) -> FloatArray:
    """Phase of the combined signal against the decided bits, over a window: motion bends it slowly."""
    kernel = np.ones(_PHASE_WINDOW_BITS)
    track = np.convolve(combined * np.conj(shape), kernel, mode="same")
    return np.unwrap(np.angle(track))


def _forward_backward(combined: ComplexArray, gain: float, ringing: complex) -> FloatArray:
    """Log-likelihood ratios with the neighbours' ringing in the metric.

    ln p = sum_k b_k (2 Re z_k - gain) - 2 gain Re(ringing) b_k b_(k-1); states are the last bit.
    """
    single = (2.0 * combined.real - gain).tolist()
    pair = -2.0 * gain * ringing.real
    count = len(single)
    forward = [(0.0, -1e30)]  # before the frame there was silence
    for value in single:
        zero, one = forward[-1]
        forward.append((max(zero, one), value + max(zero, one + pair)))
    ratio = np.empty(count)
    after_zero, after_one = 0.0, 0.0
    for index in range(count - 1, -1, -1):
        zero, one = forward[index + 1]
        ratio[index] = one + after_one - zero - after_zero
        taken = single[index]
        after_zero, after_one = max(after_zero, taken + after_one), max(after_zero, taken + pair + after_one)
    return ratio


def _word(ratio: FloatArray) -> FloatArray:
    """The frame's most likely bits with the body as the code allows it: it is right where single bits are not."""
    bits = (ratio > 0.0).astype(np.float64)
    bits[KNOWN_PLACES] = KNOWN_BITS
    bits[BODY_START:] = decode(ratio[BODY_START:])[2]
    return bits


def _equalised(values: ComplexArray, bits: FloatArray) -> FloatArray:
    """Ratios with echoes taken out: channel of each receiver from decided bits, then the linear equaliser for it.

    The channel is least squares over lags of -1 to 8 bits; the equaliser is the minimum mean square error one for bits
    that are 0 or 1 with equal probability, over as many values of every receiver.
    """
    lags = np.arange(-1, _ECHO_BITS + 1)
    count = len(bits)
    padded = np.pad(bits, (_ECHO_BITS, 1))
    design = np.stack([padded[_ECHO_BITS - lag : _ECHO_BITS - lag + count] for lag in lags], axis=1)
    normal = design.T @ design + 1e-3 * count * np.eye(len(lags))
    channel = np.linalg.solve(normal, design.T @ values.T).T  # (receivers, lags)
    noise = np.maximum(np.square(np.abs(values - channel @ design.T)).mean(axis=1), 1e-30)
    # Stack the values at k-1 .. k+8 of every receiver: each is a sum over bits k-9 .. k+9.
    offsets = lags
    spread = np.arange(offsets[0] - _ECHO_BITS, offsets[-1] + 2)
    taps = np.zeros((len(values), len(offsets), len(spread)), np.complex128)
    for row, offset in enumerate(offsets):
        for tap, lag in enumerate(lags):
            taps[:, row, offset - lag - spread[0]] = channel[:, tap]
    mixing = taps.reshape(-1, len(spread))
    covariance = 0.25 * mixing @ mixing.conj().T + np.diag(np.repeat(noise, len(offsets)))
    wanted = mixing[:, -spread[0]]
    filter_ = np.linalg.solve(covariance, 0.25 * wanted)
    window = np.pad(values, ((0, 0), (1, _ECHO_BITS)))
    stacked = np.stack([window[:, 1 + offset : 1 + offset + count] for offset in offsets], axis=1).reshape(-1, count)
    mean = 0.5 * mixing.sum(axis=1)
    estimate = (np.conj(filter_) @ (stacked - mean[:, None])).real
    error = max(0.25 - float((np.conj(filter_) @ (0.25 * wanted)).real), 1e-6)
    ratio: FloatArray = estimate / error  # for a bit of +-0.5 about its mean, biased by (1 - 4 error)
    return ratio


def _result(
    ratio: FloatArray,
    values: ComplexArray,
    start_s: FloatArray,
    carrier_hz: float,
    snr: float,
    sync: float,
    *,
    equalised: bool,
) -> DemodulatedFrame:
    payload, corrected, _ = decode(ratio[BODY_START:])
    hard = (ratio > 0.0).astype(np.int8)
    counter = int("".join(str(bit) for bit in hard[COUNTER_PLACES]), 2)
    snr_db = 10.0 * float(np.log10(max(snr, 1e-30)))
    return DemodulatedFrame(
        payload, counter, corrected, float(start_s.min()), carrier_hz, snr_db, sync, equalised, hard
    )


def _smooth_length(count: int) -> int:
    """The next length of the form 2^n or 3 x 2^n, which the FFT likes."""
    power = 1 << (count - 1).bit_length()
    return 3 * power // 4 if count <= 3 * power // 4 else power
