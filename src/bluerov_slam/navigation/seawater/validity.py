"""How every formula of this package answers: numbers or arrays, and nothing outside its published range."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import OutOfValidityError

PA_PER_DBAR = 1e4
PA_PER_BAR = 1e5
T68_PER_T90 = 1.00024
"""Formulas of before 1990 want IPTS-68: Saunders (1990), good to 0.5 mK below 40 degC."""

Value = TypeVar("Value", float, NDArray[np.float64])
"""One number, or an array of them; all arguments of one call are of one kind."""


def within(name: str, value: Value, low: float, high: float, unit: str) -> Value:
    """The value where it lies in the range; elsewhere an array gets NaN and a single number is refused."""
    if isinstance(value, np.ndarray):
        return np.where((value >= low) & (value <= high), value, np.nan)
    if not low <= value <= high:
        raise OutOfValidityError(f"{name} {value:.6g} {unit}, the formula is valid for {low:g}..{high:g}")
    return value


def polynomial(x: Value, *coefficients: Value | float) -> Value:
    """Horner's rule, the constant term first."""
    value: Value = x * 0.0
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value


def square_root(x: Value) -> Value:
    """Of a number or an array."""
    return np.sqrt(x) if isinstance(x, np.ndarray) else math.sqrt(x)


def not_below_zero(x: Value) -> Value:
    """Negative values become 0, NaN stays."""
    return np.maximum(x, 0.0) if isinstance(x, np.ndarray) else max(0.0, x)
