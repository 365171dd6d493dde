"""The chi-square distribution: what squared, normalised errors follow when the stated covariances are right."""

from __future__ import annotations

import math
from functools import cache


def chi_square_cdf(value: float, dof: float) -> float:
    """Probability that a chi-square variable of `dof` degrees of freedom is at most `value`."""
    if not dof > 0.0:
        raise ValueError(f"degrees of freedom {dof}, expected above 0")
    return _lower_gamma_ratio(0.5 * dof, 0.5 * value) if value > 0.0 else 0.0


@cache
def chi_square_quantile(probability: float, dof: float) -> float:
    """The value a chi-square variable stays below with this probability. Check: 0.95, 3 -> 7.8147."""
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability {probability}, expected between 0 and 1")
    low, high = 0.0, max(1.0, 2.0 * dof)
    while chi_square_cdf(high, dof) < probability:
        low, high = high, 2.0 * high
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if chi_square_cdf(middle, dof) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _lower_gamma_ratio(a: float, x: float) -> float:
    """Regularised lower incomplete gamma function P(a, x).

    Source: Abramowitz and Stegun (1964), 6.5.29 (series) and 6.5.31 (continued fraction, by Lentz's method).
    """
    scale = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        n = a
        while term > total * 1e-17:
            n += 1.0
            term *= x / n
            total += term
        return min(1.0, scale * total)
    b = x + 1.0 - a
    c, d = 1e300, 1.0 / b
    fraction = d
    for i in range(1, 10_000):
        numerator = -i * (i - a)
        b += 2.0
        d = 1.0 / (numerator * d + b)
        c = b + numerator / c
        step = c * d
        fraction *= step
        if abs(step - 1.0) < 1e-15:
            break
    return 1.0 - scale * fraction
