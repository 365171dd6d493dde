"""What distinguishes the receivers of an array: their complex gains relative to a common one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ReceiverResponses:
    """Second-order resonances of receivers (n,), and what delay error remains after dividing by them."""

    resonance_hz: Array
    quality: Array
    delay_std_s: float
    reference_hz: float = 40_000.0
    reference_quality: float = 16.0

    @classmethod
    def identical(cls, count: int) -> ReceiverResponses:
        """Receivers known to be equal, as simulated ones can be."""
        return cls(np.full(count, 40_000.0), np.full(count, 16.0), 0.0)

    def relative(self, frequencies_hz: Array) -> ComplexArray:
        """Gains (n, b) over that of the reference."""
        own = _resonance(frequencies_hz, self.resonance_hz[:, None], self.quality[:, None])
        ratio: ComplexArray = own / _resonance(frequencies_hz, self.reference_hz, self.reference_quality)
        return ratio


def _resonance(frequencies_hz: Array, centre_hz: Array | float, quality: Array | float) -> ComplexArray:
    """1 / (1 + jQ (f/f0 - f0/f)): 1 at its centre."""
    ratio = frequencies_hz / centre_hz
    gain: ComplexArray = np.reciprocal(1.0 + 1j * (quality * (ratio - 1.0 / ratio)))
    return gain
