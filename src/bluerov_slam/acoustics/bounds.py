"""The least variance of time differences, direction and position that any unbiased estimate can reach.

The pulse s is unknown; receiver i hears a_i s(t - t_i) in white noise of variance n_i. With w_i = a_i^2 / n_i and E the
energy of the pulse's derivative, the information about the arrivals t_i is

    J_ij = E (delta_ij w_i - w_i w_j / sum w),

singular for a common shift; that of delays to a reference leaves the reference's row and column out. For two equal
receivers the variance is 2 n / E. Delays are the only thing about the place that the records tell, so direction and
position follow by the chain rule. Source: Cramer-Rao; Knapp and Carter (1976), doi:10.1109/TASSP.1976.1162830, for two.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def delay_covariance(derivative_energy: Array, noise_variance: Array) -> Array:
    """Least covariance (n-1, n-1) of delays to receiver 0.

    Args:
        derivative_energy: (n,) energy of the derivative of what each receiver hears, unit^2 / s.
        noise_variance: (n,) in the same measure: unit^2 per sample for sums over samples.
    """
    weight = np.asarray(derivative_energy) / np.asarray(noise_variance)
    information = np.diag(weight) - np.outer(weight, weight) / weight.sum()
    covariance: Array = np.linalg.inv(information[1:, 1:])
    return covariance


def derivative_energy(clean: Array, sample_rate_hz: float) -> Array:
    """Sum over the samples of the squared derivative (n,) of noise-free records (n, samples), per second squared.

    The derivative is taken in the time domain by a central difference of the exact sine: records may end anywhere.
    """
    before, after = clean[:, :-2], clean[:, 2:]
    # A central difference of a wave at 40 kHz is short by sin(x)/x, x = 2 pi f / rate; put right at the mean frequency.
    slope = 0.5 * (after - before) * sample_rate_hz
    middle = clean[:, 1:-1]
    power = np.maximum(np.sum(middle**2, axis=1), 1e-300)
    x = np.arcsin(np.clip(np.sqrt(np.sum(slope**2, axis=1) / power) / sample_rate_hz, 0.0, 1.0))
    scale = np.where(x > 1e-6, x / np.sin(np.maximum(x, 1e-6)), 1.0)
    total: Array = np.sum(slope**2, axis=1) * scale**2 * clean.shape[1] / (clean.shape[1] - 2)
    return total


def record_delay_covariance(clean: Array, arrivals_s: Array, sample_rate_hz: float, noise_std: float) -> Array:
    """Least covariance (n-1, n-1) of delays to receiver 0 from records that are cut off.

    What only one record holds of an unknown pulse says nothing about delays; here that is counted out sample by sample.

    Args:
        clean: Noise-free records (n, samples), receivers of equal response.
        arrivals_s: (n,) of the pulse, on any common clock.
    """
    count, length = clean.shape
    late = np.rint((arrivals_s - arrivals_s.min()) * sample_rate_hz).astype(np.intp)
    scale = derivative_energy(clean, sample_rate_hz)
    power = np.gradient(clean, axis=1) ** 2
    power *= (scale / power.sum(axis=1))[:, None]
    # Sample k of receiver i holds the pulse's instant k - late_i, the latest receiver's first sample being the first.
    first = int(late.max())
    heard = np.zeros((count, length + first))
    covers = np.zeros((count, length + first), dtype=bool)
    for row in range(count):
        begin = first - int(late[row])
        heard[row, begin : begin + length] = power[row]
        covers[row, begin : begin + length] = True
    weight = scale / scale.mean()  # unequal gains
    common = heard.sum(axis=0) / np.maximum((weight[:, None] * covers).sum(axis=0), 1e-300)
    seen = weight[:, None] * covers
    total = np.maximum(seen.sum(axis=0), 1e-300)
    information = np.diag((seen * common).sum(axis=1)) - np.einsum("ik,jk,k->ij", seen, seen, common / total)
    covariance: Array = np.linalg.inv(information[1:, 1:]) * noise_std**2
    return covariance


def pair_timing_std_s(clean: ArrayLike, sample_rate_hz: float, noise_std: float) -> float:
    """Least standard deviation of the delay between two receivers that both hear the record (samples,) `clean`."""
    energy = derivative_energy(np.asarray(clean, dtype=np.float64)[None], sample_rate_hz)[0]
    return float(np.sqrt(2.0 * noise_std**2 / energy))


def direction_covariance(receivers_m: Array, covariance_s2: Array, sound_speed_mps: float, direction: Array) -> Array:
    """Least covariance (3, 3) of a far source's unit direction; delays to the first receiver. Singular along it."""
    slopes = (receivers_m[1:] - receivers_m[0]) / sound_speed_mps
    across = _across(np.asarray(direction, dtype=np.float64))
    reduced = slopes @ across
    information = reduced.T @ np.linalg.solve(covariance_s2, reduced)
    covariance: Array = across @ np.linalg.inv(information) @ across.T
    return covariance


def position_covariance(
    receivers_m: Array,
    covariance_s2: Array,
    sound_speed_mps: float,
    source_m: ArrayLike,
    depth_std_m: float,
    down: ArrayLike = (0.0, 0.0, 1.0),
) -> Array:
    """Least covariance (3, 3) of a source whose depth along `down` is known with a standard deviation (0: exactly)."""
    source = np.asarray(source_m, dtype=np.float64)
    axis = np.asarray(down, dtype=np.float64)
    away = source - receivers_m
    units = away / np.linalg.norm(away, axis=1, keepdims=True)
    slopes = (units[0] - units[1:]) / sound_speed_mps  # d delay_i / d source
    information = slopes.T @ np.linalg.solve(covariance_s2, slopes)
    across = _across(axis)
    plane = np.linalg.inv(across.T @ information @ across)
    # A depth error moves the others along the line that keeps the delays: the regression of the plane on the depth.
    follows = axis - across @ (plane @ (across.T @ information @ axis))
    left = float(follows @ information @ follows)
    variance = depth_std_m**2 / (1.0 + depth_std_m**2 * left)
    covariance: Array = across @ plane @ across.T + variance * np.outer(follows, follows)
    return covariance


def _across(direction: Array) -> Array:
    """Two unit vectors (3, 2) across a unit vector."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, other)
    first /= np.linalg.norm(first)
    return np.column_stack((first, np.cross(direction, first)))
