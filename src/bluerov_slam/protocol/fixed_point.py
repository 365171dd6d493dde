"""Numbers on the wire: rounding half away from zero, saturation instead of wrapping."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

U8_MAX = 0xFF
U16_MAX = 0xFFFF
U24_MAX = 0xFFFFFF
U32_MAX = 0xFFFFFFFF
I16_MIN, I16_MAX = -0x8000, 0x7FFF
I32_MIN, I32_MAX = -0x80000000, 0x7FFFFFFF


def round_half_away(value: float) -> int:
    """The nearest integer, halves away from zero (Python's own `round` takes them to the even side)."""
    return math.floor(value + 0.5) if value >= 0 else -math.floor(0.5 - value)


def saturated(value: float, minimum: int, maximum: int) -> int:
    """`value` in wire counts, rounded and kept inside the field's range; infinities saturate too."""
    if value >= maximum:
        return maximum
    if value <= minimum:
        return minimum
    return round_half_away(value)


def is_position_e7(latitude_e7: int, longitude_e7: int) -> bool:
    """Whether 1e-7 degrees name a place on Earth; 0 N 0 E is what a receiver without a fix leaves behind."""
    on_earth = abs(latitude_e7) <= 900_000_000 and abs(longitude_e7) <= 1_800_000_000
    return on_earth and bool(latitude_e7 or longitude_e7)


def saturated_i16(values: NDArray[np.float64]) -> NDArray[np.int16]:
    """`saturated` for an array of signed 16-bit counts."""
    rounded = np.copysign(np.floor(np.abs(values) + 0.5), values)
    return np.clip(rounded, I16_MIN, I16_MAX).astype(np.int16)
