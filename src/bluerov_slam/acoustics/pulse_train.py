"""What the transmitter sends, and what a receiver makes of it.

The driver plays a list of steps, each half a carrier period long: +1 and -1 are the two polarities of the full bridge,
0 has both leads at the same level, which brakes the transducer. A "1" is 40 steps: 5 cycles, a braked step, 6 cycles, a
braked step, 3 cycles, 10 braked steps; the single braked steps turn the phase of the following burst, so that each
burst works against the ringing of the one before (active damping). A "0" is 40 braked steps. A frame is 1 1 1 1 0 0 and
8 bits of a message counter, most significant first.

The thesis's program fills its step list from a bit list of 16 entries into a buffer of 14 x 40 steps and so writes 80
steps past its end each second; here the list is exactly as long as the bits need.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

STEPS_PER_BIT = 40
HEADER_BITS = (1, 1, 1, 1, 0, 0)
COUNTER_BITS = 8
FRAME_BITS = len(HEADER_BITS) + COUNTER_BITS
NOMINAL_STEP_S = 990 / 80.0e6  # timer reload of the thesis's program; 40.404 kHz
REAL_CARRIER_HZ = (
    39_750.0,
    39_900.0,
)  # its oscillator is slow: what the logged pulse periods say, by the receiver's clock

_BURSTS = ((5, 1), (6, 1), (3, 10))  # cycles, braked steps after them

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def frame_bits(counter: int) -> tuple[int, ...]:
    """The 14 bits of a frame that carries this message counter (0 to 255)."""
    if not 0 <= counter < 1 << COUNTER_BITS:
        raise ValueError(f"message counter {counter}, expected 0 to 255")
    return HEADER_BITS + tuple(counter >> shift & 1 for shift in reversed(range(COUNTER_BITS)))


def one_bit_steps() -> NDArray[np.int8]:
    """The 40 drive steps of a "1"."""
    steps: list[int] = []
    for cycles, braked in _BURSTS:
        steps += [1, -1] * cycles + [0] * braked
    return np.array(steps, np.int8)


def drive_steps(bits: Sequence[int]) -> NDArray[np.int8]:
    """The whole drive sequence of these bits: 40 steps of -1, 0 or +1 per bit, and not one more."""
    steps = np.zeros((len(bits), STEPS_PER_BIT), np.int8)
    steps[np.asarray(bits, np.int8) != 0] = one_bit_steps()
    return steps.reshape(-1)


@dataclass(frozen=True, slots=True)
class PulseTrain:
    """Bits, and how long one drive step really lasts by the clock of whoever listens."""

    bits: tuple[int, ...]
    step_s: float = NOMINAL_STEP_S

    @classmethod
    def at_carrier(cls, bits: Sequence[int], carrier_hz: float) -> PulseTrain:
        """A pulse train whose carrier comes out at this frequency: two steps are one period."""
        return cls(tuple(bits), 0.5 / carrier_hz)

    @property
    def carrier_hz(self) -> float:
        """Two steps are one period."""
        return 0.5 / self.step_s

    @property
    def bit_s(self) -> float:
        """One bit."""
        return STEPS_PER_BIT * self.step_s

    @property
    def duration_s(self) -> float:
        """All bits, from the first step's start to the last step's end."""
        return len(self.bits) * self.bit_s

    def spectrum(self, frequency_hz: FloatArray) -> ComplexArray:
        """Fourier transform of the drive (amplitude 1, starts at time 0), in seconds, at these frequencies (n,)."""
        result: ComplexArray = drive_spectrum(frequency_hz, np.array([self.step_s]), self.bits)[0]
        return result


@dataclass(frozen=True, slots=True)
class ReceptionChain:
    """Resonances and filter between the drive and the ADC, each of gain 1 at its centre (the band-pass has 0.52).

    Transducer and receiver are second-order resonators 1 / (1 + jQ(f/f0 - f0/f)); the band-pass has one pole at each
    corner. Its inversion is left out: it is the same for every receiver.
    """

    transducer_hz: float = 40_000.0
    transducer_q: float = 20.0
    receiver_hz: float = 40_000.0
    receiver_q: float = 16.0
    band_low_hz: float = 38_100.0
    band_high_hz: float = 41_300.0

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Complex gain at these frequencies; 0 at frequency 0."""
        result: ComplexArray = (
            resonator(frequency_hz, self.transducer_hz, self.transducer_q)
            * resonator(frequency_hz, self.receiver_hz, self.receiver_q)
            * band_pass(frequency_hz, self.band_low_hz, self.band_high_hz)
        )
        return result


@dataclass(frozen=True, slots=True)
class PulseTemplate:
    """The noise-free waveform a receiver puts out, peak 1; sample 0 is the instant the drive's onset arrives."""

    samples: FloatArray
    sample_rate_hz: float
    train: PulseTrain
    chain: ReceptionChain = field(default_factory=ReceptionChain)


def pulse_template(
    train: PulseTrain, sample_rate_hz: float, chain: ReceptionChain | None = None, ring_s: float = 1.5e-3
) -> PulseTemplate:
    """The received waveform of a pulse train, `ring_s` longer than its drive, so that the resonances die out."""
    chain = chain or ReceptionChain()
    count = int(np.ceil((train.duration_s + ring_s) * sample_rate_hz))
    length = 1 << (count + int(1.5e-3 * sample_rate_hz)).bit_length()
    frequency_hz = spectral_lines_hz(length, sample_rate_hz)
    spectrum: ComplexArray = train.spectrum(frequency_hz) * chain.response(frequency_hz)
    wave = np.fft.irfft(spectrum, length)[:count]
    return PulseTemplate(wave / np.abs(wave).max(), sample_rate_hz, train, chain)


def drive_spectrum(frequency_hz: FloatArray, step_s: FloatArray, bits: Sequence[int]) -> ComplexArray:
    """Spectra of the same bits driven at several step lengths: (d, n) from (n,) frequencies and (d,) steps.

    A step is a rectangle of height d_k from kT to (k+1)T: D(f) = T sinc(fT) exp(-j pi f T) sum_k d_k z^k with
    z = exp(-j 2 pi f T); the sum over a bit is a polynomial in z, the sum over bits one in z^40.
    """
    step = np.asarray(step_s, np.float64)[:, None]
    product = frequency_hz[None, :] * step
    z = np.exp(-2j * np.pi * product)
    one = _polynomial(z, one_bit_steps().tolist())
    frame = _polynomial(z**STEPS_PER_BIT, list(bits))
    result: ComplexArray = step * np.sinc(product) * np.exp(-1j * np.pi * product) * one * frame
    return result


def spectral_lines_hz(length: int, sample_rate_hz: float) -> FloatArray:
    """The frequencies of a real FFT of this many samples."""
    return np.arange(length // 2 + 1, dtype=np.float64) * (sample_rate_hz / length)


def resonator(frequency_hz: FloatArray, centre_hz: FloatArray | float, q: FloatArray | float) -> ComplexArray:
    """Second-order resonator of gain 1 at its centre; arguments broadcast."""
    # f0 f / (f0 f + jQ(f^2 - f0^2)) is the same as the usual form, and defined at f = 0.
    scaled = centre_hz * frequency_hz
    detuned = q * (frequency_hz**2 - np.square(centre_hz))
    result: ComplexArray = np.divide(scaled, scaled + 1j * detuned)
    return result


def band_pass(frequency_hz: FloatArray, low_hz: FloatArray | float, high_hz: FloatArray | float) -> ComplexArray:
    """One high-pass pole and one low-pass pole, each of unit gain far inside; arguments broadcast."""
    rising = 1j * frequency_hz / low_hz
    result: ComplexArray = rising / ((1.0 + rising) * (1.0 + 1j * frequency_hz / high_hz))
    return result


def _polynomial(z: ComplexArray, coefficients: Sequence[float]) -> ComplexArray:
    """Sum of c_k z^k by Horner's rule."""
    total: ComplexArray = np.zeros_like(z)
    for coefficient in reversed(coefficients):
        total *= z
        total += coefficient
    return total
