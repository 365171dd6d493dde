"""Training on the first halves of the thesis's logs: everything that the filters over the second halves are told.

What is chosen rather than fitted (how the bias depends on the attitude, the filter's noise) is chosen inside first
halves: fitted on one quarter of a log, judged on the other, both ways, the filter starting anew in the quarter that
judges it. Settings without truth are the most likely ones by the innovations of first halves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.lattice_calibration import LEVELS, SessionCalibration, calibrate_session
from bluerov_slam.acoustics.noise_tuning import MOST_ROUNDS, tune
from bluerov_slam.acoustics.slip_lattice import Fixes, LatticeSettings, run_lattice
from bluerov_slam.acoustics.thesis_log import MOTIONS
from bluerov_slam.evaluation.thesis_held_out import Blind, Parameters, blind_fixes, calibrated_fixes, rounded

if TYPE_CHECKING:
    from bluerov_slam.acoustics.slip_lattice import Floats
    from bluerov_slam.evaluation.thesis_halves import FirstHalf, Rows

_WALK = (1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
_STILL_WALK = _WALK[:5]
"""Of a platform that stands still: at most 6 mm in an hour."""
_FACTOR = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_GRIDS: dict[str, Sequence[float]] = {
    "learning": (0.0, 0.003, 0.01, 0.03),
    "trust": (0.1, 0.2, 0.35, 0.5, 0.7, 1.0),
    "walk_z": _WALK,
    "walk_y": _WALK,
    "noise_y": _FACTOR,
    "noise_z": _FACTOR,
    "yaw_sd_deg": (0.0, 0.2, 0.4, 0.7, 1.0, 1.5),
    "yaw_time_s": (20.0, 40.0, 80.0, 160.0, 320.0),
    "outlier_share": (0.003, 0.01, 0.03, 0.1),
}
_STILL: dict[str, Sequence[float]] = {"walk_z": _STILL_WALK, "walk_y": _STILL_WALK}
_TURNS: dict[str, Sequence[float]] = {
    "turn_y": (0.0, 3.0, 10.0, 30.0, 100.0, 300.0),
    "turn_z": (0.0, 0.3, 1.0, 3.0, 10.0),
}
_DISPLACEMENTS: dict[str, Sequence[float]] = {
    "displacement_y": (0.0, 0.25, 0.5, 1.0, 2.0),
    "displacement_z": (0.0, 0.5, 0.75, 1.0, 1.25),
}
_GRIDS_OF = {
    "stationary": _GRIDS | _STILL,  # what turns there is noise of the attitude
    "rapid": _GRIDS | _TURNS | _DISPLACEMENTS,
    "gradual": _GRIDS | _TURNS,  # its accelerations are below what the dead reckoning notices
}
_TRUSTS, _NOISES = (0.5, 1.0), (1.0, 4.0)
"""Where the search begins; which end is best is told by the first halves."""
_FREE = ("trust", "noise_y", "noise_z")
_NOT_BLIND = ("trust", "learning")
_TAILS_MM = (20.0, 30.0, 45.0)


def _starts(motion: str) -> list[LatticeSettings]:
    """Middles of the grids and no more: a start that knew a good end would be a parameter that nothing accounts for."""
    middles = {name: grid[len(grid) // 2] for name, grid in _GRIDS_OF[motion].items() if name not in _FREE}
    plain = LatticeSettings(**middles)
    return [replace(plain, trust=trust, noise_y=n, noise_z=n) for trust in _TRUSTS for n in _NOISES]


def train(halves: Sequence[FirstHalf], told: Callable[[str], None] = lambda _: None) -> Parameters:
    """Everything from first halves. `told` hears of the progress; minutes."""
    settings: dict[str, LatticeSettings] = {}
    calibrations: dict[str, SessionCalibration] = {}
    blind: dict[str, Blind] = {}
    for motion in MOTIONS:
        members = [half for half in halves if half.measured.motion == motion]
        if not members:
            continue
        level, settings[motion] = _chosen(members, motion, told)
        calibrations |= {half.measured.name: rounded(calibrated(half, half.scored, level)) for half in members}
        blind[motion] = blindly_tuned(members, motion, told)
    return Parameters(settings, calibrations, blind)


def calibrated(half: FirstHalf, rows: Rows, level: int) -> SessionCalibration:
    """Bias, cells and noise of a session, from some rows of its first half."""
    return calibrate_session(
        half.error_mm[rows],
        half.measured.attitude_deg[rows],
        half.measured.lattice_mm,
        half.measured.range_mm,
        level,
    )


def _chosen(members: Sequence[FirstHalf], motion: str, told: Callable[[str], None]) -> tuple[int, LatticeSettings]:
    """How the bias depends on the attitude, then the noise: the least RMSE plus median over the nested quarters."""
    starts = _starts(motion)
    folds = {level: _Folds(members, level) for level in LEVELS}
    level = min(LEVELS, key=lambda each: min(folds[each].cost(start) for start in starts))
    found = [tune(folds[level].cost, start, _GRIDS_OF[motion]) for start in starts]
    settings, cost = min(found, key=lambda each: each[1])
    told(f"{motion}: bias of level {level}, RMSE + median over nested quarters {cost:.1f} mm")
    return level, settings


class _Folds:
    """Every log twice: calibrated on one quarter, the filter started anew and judged in the other."""

    def __init__(self, members: Sequence[FirstHalf], level: int) -> None:
        self._fixes: list[Fixes] = []
        self._truth: list[Floats] = []
        self._rows: list[Rows] = []
        for half in members:
            for learnt, judged in ((0, 1), (1, 0)):
                rows = half.quarter(judged)
                whole = np.arange(rows[0], rows[-1] + 1)
                self._fixes.append(
                    calibrated_fixes(half.measured, whole, calibrated(half, half.quarter(learnt), level))
                )
                self._truth.append(half.true_mm[rows])
                self._rows.append(rows - rows[0])

    def cost(self, settings: LatticeSettings) -> float:
        found = run_lattice(self._fixes, settings).at_mm
        errors = [at[rows] - truth for at, rows, truth in zip(found, self._rows, self._truth, strict=True)]
        length = np.linalg.norm(np.concatenate(errors), axis=1)
        return float(np.sqrt(np.mean(length**2)) + np.median(length))


def blindly_tuned(
    members: Sequence[FirstHalf], motion: str, told: Callable[[str], None], rounds: int = MOST_ROUNDS
) -> Blind:
    """The most likely noise, from the innovations of first halves."""
    starts = [replace(start, learning=0.0) for start in _starts(motion) if start.trust == 1.0]

    def minus_log_likelihood(tail_mm: float) -> Callable[[LatticeSettings], float]:
        fixes = [blind_fixes(half.measured, np.arange(len(half.true_mm)), tail_mm) for half in members]
        return lambda settings: -float(np.sum(run_lattice(fixes, settings).log_likelihood))

    tail_mm = min(_TAILS_MM, key=lambda tail: min(map(minus_log_likelihood(tail), starts)))
    grids = {name: grid for name, grid in _GRIDS_OF[motion].items() if name not in _NOT_BLIND}
    found = [tune(minus_log_likelihood(tail_mm), start, grids, rounds) for start in starts]
    settings, cost = min(found, key=lambda each: each[1])
    told(f"{motion} without truth: tail {tail_mm:g} mm, log likelihood {-cost:.0f}")
    return Blind(settings, tail_mm)
