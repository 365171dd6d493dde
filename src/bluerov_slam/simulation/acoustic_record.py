"""The records an acoustic receiver would really take of one pulse: many draws at a time, each with its truth.

Per draw: the transmitter's drive at its own carrier, both resonances and the band-pass with this receiver set's
tolerances, every path with its delay and loss, the receivers' sampling skew, white noise, the trigger on blocks, the
truncated window, clipping and quantisation. Delays are applied to spectra, so they are exact to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.pulse_train import (
    REAL_CARRIER_HZ,
    STEPS_PER_BIT,
    ReceptionChain,
    band_pass,
    drive_spectrum,
    frame_bits,
    resonator,
    spectral_lines_hz,
)
from bluerov_slam.acoustics.recording import TriggerSettings
from bluerov_slam.simulation.acoustic_paths import Medium, Paths, Reflector, trace_paths

SAMPLE_RATE_HZ = 275.0e6 / 323  # timer of the thesis's board
_RING_S = 2.0e-3  # the resonances' time constants are 0.16 ms: 1e-5 is left after this
_CHUNK = 64
_LOWEST_HZ, _HIGHEST_HZ = 4_000.0, 300_000.0  # beyond them the filtered pulse is under 1e-6 of its peak

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Standard deviations of one receiver set's parts, relative to their nominal values."""

    receiver_resonance: float = 0.0
    receiver_q: float = 0.0
    filter_corner: float = 0.0
    gain: float = 0.0
    transmitter_resonance: float = 0.0


@dataclass(frozen=True, slots=True)
class Window:
    """Which samples make the record.

    mode "blocks": as the thesis's board takes it, from the end of the block in which the trigger saw the pulse: the
    onset is lost. "ring": the same trigger, but `pre_trigger` samples before that are kept. "onset": no trigger, the
    record starts `pre_trigger` samples before the first arrival (for tests and message records).
    The trigger looks at the clean signal, as if noise alone never tripped it, unless `trigger_on_noise`.
    """

    mode: str = "blocks"
    samples: int = 2048
    pre_trigger: int = 0
    trigger_on_noise: bool = False


@dataclass(frozen=True, slots=True)
class AcousticSetup:
    """Everything about transmitter, way, receivers and converter; figures are the simulator's own."""

    array: ReceiverArray
    sample_rate_hz: float = SAMPLE_RATE_HZ
    medium: Medium = field(default_factory=Medium)
    reflectors: tuple[Reflector, ...] = ()
    directivity: bool = False
    direct_gain: float = 1.0  # less than 1: something stands between transmitter and array, and only echoes pass
    carrier_hz: tuple[float, float] = REAL_CARRIER_HZ  # drawn evenly between them, by the receiver's clock
    bits: tuple[int, ...] | None = None  # None: a frame with a drawn message counter
    chain: ReceptionChain = field(default_factory=ReceptionChain)
    tolerances: Tolerances = field(default_factory=Tolerances)
    receiver_set: int | None = None  # seed of one set of receivers for every draw; None: a new set per draw
    snr_db: float | None = 20.0  # signal to noise power per sample inside the record, mean over receivers
    noise_counts: float = 3.0  # standard deviation, where snr_db is None
    peak_counts: float | None = 800.0  # the strongest receiver's peak, whatever the range; None: physical
    peak_counts_at_1m: float = 1800.0  # on both axes, where peak_counts is None
    window: Window = field(default_factory=Window)
    trigger: TriggerSettings = field(default_factory=TriggerSettings)
    bits_per_sample: int = 12
    quantised: bool = True


@dataclass(frozen=True, slots=True)
class SimulatedRecords:
    """Records of several draws and what is true about them.

    `toa_s` is the arrival of the drive's onset on the direct path relative to sample 0 of a receiver without skew;
    sample k of receiver i was taken at k / rate + skew_i. `triggered` is False where no block tripped (the record is
    then noise).
    """

    samples: FloatArray  # (draws, receivers, samples), counts about mid-scale; whole numbers if quantised
    sample_rate_hz: float
    toa_s: FloatArray  # (draws, receivers)
    delays_s: FloatArray  # (draws, receivers - 1): toa_0 - toa_i
    snr_db: FloatArray  # (draws, receivers)
    carrier_hz: FloatArray  # (draws,)
    bits: NDArray[np.int8]  # (draws, bits)
    trigger_index: int  # first sample after the block that tripped
    triggered: NDArray[np.bool_]
    clipped: NDArray[np.bool_]  # (draws, receivers)
    sources_m: FloatArray  # (draws, 3)
    receiver_hz: FloatArray  # (draws, receivers): the resonances this draw had


@dataclass(frozen=True, slots=True)
class SimulatedRecord:
    """One record and what is true about it; fields as in `SimulatedRecords` without the draw."""

    samples: FloatArray
    sample_rate_hz: float
    toa_s: FloatArray
    delays_s: FloatArray
    snr_db: FloatArray
    carrier_hz: float
    bits: tuple[int, ...]
    trigger_index: int
    triggered: bool
    source_m: FloatArray


def simulate_record(setup: AcousticSetup, source_m: Sequence[float] | FloatArray, seed: int) -> SimulatedRecord:
    """One draw; `source_m` is in the array's frame."""
    many = simulate_records(setup, np.asarray(source_m, np.float64)[None], seed)
    return SimulatedRecord(
        many.samples[0],
        many.sample_rate_hz,
        many.toa_s[0],
        many.delays_s[0],
        many.snr_db[0],
        float(many.carrier_hz[0]),
        tuple(int(bit) for bit in many.bits[0]),
        many.trigger_index,
        bool(many.triggered[0]),
        many.sources_m[0],
    )


def simulate_records(setup: AcousticSetup, sources_m: FloatArray, seed: int) -> SimulatedRecords:
    """One record per source (draws, 3) of the array's frame."""
    sources_m = np.asarray(sources_m, np.float64)
    rng = np.random.default_rng([seed, 0xAC0])
    chunks = [_simulate(setup, sources_m[at : at + _CHUNK], rng) for at in range(0, len(sources_m), _CHUNK)]
    if len(chunks) == 1:
        return chunks[0]
    return SimulatedRecords(
        samples=np.concatenate([c.samples for c in chunks]),
        sample_rate_hz=setup.sample_rate_hz,
        toa_s=np.concatenate([c.toa_s for c in chunks]),
        delays_s=np.concatenate([c.delays_s for c in chunks]),
        snr_db=np.concatenate([c.snr_db for c in chunks]),
        carrier_hz=np.concatenate([c.carrier_hz for c in chunks]),
        bits=np.concatenate([c.bits for c in chunks]),
        trigger_index=chunks[0].trigger_index,
        triggered=np.concatenate([c.triggered for c in chunks]),
        clipped=np.concatenate([c.clipped for c in chunks]),
        sources_m=sources_m,
        receiver_hz=np.concatenate([c.receiver_hz for c in chunks]),
    )


@dataclass(frozen=True, slots=True)
class _Parts:
    """The drawn parts of some draws: transmitter (d, 1, 1), receivers (d, n, 1)."""

    transducer_hz: FloatArray
    receiver_hz: FloatArray
    receiver_q: FloatArray
    low_hz: FloatArray
    high_hz: FloatArray
    gain: FloatArray


def _simulate(setup: AcousticSetup, sources_m: FloatArray, rng: np.random.Generator) -> SimulatedRecords:
    draws, receivers = len(sources_m), len(setup.array.positions_m)
    rate_hz = setup.sample_rate_hz
    carrier_hz = rng.uniform(*setup.carrier_hz, draws)
    bits = _draw_bits(setup, draws, rng)
    parts = _draw_parts(setup, draws, rng)
    paths = trace_paths(setup.array.positions_m, sources_m, setup.medium, setup.reflectors, setup.directivity)
    paths.amplitude[:, 0] *= setup.direct_gain
    first_s = paths.delay_s[:, 0].min(axis=1)
    # The stream starts so that the first arrival falls anywhere within a block, after a few blocks of quiet.
    block = setup.trigger.block_samples
    lead = block * (-(-setup.window.pre_trigger // block) + 2) + block * rng.uniform(0.0, 1.0, draws)
    start_s = first_s - lead / rate_hz
    stream = _stream_samples(setup, paths, lead)
    clean = _clean(setup, carrier_hz, bits, parts, paths, start_s, stream)
    clean *= _level(setup, clean)[:, None, None]
    begin, triggered = _first_samples(setup, clean, lead, rng)
    rows = begin[:, None, None] + np.arange(setup.window.samples)
    record = np.take_along_axis(clean, np.broadcast_to(rows, (draws, receivers, setup.window.samples)), axis=2)
    power = np.mean(np.square(record), axis=2)
    if setup.snr_db is None:
        noise_counts = np.full(draws, setup.noise_counts)
    else:
        noise_counts = np.sqrt(power.mean(axis=1)) * 10.0 ** (-setup.snr_db / 20.0)
    record += noise_counts[:, None, None] * rng.standard_normal(record.shape)
    record, clipped = _convert(setup, record)
    toa_s = paths.delay_s[:, 0] - start_s[:, None] - begin[:, None] / rate_hz
    with np.errstate(divide="ignore"):
        snr_db = 10.0 * np.log10(power / np.maximum(np.square(noise_counts), 1e-30)[:, None])
    return SimulatedRecords(
        samples=record,
        sample_rate_hz=rate_hz,
        toa_s=toa_s,
        delays_s=toa_s[:, :1] - toa_s[:, 1:],
        snr_db=snr_db,
        carrier_hz=carrier_hz,
        bits=bits,
        trigger_index=setup.window.pre_trigger,
        triggered=triggered,
        clipped=clipped,
        sources_m=sources_m,
        receiver_hz=np.broadcast_to(parts.receiver_hz[:, :, 0], (draws, receivers)).copy(),
    )


def _draw_bits(setup: AcousticSetup, draws: int, rng: np.random.Generator) -> NDArray[np.int8]:
    if setup.bits is not None:
        return np.tile(np.array(setup.bits, np.int8), (draws, 1))
    return np.array([frame_bits(int(counter)) for counter in rng.integers(0, 256, draws)], np.int8)


def _draw_parts(setup: AcousticSetup, draws: int, rng: np.random.Generator) -> _Parts:
    receivers = len(setup.array.positions_m)
    chain, tolerances = setup.chain, setup.tolerances
    sets = draws
    transmitter = rng.standard_normal((draws, 1, 1))
    if setup.receiver_set is not None:
        rng, sets = np.random.default_rng([setup.receiver_set, 0x5E7]), 1
        transmitter = rng.standard_normal((1, 1, 1))
    spread = np.clip(rng.standard_normal((5, sets, receivers, 1)), -2.5, 2.5)
    return _Parts(
        transducer_hz=chain.transducer_hz * (1.0 + tolerances.transmitter_resonance * np.clip(transmitter, -2.5, 2.5)),
        receiver_hz=chain.receiver_hz * (1.0 + tolerances.receiver_resonance * spread[0]),
        receiver_q=chain.receiver_q * (1.0 + tolerances.receiver_q * spread[1]),
        low_hz=chain.band_low_hz * (1.0 + tolerances.filter_corner * spread[2]),
        high_hz=chain.band_high_hz * (1.0 + tolerances.filter_corner * spread[3]),
        gain=np.maximum(1.0 + tolerances.gain * spread[4], 0.05),
    )


def _stream_samples(setup: AcousticSetup, paths: Paths, lead: FloatArray) -> int:
    """How long a stream must be for the record to lie inside it, whenever the trigger may trip."""
    spread_s = float((paths.delay_s[:, 0].max(axis=1) - paths.delay_s[:, 0].min(axis=1)).max())
    # On its last chance the trigger sees the fourth bit of the latest receiver.
    wait_s = 0.0 if setup.window.mode == "onset" else spread_s + 4 * STEPS_PER_BIT * 0.5 / setup.carrier_hz[0]
    tail = setup.window.samples + 2 * setup.trigger.block_samples
    return int(np.ceil(lead.max() + wait_s * setup.sample_rate_hz)) + tail


def _clean(
    setup: AcousticSetup,
    carrier_hz: FloatArray,
    bits: NDArray[np.int8],
    parts: _Parts,
    paths: Paths,
    start_s: FloatArray,
    stream: int,
) -> FloatArray:
    """The noise-free stream (draws, receivers, stream) for a drive of amplitude 1 at 1 m; not yet in counts."""
    rate_hz = setup.sample_rate_hz
    latest_s = float((paths.delay_s.max(axis=(1, 2)) - start_s).max())
    bit_s = STEPS_PER_BIT * 0.5 / setup.carrier_hz[0]
    heard = min(bits.shape[1], max(1, int(np.ceil(stream / rate_hz / bit_s)) + 1))
    # Bits that begin after the stream's end need not be made; what is made must not wrap around into its quiet start.
    length = _fast_length(max(stream, int(np.ceil((latest_s + heard * bit_s + _RING_S) * rate_hz))))
    frequency_hz = spectral_lines_hz(length, rate_hz)
    low, high = np.searchsorted(frequency_hz, (_LOWEST_HZ, min(_HIGHEST_HZ, 0.5 * rate_hz)))
    band_hz = frequency_hz[low:high]
    drive = np.stack(
        [
            drive_spectrum(band_hz, np.array([0.5 / hz]), row[:heard].tolist())[0]
            for hz, row in zip(carrier_hz, bits, strict=True)
        ]
    )
    drive = drive * resonator(band_hz, parts.transducer_hz[:, 0], setup.chain.transducer_q)
    front_end = (
        parts.gain
        * resonator(band_hz, parts.receiver_hz, parts.receiver_q)
        * band_pass(band_hz, parts.low_hz, parts.high_hz)
    )
    # Receiver i samples skew later, so its wave stands that much earlier in its record.
    delay_s = paths.delay_s - start_s[:, None, None] - setup.array.sample_skew_s
    spectrum = np.zeros((len(bits), delay_s.shape[2], len(frequency_hz)), np.complex128)
    way = np.zeros((len(bits), delay_s.shape[2], len(band_hz)), np.complex128)
    for path in range(delay_s.shape[1]):
        way += paths.amplitude[:, path, :, None] * _delay_phase(band_hz, delay_s[:, path])
    spectrum[:, :, low:high] = rate_hz * drive[:, None, :] * front_end * way
    result: FloatArray = np.fft.irfft(spectrum, length, axis=2)[:, :, :stream]
    return result


def _delay_phase(band_hz: FloatArray, delay_s: FloatArray) -> NDArray[np.complex128]:
    """exp(-j 2 pi f tau) for evenly spaced f (n,): (..., n), by squaring up from one step."""
    count, step_hz = len(band_hz), band_hz[1] - band_hz[0]
    result = np.empty((*delay_s.shape, count), np.complex128)
    result[..., 0] = np.exp(-2j * np.pi * band_hz[0] * delay_s)
    done = 1
    while done < count:
        more = min(done, count - done)
        turn = np.exp(-2j * np.pi * done * step_hz * delay_s)
        np.multiply(result[..., :more], turn[..., None], out=result[..., done : done + more])
        done += more
    return result


def _level(setup: AcousticSetup, clean: FloatArray) -> FloatArray:
    """Counts per unit of the clean stream, per draw."""
    if setup.peak_counts is not None:
        strongest: FloatArray = setup.peak_counts / np.maximum(np.abs(clean).max(axis=(1, 2)), 1e-300)
        return strongest
    return np.full(len(clean), setup.peak_counts_at_1m / _peak_at_1m(setup))


def _peak_at_1m(setup: AcousticSetup) -> float:
    """Peak of the nominal chain's output to a drive of amplitude 1 at the middle of the carriers."""
    length = 1 << 13
    # At the board's rate, whatever the record's: 21 samples per period find the peak.
    frequency_hz = spectral_lines_hz(length, SAMPLE_RATE_HZ)
    step_s = np.array([0.5 / (0.5 * sum(setup.carrier_hz))])
    spectrum = drive_spectrum(frequency_hz, step_s, (1, 1, 1, 1))[0] * setup.chain.response(frequency_hz)
    return float(np.abs(np.fft.irfft(SAMPLE_RATE_HZ * spectrum, length)).max())


def _first_samples(
    setup: AcousticSetup, clean: FloatArray, lead: FloatArray, rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Where each record starts in its stream (draws,), and whether the trigger tripped."""
    window, trigger = setup.window, setup.trigger
    draws, receivers, stream = clean.shape
    if window.mode == "onset":
        return (np.floor(lead) - window.pre_trigger).astype(np.intp), np.ones(draws, np.bool_)
    block = trigger.block_samples
    last = stream - window.samples  # a record may not start later
    blocks = last // block
    looked_at = clean[:, :, : blocks * block]
    if window.trigger_on_noise:
        looked_at = looked_at + setup.noise_counts * rng.standard_normal(looked_at.shape)
    tripped = trigger.tripped(looked_at.reshape(draws, receivers, blocks, block))
    triggered: NDArray[np.bool_] = np.any(tripped, axis=1)
    at = np.where(triggered, tripped.argmax(axis=1), -(-window.pre_trigger // block))
    begin = (at + 1) * block - (window.pre_trigger if window.mode == "ring" else 0)
    return np.maximum(begin, 0).astype(np.intp), triggered


def _convert(setup: AcousticSetup, counts: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """What the ADC makes of it, about mid-scale, and which receivers of which draw it clipped."""
    half = 1 << (setup.bits_per_sample - 1)
    clipped = (counts.max(axis=2) > half - 1) | (counts.min(axis=2) < -half)
    if not setup.quantised:
        return counts, clipped
    return np.clip(np.rint(counts), -half, half - 1), clipped


def _fast_length(least: int) -> int:
    """The smallest 2^a 3^b 5^c that is not under this, even."""
    best = 1 << (least - 1).bit_length()
    for five in (1, 5, 25, 125):
        for three in (1, 3, 9, 27):
            length = 2 * five * three
            while length < least:
                length *= 2
            best = min(best, length)
    return best
