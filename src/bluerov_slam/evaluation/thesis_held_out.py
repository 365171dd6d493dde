"""Filters over the thesis's fixes with what first halves gave: their parameters, their file, their estimates.

The lattice filter gets `Measured` and `Parameters` and so no truth but what first halves put into the parameters:

- causal: every estimate from fixes up to its own, and from the log's parameters;
- smoothed: from all fixes that it is given;
- started anew: it is given the second half's fixes only; the parameters are all that comes over;
- running on: it is given the whole log, as on a vehicle. The fixes of the first half lack the bias that their own truth
  told, so where the array stands still such a filter begins the second half knowing the answer. Started anew is what
  counts;
- without truth: no bias, cells as likely as they are near, noise by the likelihood of innovations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.acoustics.lattice_calibration import FIRST_SD, SessionCalibration, prior_probability
from bluerov_slam.acoustics.slip_lattice import Cells, Fixes, LatticeEstimates, LatticeSettings, run_lattice
from bluerov_slam.acoustics.thesis_log import MOTIONS

if TYPE_CHECKING:
    from bluerov_slam.acoustics.slip_lattice import Floats
    from bluerov_slam.evaluation.thesis_halves import FirstHalf, Measured, Rows

_DIGITS = 6


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


def estimates(
    logs: Sequence[Measured], parameters: Parameters, *, smoothed: bool, anew: bool = False
) -> dict[str, Floats]:
    """Positions (n, 2) by log; started `anew` in the second half, rows before it are NaN."""
    found: dict[str, Floats] = {}
    for motion, members in _by_motion(logs):
        rows = [np.arange(log.second_from if anew else 0, len(log.raw_mm)) for log in members]
        fixes = [calibrated_fixes(s, r, parameters.calibrations[s.name]) for s, r in zip(members, rows, strict=True)]
        found |= _spread(members, rows, run_lattice(fixes, parameters.settings[motion], smoothed=smoothed))
    return found


def blind_estimates(
    logs: Sequence[Measured], parameters: Parameters, *, smoothed: bool, anew: bool = False
) -> dict[str, Floats]:
    """The same without any truth: no bias, cells as likely as they are near."""
    found: dict[str, Floats] = {}
    for motion, members in _by_motion(logs):
        rows = [np.arange(log.second_from if anew else 0, len(log.raw_mm)) for log in members]
        blind = parameters.blind[motion]
        fixes = [blind_fixes(s, r, blind.tail_mm) for s, r in zip(members, rows, strict=True)]
        found |= _spread(members, rows, run_lattice(fixes, blind.settings, smoothed=smoothed))
    return found


def baselines(logs: Sequence[Measured], taught: Mapping[str, FirstHalf]) -> dict[str, dict[str, Floats]]:
    """By name and log: the raw fixes, the published best (iSBL-SF), and that less its mean error in the first half."""
    return {
        "raw fixes": {log.name: log.raw_mm for log in logs},
        "logged iSBL-SF (best published)": {log.name: log.fused_mm for log in logs},
        "logged iSBL-SF less session bias": {
            log.name: log.fused_mm - _session_bias_mm(taught[log.name]) for log in logs
        },
    }


def calibrated_fixes(log: Measured, rows: Rows, calibration: SessionCalibration) -> Fixes:
    """For the filter: without their bias, with the session's own cells."""
    bias_mm = calibration.bias_mm(log.attitude_deg[rows])
    return _as_fixes(log, rows, log.raw_mm[rows] - bias_mm, calibration.cells(log.lattice_mm))


def blind_fixes(log: Measured, rows: Rows, tail_mm: float) -> Fixes:
    """For the filter: as they are."""
    sd_mm = (FIRST_SD[0] * log.range_mm, FIRST_SD[1] * log.range_mm)
    cells = Cells(log.lattice_mm, prior_probability(log.lattice_mm, tail_mm), sd_mm)
    return _as_fixes(log, rows, log.raw_mm[rows], cells)


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


def _session_bias_mm(first: FirstHalf) -> Floats:
    return np.asarray((first.measured.fused_mm - first.true_mm)[first.scored].mean(axis=0))


def _as_fixes(log: Measured, rows: Rows, at_mm: Floats, cells: Cells) -> Fixes:
    turn = np.diff(log.attitude_deg, axis=0, prepend=log.attitude_deg[:1])
    return Fixes(at_mm, log.interval_s[rows], log.displacement_mm[rows], turn[rows], log.range_mm, cells)


def _spread(members: Sequence[Measured], rows: Sequence[Rows], found: LatticeEstimates) -> dict[str, Floats]:
    positions = {}
    for log, here, at_mm in zip(members, rows, found.at_mm, strict=True):
        positions[log.name] = np.full(log.raw_mm.shape, np.nan)
        positions[log.name][here] = at_mm[: len(here)]
    return positions


def _by_motion(logs: Sequence[Measured]) -> list[tuple[str, list[Measured]]]:
    groups = [(motion, [log for log in logs if log.motion == motion]) for motion in MOTIONS]
    return [(motion, members) for motion, members in groups if members]


def _round(values: Any) -> Floats:
    return np.asarray(np.vectorize(lambda value: float(f"{value:.{_DIGITS}g}"), otypes=[float])(values))
