"""Held-out halves of the thesis's logs: all is found from the first half of each log and scored on the second.

Truth is used in first halves only. What is chosen rather than fitted (how the bias depends on the attitude, the
filter's noise) is chosen inside them: fitted on one quarter of a log, judged on the other, both ways, the filter
starting anew in the quarter that judges it. Second halves are scored as they are: no outlier is removed, the logged
truth is taken, only rows are left out whose truth is not theirs (after a DISCARD).

Scored twice: with the filter starting anew in the second half, so that nothing but the parameters comes over, and with
the filter running on from the first half, as on a vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.lattice_calibration import (
    FIRST_SD,
    LEVELS,
    SessionCalibration,
    calibrate_session,
    prior_probability,
)
from bluerov_slam.acoustics.noise_tuning import tune
from bluerov_slam.acoustics.slip_lattice import (
    Cells,
    Fixes,
    LatticeEstimates,
    LatticeSettings,
    lattice_mm,
    lattice_vectors_mm,
    run_lattice,
)
from bluerov_slam.acoustics.thesis_log import MOTIONS, ThesisLog
from bluerov_slam.acoustics.thesis_replay import USUAL_PERIODS, Replay

if TYPE_CHECKING:
    from bluerov_slam.acoustics.slip_lattice import Floats

Rows = NDArray[np.int64]

ARRAY_CENTRE_MM = (110.0, 0.0, -648.38)
"""Of the platform at home; ranges to the transmitter are from here."""
SIDE_MM = 353.6
SOUND_SPEED_MPS = 343.0
DRIVE_STEP_S = 12.375e-6
"""Half a period of the carrier in the transmitter's clock, whose second is the logged period of the pulses."""
REACH = 8.0
"""Slips of up to so many lattice spacings; what lies further off is an outlier."""

_START = {
    "stationary": (
        LatticeSettings(0.01, 0.01, trust=0.5, outlier_share=0.1),
        LatticeSettings(
            0.001, 1e-4, trust=0.7, noise_y=8.0, noise_z=8.0, yaw_sd_deg=0.2, yaw_time_s=320.0, learning=0.01
        ),
    ),
    "rapid": (
        LatticeSettings(10.0, 30.0, turn_y=10.0, trust=0.5, displacement_y=0.5, displacement_z=1.0),
        LatticeSettings(30.0, 30.0, turn_y=30.0, trust=0.7, yaw_sd_deg=0.4, displacement_y=0.5, displacement_z=1.0),
    ),
    "gradual": (
        LatticeSettings(10.0, 10.0, turn_y=30.0, turn_z=1.0, trust=0.5),
        LatticeSettings(10.0, 3.0, turn_y=100.0, turn_z=1.0, trust=0.7, yaw_sd_deg=0.4),
    ),
}
_WALK = (1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
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
_TURNS: dict[str, Sequence[float]] = {
    "turn_y": (0.0, 3.0, 10.0, 30.0, 100.0, 300.0),
    "turn_z": (0.0, 0.3, 1.0, 3.0, 10.0),
}
_DISPLACEMENTS: dict[str, Sequence[float]] = {
    "displacement_y": (0.0, 0.25, 0.5, 1.0, 2.0),
    "displacement_z": (0.0, 0.5, 0.75, 1.0, 1.25),
}
_GRIDS_OF = {
    "stationary": _GRIDS,  # what turns there is noise of the attitude
    "rapid": _GRIDS | _TURNS | _DISPLACEMENTS,
    "gradual": _GRIDS | _TURNS,  # its accelerations are below what the dead reckoning notices
}
_NOT_BLIND = ("trust", "learning")
_TAILS_MM = (20.0, 30.0, 45.0)
_DIGITS = 6


@dataclass(frozen=True, slots=True)
class Session:
    """A log with what its replay told, ready to be filtered. `scored`: rows whose logged truth is theirs."""

    name: str
    motion: str
    raw_mm: Floats
    true_mm: Floats
    fused_mm: Floats
    attitude_deg: Floats
    interval_s: Floats
    displacement_mm: Floats
    scored: NDArray[np.bool_]
    range_mm: float
    lattice_mm: Floats

    @property
    def error_mm(self) -> Floats:
        return np.asarray(self.raw_mm - self.true_mm)

    def half(self, which: int) -> Rows:
        """Rows with truth of the first (0) or the second (1) half of them."""
        rows = np.flatnonzero(self.scored)
        return rows[: len(rows) // 2] if which == 0 else rows[len(rows) // 2 :]

    def quarter(self, which: int) -> Rows:
        """Of the first half."""
        rows = self.half(0)
        return rows[: len(rows) // 2] if which == 0 else rows[len(rows) // 2 :]


@dataclass(frozen=True, slots=True)
class Blind:
    """What the filter without any truth needs for a kind of motion."""

    settings: LatticeSettings
    tail_mm: float


@dataclass(frozen=True, slots=True)
class Parameters:
    """All that first halves gave: by motion the settings, by log the calibration; the blind filter by motion."""

    settings: dict[str, LatticeSettings]
    calibrations: dict[str, SessionCalibration]
    blind: dict[str, Blind]


def session_of(log: ThesisLog, replay: Replay) -> Session:
    """Across the line of sight: y and z of everything."""
    rows = log.rows
    dx, dy, _ = np.subtract(log.transmitter_mm, ARRAY_CENTRE_MM)
    range_mm = float(np.linalg.norm(np.subtract(log.transmitter_mm, ARRAY_CENTRE_MM)))
    wavelength_mm = SOUND_SPEED_MPS * 1e3 * 2.0 * DRIVE_STEP_S * replay.period_s
    vectors = lattice_vectors_mm(range_mm, math.atan2(dy, dx), wavelength_mm, SIDE_MM)
    usual_s = USUAL_PERIODS[log.motion] * replay.period_s
    return Session(
        name=log.name,
        motion=log.motion,
        raw_mm=rows.raw_mm[:, 1:],
        true_mm=rows.true_mm[:, 1:],
        fused_mm=rows.fused_mm[:, 1:],
        attitude_deg=rows.attitude_deg,
        interval_s=np.where(np.isnan(replay.interval_s), usual_s, replay.interval_s),
        displacement_mm=np.nan_to_num(replay.displacement_mm[:, 1:]),
        scored=~rows.after_discard,
        range_mm=range_mm,
        lattice_mm=lattice_mm(vectors, REACH),
    )


def train(sessions: Sequence[Session], told: Callable[[str], None] = lambda _: None) -> Parameters:
    """Everything from first halves. `told` hears of the progress; minutes."""
    settings: dict[str, LatticeSettings] = {}
    calibrations: dict[str, SessionCalibration] = {}
    blind: dict[str, Blind] = {}
    for motion in MOTIONS:
        members = [session for session in sessions if session.motion == motion]
        if not members:
            continue
        level, settings[motion] = _chosen(members, motion, told)
        calibrations |= {session.name: rounded(_calibrated(session, session.half(0), level)) for session in members}
        blind[motion] = _blindly_tuned(members, motion, told)
    return Parameters(settings, calibrations, blind)


def estimates(
    sessions: Sequence[Session], parameters: Parameters, *, smoothed: bool, anew: bool = False
) -> dict[str, Floats]:
    """Positions (n, 2) by log; started `anew` in the second half, rows before it are NaN."""
    found: dict[str, Floats] = {}
    for motion, members in _by_motion(sessions):
        rows = [_from(session, 1) if anew else np.arange(len(session.raw_mm)) for session in members]
        fixes = [_fixes(s, r, parameters.calibrations[s.name]) for s, r in zip(members, rows, strict=True)]
        found |= _spread(members, rows, run_lattice(fixes, parameters.settings[motion], smoothed=smoothed))
    return found


def blind_estimates(sessions: Sequence[Session], parameters: Parameters, *, smoothed: bool) -> dict[str, Floats]:
    """The same without any truth: no bias, cells as likely as they are near."""
    found: dict[str, Floats] = {}
    for motion, members in _by_motion(sessions):
        rows = [np.arange(len(session.raw_mm)) for session in members]
        blind = parameters.blind[motion]
        fixes = [_blind_fixes(s, r, blind.tail_mm) for s, r in zip(members, rows, strict=True)]
        found |= _spread(members, rows, run_lattice(fixes, blind.settings, smoothed=smoothed))
    return found


def second_half_errors_mm(sessions: Iterable[Session], positions_mm: Mapping[str, Floats]) -> Floats:
    """Estimate less truth of all second halves, (n, 2)."""
    return np.concatenate([(positions_mm[s.name] - s.true_mm)[s.half(1)] for s in sessions])


def baselines(sessions: Sequence[Session]) -> dict[str, dict[str, Floats]]:
    """By name and log: the raw fixes, the published best (iSBL-SF), and that less its mean error in the first half."""
    return {
        "raw fixes": {s.name: s.raw_mm for s in sessions},
        "logged iSBL-SF (best published)": {s.name: s.fused_mm for s in sessions},
        "logged iSBL-SF less session bias": {
            s.name: s.fused_mm - (s.fused_mm - s.true_mm)[s.half(0)].mean(axis=0) for s in sessions
        },
    }


def rounded(calibration: SessionCalibration) -> SessionCalibration:
    """To the digits of the parameter file: what it says is what runs, on every machine."""
    return SessionCalibration(
        _round(calibration.coefficients_mm),
        _round(calibration.probability),
        (float(_round(calibration.sd_mm[0])), float(_round(calibration.sd_mm[1]))),
    )


def as_json(parameters: Parameters) -> dict[str, Any]:
    """For the parameter file."""
    return {
        "settings": {motion: asdict(settings) for motion, settings in parameters.settings.items()},
        "without_truth": {
            motion: {"tail_mm": blind.tail_mm, "settings": asdict(blind.settings)}
            for motion, blind in parameters.blind.items()
        },
        "sessions": {
            name: {
                "coefficients_mm": calibration.coefficients_mm.tolist(),
                "sd_mm": list(calibration.sd_mm),
                "probability": calibration.probability.tolist(),
            }
            for name, calibration in sorted(parameters.calibrations.items())
        },
    }


def from_json(content: Mapping[str, Any]) -> Parameters:
    """Back from the parameter file."""
    return Parameters(
        settings={motion: LatticeSettings(**settings) for motion, settings in content["settings"].items()},
        calibrations={
            name: SessionCalibration(
                np.array(told["coefficients_mm"]), np.array(told["probability"]), (told["sd_mm"][0], told["sd_mm"][1])
            )
            for name, told in content["sessions"].items()
        },
        blind={
            motion: Blind(LatticeSettings(**told["settings"]), told["tail_mm"])
            for motion, told in content["without_truth"].items()
        },
    )


def _chosen(members: Sequence[Session], motion: str, told: Callable[[str], None]) -> tuple[int, LatticeSettings]:
    """How the bias depends on the attitude, then the noise: the least RMSE plus median over the nested quarters."""
    starts = _START[motion]
    folds = {level: _Folds(members, level) for level in LEVELS}
    level = min(LEVELS, key=lambda each: min(folds[each].cost(start) for start in starts))
    found = [tune(folds[level].cost, start, _GRIDS_OF[motion]) for start in starts]
    settings, cost = min(found, key=lambda each: each[1])
    told(f"{motion}: bias of level {level}, RMSE + median over nested quarters {cost:.1f} mm")
    return level, settings


class _Folds:
    """Every log twice: calibrated on one quarter, the filter started anew and judged in the other."""

    def __init__(self, members: Sequence[Session], level: int) -> None:
        self._fixes: list[Fixes] = []
        self._truth: list[Floats] = []
        self._rows: list[Rows] = []
        for session in members:
            for learnt, judged in ((0, 1), (1, 0)):
                rows = session.quarter(judged)
                whole = np.arange(rows[0], rows[-1] + 1)
                self._fixes.append(_fixes(session, whole, _calibrated(session, session.quarter(learnt), level)))
                self._truth.append(session.true_mm[rows])
                self._rows.append(rows - rows[0])

    def cost(self, settings: LatticeSettings) -> float:
        found = run_lattice(self._fixes, settings).at_mm
        errors = [at[rows] - truth for at, rows, truth in zip(found, self._rows, self._truth, strict=True)]
        length = np.linalg.norm(np.concatenate(errors), axis=1)
        return float(np.sqrt(np.mean(length**2)) + np.median(length))


def _blindly_tuned(members: Sequence[Session], motion: str, told: Callable[[str], None]) -> Blind:
    """The most likely noise, from the innovations of first halves."""
    start = replace(_START[motion][0], trust=1.0)

    def minus_log_likelihood(tail_mm: float) -> Callable[[LatticeSettings], float]:
        fixes = [_blind_fixes(session, np.arange(session.half(1)[0]), tail_mm) for session in members]
        return lambda settings: -float(np.sum(run_lattice(fixes, settings).log_likelihood))

    tail_mm = min(_TAILS_MM, key=lambda tail: minus_log_likelihood(tail)(start))
    grids = {name: grid for name, grid in _GRIDS_OF[motion].items() if name not in _NOT_BLIND}
    settings, cost = tune(minus_log_likelihood(tail_mm), start, grids)
    told(f"{motion} without truth: tail {tail_mm:g} mm, log likelihood {-cost:.0f}")
    return Blind(settings, tail_mm)


def _calibrated(session: Session, rows: Rows, level: int) -> SessionCalibration:
    return calibrate_session(
        session.error_mm[rows], session.attitude_deg[rows], session.lattice_mm, session.range_mm, level
    )


def _fixes(session: Session, rows: Rows, calibration: SessionCalibration) -> Fixes:
    bias_mm = calibration.bias_mm(session.attitude_deg[rows])
    return _as_fixes(session, rows, session.raw_mm[rows] - bias_mm, calibration.cells(session.lattice_mm))


def _blind_fixes(session: Session, rows: Rows, tail_mm: float) -> Fixes:
    sd_mm = (FIRST_SD[0] * session.range_mm, FIRST_SD[1] * session.range_mm)
    cells = Cells(session.lattice_mm, prior_probability(session.lattice_mm, tail_mm), sd_mm)
    return _as_fixes(session, rows, session.raw_mm[rows], cells)


def _as_fixes(session: Session, rows: Rows, at_mm: Floats, cells: Cells) -> Fixes:
    turn = np.diff(session.attitude_deg, axis=0, prepend=session.attitude_deg[:1])
    return Fixes(at_mm, session.interval_s[rows], session.displacement_mm[rows], turn[rows], session.range_mm, cells)


def _from(session: Session, half: int) -> Rows:
    return np.arange(session.half(half)[0], len(session.raw_mm))


def _spread(members: Sequence[Session], rows: Sequence[Rows], found: LatticeEstimates) -> dict[str, Floats]:
    positions = {}
    for session, here, at_mm in zip(members, rows, found.at_mm, strict=True):
        positions[session.name] = np.full(session.raw_mm.shape, np.nan)
        positions[session.name][here] = at_mm[: len(here)]
    return positions


def _by_motion(sessions: Sequence[Session]) -> list[tuple[str, list[Session]]]:
    groups = [(motion, [session for session in sessions if session.motion == motion]) for motion in MOTIONS]
    return [(motion, members) for motion, members in groups if members]


def _round(values: Any) -> Floats:
    return np.asarray(np.vectorize(lambda value: float(f"{value:.{_DIGITS}g}"), otypes=[float])(values))
