"""What the message's modulation can do at best, to set beside what is measured."""

from __future__ import annotations

import math

from bluerov_slam.acoustics.message.coding import DISTANCE_WEIGHTS


def bit_error_rate(energy_to_noise: float) -> float:
    """Coherent on-off keying with the threshold halfway: Q(sqrt(E/(2 N0))), E of a "1", all receivers together."""
    return 0.5 * math.erfc(math.sqrt(energy_to_noise / 2.0) / math.sqrt(2.0))


def coded_bit_error_bound(energy_to_noise: float) -> float:
    """Union bound of the bit error rate behind the soft-decision decoder (distances 10 to 18), at most 0.5.

    A path of Hamming distance d differs from the sent one by d pulses of energy E, so Q(sqrt(d E / (2 N0))).
    """
    total = sum(weight * bit_error_rate(distance * energy_to_noise) for distance, weight in DISTANCE_WEIGHTS)
    return min(0.5, total)


def energy_to_noise(snr_db: float, samples_per_bit: float, receivers: int) -> float:
    """E/N0 of a "1", all receivers together, from signal to (white) noise power per sample while ones are sent."""
    ratio: float = 10.0 ** (snr_db / 10.0)
    return ratio * samples_per_bit / 2.0 * receivers
