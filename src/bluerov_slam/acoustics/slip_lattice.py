"""A filter over acoustic fixes that knows how they go wrong: by whole periods of the carrier.

With three delays to one receiver, weighted alike, a delay that is wrong by one period T of the carrier moves the fix
across the line of sight by one of three vectors, and any mixture of slips by a whole combination of two of them: wrong
fixes lie on a lattice around the right one. So the position is not the mean of the fixes, but what explains each of
them as one of the lattice's cells:

    fix = position + bias(attitude) + cell_k + noise,   cell k with probability p_k;   or an outlier

Each update weighs all cells by what the filter expects and goes on with the mean and the variance of the mixture
(probabilistic data association). The two axes across the line of sight know of each other only through the cells. A
slow error of the yaw (magnetometer: correlated over a minute) is a state of its own beside the first axis. The process
noise grows with time and with turning, displacements of a dead reckoning are used as far as they earned it.

The smoother is that of Rauch, Tung and Striebel over the same steps. Several logs of one kind run side by side: arrays
are (logs, fixes, ...).

Source: association after Bar-Shalom and Tse (1975), doi:10.1016/0005-1098(75)90044-7; the lattice is derived in
docs/isbl-thesis.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_START_SD_MM = 80.0
"""The filter begins at its first fix, as unsure as that may be wrong by slips."""
_NO_CELL_MM = 1e6
_LEAST_P = 1e-12


@dataclass(frozen=True, slots=True)
class LatticeSettings:
    """Noise of the filter, alike for all logs of a kind of motion. Millimetres, seconds, degrees; _y and _z: the axes.

    Attributes:
        walk_y, walk_z: process variance per second.
        turn_y, turn_z: process variance per square degree that the array turned since the last fix (roll; any axis).
        trust: exponent of the cells' probabilities; slips come in a row, so n fixes tell less than n times one.
        noise_y, noise_z: factor on the variance within a cell.
        yaw_sd_deg, yaw_time_s: slow yaw error, standard deviation and correlation time.
        displacement_y, displacement_z: how far the array moves when dead reckoning says one.
        learning: share by which each fix moves the cells' probabilities towards the cells it may belong to: which cells
            a session prefers changes with temperature and echoes.
        outlier_share, outlier_sd: fixes off the lattice.
    """

    walk_y: float
    walk_z: float
    turn_y: float = 0.0
    turn_z: float = 0.0
    trust: float = 1.0
    noise_y: float = 1.0
    noise_z: float = 1.0
    yaw_sd_deg: float = 0.0
    yaw_time_s: float = 60.0
    displacement_y: float = 0.0
    displacement_z: float = 0.0
    learning: float = 0.0
    outlier_share: float = 0.02
    outlier_sd: float = 120.0


@dataclass(frozen=True, slots=True)
class Cells:
    """The lattice of one log: where its K cells lie (K, 2), how probable each is, and the noise within one (y, z)."""

    at_mm: Floats
    probability: Floats
    sd_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Fixes:
    """One log's fixes without their bias, (n, 2); time, displacement (n, 2) and turn (n, 3) since the fix before."""

    at_mm: Floats
    interval_s: Floats
    displacement_mm: Floats
    turn_deg: Floats
    range_mm: float
    cells: Cells


@dataclass(frozen=True, slots=True)
class LatticeEstimates:
    """Positions (logs, n, 2) with variances, nothing meant beyond a log's end; log likelihood of its innovations."""

    at_mm: Floats
    variance_mm2: Floats
    log_likelihood: Floats


def lattice_vectors_mm(range_mm: float, azimuth_rad: float, wavelength_mm: float, side_mm: float) -> Floats:
    """Two vectors (2, 2: y, z) whose whole combinations are all slips of a square array with its reference in a corner.

    Off the array's axis the same error of direction is a longer way across the line of sight.
    """
    spacing = wavelength_mm / (3.0 * side_mm) * range_mm
    stretch = np.array([1.0 / math.cos(azimuth_rad) ** 3, 1.0 / math.cos(azimuth_rad)])
    return np.asarray(np.array([[-1.0, 2.0], [1.0, 1.0]]) * stretch * spacing)


def lattice_mm(vectors_mm: Floats, reach: float) -> Floats:
    """All cells (K, 2) within `reach` lattice spacings of the middle one, which is the first."""
    spacing = float(np.min(np.linalg.norm(vectors_mm, axis=1))) / math.sqrt(2.0)
    count = int(reach) + 2
    steps = np.stack(np.meshgrid(np.arange(-count, count + 1), np.arange(-count, count + 1), indexing="ij"), axis=-1)
    cells = steps.reshape(-1, 2) @ vectors_mm
    distance = np.linalg.norm(cells, axis=1)
    order = np.argsort(distance, kind="stable")
    return np.asarray(cells[order][distance[order] <= reach * spacing])


def run_lattice(logs: Sequence[Fixes], settings: LatticeSettings, *, smoothed: bool = False) -> LatticeEstimates:
    """Filters logs of one kind side by side; every estimate uses fixes up to its own, or all when smoothed."""
    run = _Run(logs, settings)
    for i in range(run.fixes.shape[1]):
        if i:
            run.predict(i)
        run.correct(i)
    return run.smoothed() if smoothed else run.filtered()


class _Run:
    """State and history. Axis y has position and yaw error, covariance [[yy, yw], [yw, ww]]; axis z the position."""

    def __init__(self, logs: Sequence[Fixes], settings: LatticeSettings) -> None:
        count, longest = len(logs), max(len(log.at_mm) for log in logs)
        most_cells = max(len(log.cells.at_mm) for log in logs)
        self.fixes = np.zeros((count, longest, 2))
        self.present = np.zeros((count, longest), dtype=np.bool_)
        self.cells = np.full((count, most_cells, 2), _NO_CELL_MM)
        self.p = np.zeros((count, most_cells))
        self.real = np.zeros((count, most_cells), dtype=np.bool_)
        move = np.zeros((count, longest, 2))
        interval = np.zeros((count, longest))
        turn = np.zeros((count, longest, 3))
        for b, log in enumerate(logs):
            n, k = len(log.at_mm), len(log.cells.at_mm)
            self.fixes[b, :n], self.present[b, :n] = log.at_mm, True
            self.cells[b, :k] = log.cells.at_mm
            self.p[b, :k], self.real[b, :k] = log.cells.probability, True
            move[b, :n], interval[b, :n], turn[b, :n] = log.displacement_mm, log.interval_s, log.turn_deg
        self.move = move * (settings.displacement_y, settings.displacement_z)
        self.q_y = settings.walk_y * interval + settings.turn_y * turn[:, :, 0] ** 2
        self.q_z = settings.walk_z * interval + settings.turn_z * np.sum(turn**2, axis=2)
        self.decay = np.exp(-interval / settings.yaw_time_s)
        sd = np.array([log.cells.sd_mm for log in logs])
        self.r_y, self.r_z = settings.noise_y * sd[:, 0] ** 2, settings.noise_z * sd[:, 1] ** 2
        self.wobble = (math.radians(settings.yaw_sd_deg) * np.array([log.range_mm for log in logs])) ** 2
        self.log_in, self.log_out = math.log1p(-settings.outlier_share), math.log(settings.outlier_share)
        self.wide = settings.outlier_sd**2
        self.trust, self.learning = settings.trust, settings.learning
        self.y = np.array([log.at_mm[0, 0] for log in logs])
        self.z = np.array([log.at_mm[0, 1] for log in logs])
        self.w = np.zeros(count)
        self.yy, self.zz = np.full(count, _START_SD_MM**2), np.full(count, _START_SD_MM**2)
        self.yw, self.ww = np.zeros(count), self.wobble.copy()
        self.log_likelihood = np.zeros(count)
        self.prior = np.zeros((longest, 7, count))
        self.posterior = np.zeros((longest, 7, count))

    def predict(self, i: int) -> None:
        decay = self.decay[:, i]
        self.y = self.y + self.move[:, i, 0]
        self.z = self.z + self.move[:, i, 1]
        self.w = self.w * decay
        self.yy, self.zz = self.yy + self.q_y[:, i], self.zz + self.q_z[:, i]
        self.yw, self.ww = self.yw * decay, self.ww * decay**2 + self.wobble * (1.0 - decay**2)

    def correct(self, i: int) -> None:
        self.prior[i] = self._state()
        off_y, off_z = self.fixes[:, i, 0] - self.y - self.w, self.fixes[:, i, 1] - self.z
        s_y, s_z = self.yy + 2.0 * self.yw + self.ww + self.r_y, self.zz + self.r_z
        u_y, u_z = off_y[:, None] - self.cells[:, :, 0], off_z[:, None] - self.cells[:, :, 1]
        liking = np.maximum(self.p, _LEAST_P) ** self.trust
        inside = np.log(liking / np.sum(liking, axis=1, keepdims=True, where=self.real))
        inside -= 0.5 * (u_y * u_y / s_y[:, None] + u_z * u_z / s_z[:, None])
        inside += (self.log_in - 0.5 * np.log(s_y * s_z))[:, None]
        o_y, o_z = s_y + self.wide, s_z + self.wide
        outside = self.log_out - 0.5 * (off_y**2 / o_y + off_z**2 / o_z + np.log(o_y * o_z))
        most = np.maximum(inside.max(axis=1), outside)
        weight, weight_out = np.exp(inside - most[:, None]), np.exp(outside - most)
        total = weight.sum(axis=1) + weight_out
        weight /= total[:, None]
        share = 1.0 - weight_out / total
        self.p += self.learning * (weight - share[:, None] * self.p)
        present = self.present[:, i]
        self.log_likelihood += np.where(present, most + np.log(total) - math.log(2.0 * math.pi), 0.0)
        mean_y, mean_z = np.sum(weight * u_y, axis=1), np.sum(weight * u_z, axis=1)
        # Kalman update by the share that lies on the lattice, and the spread between the cells put back on top.
        down_y = np.sum(weight * u_y * u_y, axis=1) - mean_y**2 - share * s_y
        down_z = np.sum(weight * u_z * u_z, axis=1) - mean_z**2 - share * s_z
        k_y, k_w, k_z = (self.yy + self.yw) / s_y, (self.yw + self.ww) / s_y, self.zz / s_z
        self.y, self.w, self.z = self.y + k_y * mean_y, self.w + k_w * mean_y, self.z + k_z * mean_z
        self.yy, self.yw = self.yy + k_y**2 * down_y, self.yw + k_y * k_w * down_y
        self.ww, self.zz = self.ww + k_w**2 * down_y, self.zz + k_z**2 * down_z
        self.posterior[i] = self._state()

    def filtered(self) -> LatticeEstimates:
        return self._estimates(self.posterior)

    def smoothed(self) -> LatticeEstimates:
        found = self.posterior.copy()
        for i in range(len(found) - 2, -1, -1):
            y, w, z, yy, yw, ww, zz = self.posterior[i]
            _, _, _, after_yy, after_yw, after_ww, after_zz = self.prior[i + 1]
            d_y, d_w, d_z, *_ = found[i + 1] - self.prior[i + 1]
            decay = self.decay[:, i + 1]
            # Gain of the pair (y, w): P F' times the inverse of the predicted covariance; without yaw error y alone.
            paired = self.wobble > 0.0
            determinant = np.where(paired, after_yy * after_ww - after_yw**2, 1.0)
            ww_1 = np.where(paired, after_ww, 0.0)
            g_yy = np.where(paired, (yy * ww_1 - yw * decay * after_yw) / determinant, yy / after_yy)
            g_yw = np.where(paired, (yw * decay * after_yy - yy * after_yw) / determinant, 0.0)
            g_wy = np.where(paired, (yw * ww_1 - ww * decay * after_yw) / determinant, 0.0)
            g_ww = np.where(paired, (ww * decay * after_yy - yw * after_yw) / determinant, 0.0)
            g_z = zz / after_zz
            more_yy, more_yw, more_ww = (found[i + 1, k] - self.prior[i + 1, k] for k in (3, 4, 5))
            later = self.present[:, i + 1]
            new = np.stack(
                [
                    y + g_yy * d_y + g_yw * d_w,
                    w + g_wy * d_y + g_ww * d_w,
                    z + g_z * d_z,
                    yy + g_yy**2 * more_yy + 2.0 * g_yy * g_yw * more_yw + g_yw**2 * more_ww,
                    yw + g_yy * g_wy * more_yy + (g_yy * g_ww + g_yw * g_wy) * more_yw + g_yw * g_ww * more_ww,
                    ww + g_wy**2 * more_yy + 2.0 * g_wy * g_ww * more_yw + g_ww**2 * more_ww,
                    zz + g_z**2 * (found[i + 1, 6] - after_zz),
                ]
            )
            found[i] = np.where(later, new, self.posterior[i])
        return self._estimates(found)

    def _state(self) -> Floats:
        return np.stack([self.y, self.w, self.z, self.yy, self.yw, self.ww, self.zz])

    def _estimates(self, states: Floats) -> LatticeEstimates:
        return LatticeEstimates(
            at_mm=states[:, [0, 2]].transpose(2, 0, 1),
            variance_mm2=states[:, [3, 6]].transpose(2, 0, 1),
            log_likelihood=self.log_likelihood,
        )
