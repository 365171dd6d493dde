"""What a session adds to its fixes: a bias that depends on the attitude, and a liking for some cells of the lattice.

Found from fixes whose truth is known, by expectation and maximisation (EM): each fix belongs to the cells as far as
they explain it; bias, cell probabilities and noise within a cell are then those of the fixes so assigned. The bias is
mostly yaw: one sample of the magnetometer sets the session's zero, and near servos and currents it depends on how the
array is turned. A polynomial of roll, pitch and yaw in each axis holds that.

Shifting all cells by one and the bias back is the same model; it begins at a robust fit, so the bias stays next to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bluerov_slam.acoustics.slip_lattice import Cells, Floats

LEVELS = (0, 1, 2)
"""Constant bias; linear in roll, pitch and yaw; with their squares."""

_SCALE_DEG = np.array([20.0, 10.0, 10.0])
_RIDGE = 1.0
"""As if one more fix had said that the coefficients beyond the constant are zero, with the noise of a fix."""
_HUBER_MM = 30.0
_HUBER_STEPS = 30
_EM_STEPS = 30
_TAIL_MM = 40.0
"""Cells are thought rarer by 1/e at this distance before any fix was seen, with the weight of so many fixes: """
_PRIOR_FIXES = 30.0
_OUTLIER_SD_MM = 120.0
_OUTLIERS = (0.005, 0.3)
_FIRST_OUTLIERS = 0.05
FIRST_SD = (0.0075, 0.003)
"""Noise within a cell per range (y with the yaw's wobble, z), before any fix was seen."""
_LEAST_SD_MM = np.array([1.0, 0.8])


@dataclass(frozen=True, slots=True)
class SessionCalibration:
    """Coefficients of the bias, (terms, 2), and the cells' probabilities with the noise within one."""

    coefficients_mm: Floats
    probability: Floats
    sd_mm: tuple[float, float]

    def bias_mm(self, attitude_deg: Floats) -> Floats:
        """Of fixes at these attitudes, (n, 2)."""
        level = {1: 0, 4: 1, 7: 2}[len(self.coefficients_mm)]
        return np.asarray(attitude_terms(attitude_deg, level) @ self.coefficients_mm)

    def cells(self, at_mm: Floats) -> Cells:
        return Cells(at_mm, self.probability, self.sd_mm)


def attitude_terms(attitude_deg: Floats, level: int) -> Floats:
    """(n, 1, 4 or 7): one, then roll, pitch, yaw, then their squares, each of the order of one."""
    scaled = attitude_deg / _SCALE_DEG
    return np.hstack([np.ones((len(scaled), 1)), scaled, scaled**2][: level + 1])


def prior_probability(cells_mm: Floats, tail_mm: float = _TAIL_MM) -> Floats:
    """Nearer cells are likelier; nothing else is known."""
    weight = np.exp(-np.linalg.norm(cells_mm, axis=1) / tail_mm)
    return np.asarray(weight / weight.sum())


def calibrate_session(
    error_mm: Floats, attitude_deg: Floats, cells_mm: Floats, range_mm: float, level: int
) -> SessionCalibration:
    """From fixes less truth (n, 2)."""
    terms = attitude_terms(attitude_deg, level)
    penalty = np.diag([0.0] + [_RIDGE] * (terms.shape[1] - 1))
    coefficients = np.stack([_huber(terms, error_mm[:, axis], penalty) for axis in (0, 1)], axis=1)
    prior = prior_probability(cells_mm)
    probability, outliers = prior, _FIRST_OUTLIERS
    sd: Floats = np.array(FIRST_SD) * range_mm
    for _ in range(_EM_STEPS):
        weight, outliers = _memberships(error_mm - terms @ coefficients, cells_mm, probability, sd, outliers)
        counts = weight.sum(axis=0) + _PRIOR_FIXES * prior
        probability = counts / counts.sum()
        share = weight.sum(axis=1)
        aim = error_mm - (weight @ cells_mm) / np.maximum(share, 1e-9)[:, None]
        weighted = terms * share[:, None]
        coefficients = np.linalg.solve(weighted.T @ terms + penalty, weighted.T @ aim)
        within = (error_mm - terms @ coefficients)[:, None, :] - cells_mm
        sd = np.sqrt(np.einsum("nk,nka->a", weight, within**2) / share.sum())
        sd = np.maximum(sd, _LEAST_SD_MM)
    return SessionCalibration(coefficients, probability, (float(sd[0]), float(sd[1])))


def _memberships(
    residual_mm: Floats, cells_mm: Floats, probability: Floats, sd_mm: Floats, outliers: float
) -> tuple[Floats, float]:
    """How far each fix belongs to each cell (n, K), and the share that belongs to none."""
    within = (residual_mm[:, None, :] - cells_mm) / sd_mm
    inside = np.log(probability) - 0.5 * np.sum(within**2, axis=2)
    inside += math.log1p(-outliers) - math.log(sd_mm[0] * sd_mm[1])
    outside = math.log(outliers) - 0.5 * np.sum((residual_mm / _OUTLIER_SD_MM) ** 2, axis=1)
    outside -= 2.0 * math.log(_OUTLIER_SD_MM)
    most = np.maximum(inside.max(axis=1), outside)
    weight, weight_out = np.exp(inside - most[:, None]), np.exp(outside - most)
    total = weight.sum(axis=1) + weight_out
    return weight / total[:, None], float(np.clip(np.mean(weight_out / total), *_OUTLIERS))


def _huber(terms: Floats, values: Floats, penalty: Floats) -> Floats:
    weight: Floats = np.ones(len(values))
    coefficients: Floats = np.zeros(terms.shape[1])
    for _ in range(_HUBER_STEPS):
        weighted = terms * weight[:, None]
        coefficients = np.asarray(np.linalg.solve(weighted.T @ terms + penalty, weighted.T @ values), dtype=float)
        weight = 1.0 / np.maximum(1.0, np.abs(values - terms @ coefficients) / _HUBER_MM)
    return coefficients
