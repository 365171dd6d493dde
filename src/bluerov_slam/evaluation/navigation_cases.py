"""The cases N1 to N8: which runs they need, and each run on its own. A run is one seed of one dive, or one real log.

N1 to N6 share dives: a dive is simulated once and everything that its case asks for is taken from it while its records
are in memory. N3 is N4's dive without the Doppler log. Real logs come in as texts and records: nothing is read here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.baselines import baselines
from bluerov_slam.evaluation.dive_bounds import dive_bound
from bluerov_slam.evaluation.held_out_fixes import BLOCKS_S, GivenFixes, HeldOut, predict_held_out
from bluerov_slam.evaluation.navigation_run import Estimates, SensorNis, run_navigator
from bluerov_slam.evaluation.simulated_dive import (
    Dive,
    PathFigures,
    figures,
    in_truth_frame,
    navigate,
    saved_before,
    simulate,
)
from bluerov_slam.evaluation.snapir_case import SnapirFigures, snapir_figures
from bluerov_slam.evaluation.snapir_tracks import TRACKS, snapir_track
from bluerov_slam.evaluation.statistics import nees
from bluerov_slam.evaluation.trajectory import ate_m, end_error_m
from bluerov_slam.pipeline.navigator import Navigator, NavigatorAction, NavigatorCommand, NavigatorOptions
from bluerov_slam.pipeline.navigator_options import ThrustOptions
from bluerov_slam.records import ImuBurst, NavState, VehicleMotionDelta
from bluerov_slam.simulation.dive_plan import DIVE_PLANS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from bluerov_slam.evaluation.bounds import Bound
    from bluerov_slam.evaluation.navigation_run import NavigationRun
    from bluerov_slam.records import Record
    from bluerov_slam.simulation.board import Board

CASES = ("N1", "N2", "N3", "N4", "N5", "N6", "N7", "N8")
INERTIAL_FROM_S = 300.0
INERTIAL_FOR_S = (10.0, 60.0)
ACOUSTIC_DIVES = ("2024", "2022a", "2022b")
# Without thrusters the navigator holds the speed to what drag allows; that is no inertial measurement.
_NO_SPEED_PRIOR = NavigatorOptions(thrust=ThrustOptions(speed_prior_std_mps=1e4))


@dataclass(frozen=True, slots=True)
class Job:
    """One run. `part`: the conditions, the number of a track, or an acoustic dive and the length of its blocks."""

    kind: str
    part: str
    seed: int = 0

    def __str__(self) -> str:
        return f"{self.kind} {self.part} seed {self.seed}" if self.kind in ("N2", "N34", "N5", "N7") else self.label

    @property
    def label(self) -> str:
        """Without the seed."""
        return f"{self.kind} {self.part}"


@dataclass(frozen=True, slots=True)
class DiveOutcome:
    """One dive of N2, N3 or N4. `judged` is the causal run for N2 and the smoothed one for N3 and N4.

    `baselines`: name -> (ATE, end error), m. `inertial`: seconds of pure inertial navigation -> NEES of position.
    """

    case: str
    conditions: str
    seed: int
    judged: PathFigures
    causal: PathFigures
    bound_ate_m: float
    bound_ate_dof: float
    bound_end_m: float
    bound_end_dof: float
    baselines: dict[str, tuple[float, float]]
    nis: dict[str, SensorNis]
    resets: int
    inertial: dict[float, float]


@dataclass(frozen=True, slots=True)
class HeadingOutcome:
    """N5: heading error after the swing, moving."""

    seed: int
    rms_rad: float
    without_swing_rad: float


@dataclass(frozen=True, slots=True)
class SnapirOutcome:
    """N7: one track and one draw of its fixes."""

    track: int
    seed: int
    figures: SnapirFigures


@dataclass(frozen=True, slots=True)
class HeldOutOutcome:
    """N8: one log with blocks of one length held out."""

    dive: str
    block_s: float
    held: list[HeldOut]
    given: GivenFixes


Outcome = DiveOutcome | HeadingOutcome | SnapirOutcome | HeldOutOutcome


def jobs_for(cases: Iterable[str], seeds: Sequence[int]) -> list[Job]:
    """What has to be run for these cases, the longest first."""
    wanted = set(cases)
    dives: list[tuple[str, str]] = []
    if wanted & {"N3", "N4", "N6"}:
        dives.append(("N34", "hard"))
    if wanted & {"N1", "N2", "N6"}:
        dives.append(("N2", "hard"))
    if wanted & {"N2", "N6"}:
        dives.append(("N2", "calm"))
    if "N2" in wanted:
        dives.append(("N2", "still"))
    if "N5" in wanted:
        dives.append(("N5", "hard"))
    jobs = [Job(kind, part, seed) for kind, part in dives for seed in seeds]
    if "N8" in wanted:
        jobs += [Job("N8", f"{dive} {block_s:.0f}") for dive in ACOUSTIC_DIVES for block_s in BLOCKS_S]
    if "N7" in wanted:
        jobs += [Job("N7", str(track), seed) for seed in seeds[: max(1, len(seeds) // 3)] for track in TRACKS]
    return jobs


def run_dive(job: Job, board: Board | None) -> list[Outcome]:
    """A job of simulated dives: N2, N34 or N5."""
    if job.kind == "N5":
        return [_heading(job, board)]
    if job.kind == "N34":
        dive = simulate(replace(DIVE_PLANS["n4"], conditions=job.part), job.seed, board)
        return [_smoothed("N4", dive, ()), _smoothed("N3", _without_dvl(dive), (VehicleMotionDelta,))]
    dive = simulate(replace(DIVE_PLANS["n2"], conditions=job.part), job.seed, board)
    run = navigate(dive)
    own = figures(dive, run.causal, run.origin_deg)
    inertial = inertial_nees(dive) if job.part == "hard" else {}
    return [_outcome("N2", dive, run, own, own, inertial)]


def run_snapir(job: Job, dvl_csv: str, truth_csv: str) -> Outcome:
    """N7 on the two tables of one track."""
    track = snapir_track(int(job.part), dvl_csv, truth_csv)
    return SnapirOutcome(track.number, job.seed, snapir_figures(track, job.seed))


def run_held_out(job: Job, records: Sequence[Record]) -> Outcome:
    """N8 on the records of one log."""
    dive, block = job.part.split()
    held, given = predict_held_out(records, float(block))
    return HeldOutOutcome(dive, float(block), held, given)


def inertial_nees(dive: Dive) -> dict[float, float]:
    """From 300 s on nothing but gyro and accelerometer: NEES of the position (3 degrees of freedom) later on."""
    navigator = Navigator(_NO_SPEED_PRIOR, saved_before(dive))
    found: dict[float, float] = {}
    for record in _only_inertial(dive.records):
        for output in navigator.feed(record):
            if not isinstance(output, NavState):
                continue
            for seconds in INERTIAL_FOR_S:
                if seconds not in found and output.measured_s >= INERTIAL_FROM_S + seconds:
                    found[seconds] = _position_nees(dive, output)
        if len(found) == len(INERTIAL_FOR_S):
            break
    return found


def _only_inertial(records: Iterable[Record]) -> Iterator[Record]:
    """Everything until then; afterwards the IMU without its magnetometer."""
    for record in records:
        if getattr(record, "arrived_s", 0.0) < INERTIAL_FROM_S:
            yield record
        elif isinstance(record, ImuBurst):
            yield replace(record, magnetic_field_raw=np.zeros_like(record.magnetic_field_raw))


def _position_nees(dive: Dive, state: NavState) -> float:
    estimates = Estimates.of([state])
    error = dive.truth.at(state.measured_s).position_ned_m - in_truth_frame(estimates, state.origin_deg, dive.truth)[0]
    return float(nees(error[None], estimates.pose_covariance[:, :3, :3])[0])


def _without_dvl(dive: Dive) -> Dive:
    """The same dive as somebody without a Doppler log would have recorded it."""
    records = [record for record in dive.records if not isinstance(record, VehicleMotionDelta)]
    return replace(dive, plan=replace(dive.plan, dvl=False), records=records)


def _smoothed(case: str, dive: Dive, without: Sequence[type]) -> Outcome:
    run = navigate(dive, smooth=True, without=without)
    assert run.smoothed is not None
    judged = figures(dive, run.smoothed, run.origin_deg)
    return _outcome(case, dive, run, judged, figures(dive, run.causal, run.origin_deg), {})


def _outcome(
    case: str,
    dive: Dive,
    run: NavigationRun,
    judged: PathFigures,
    causal: PathFigures,
    inertial: dict[float, float],
) -> Outcome:
    bound: Bound = dive_bound(dive.plan, dive.truth, dive.gps_times_s())
    return DiveOutcome(
        case,
        dive.plan.conditions,
        dive.seed,
        judged,
        causal,
        bound.ate_m,
        bound.ate_dof,
        bound.end_m,
        bound.end_dof,
        _baseline_errors(dive),
        run.nis,
        run.resets,
        inertial,
    )


def _baseline_errors(dive: Dive) -> dict[str, tuple[float, float]]:
    paths = baselines(dive.records, dive.truth.origin_deg)
    times = np.arange(dive.truth.track_start_s, dive.truth.end_s, 1.0)
    truth = dive.truth.track(times).position_ned_m[:, :2]
    named = {
        "constant speed": paths.constant_ne_m,
        "thrusters": paths.thruster_ne_m,
        "rubber band": paths.rubber_band_ne_m,
    }
    errors: dict[str, tuple[float, float]] = {}
    for name, path in named.items():
        there = paths.at(path, times)
        errors[name] = ate_m(there, truth), end_error_m(there, truth)
    return errors


def _heading(job: Job, board: Board | None) -> Outcome:
    """The swing routine during the two turns, then the way; the same again without the routine."""
    dive = simulate(replace(DIVE_PLANS["n5"], conditions=job.part), job.seed, board)
    rms = []
    for swings in (True, False):
        navigator = Navigator(None, saved_before(dive))
        run = run_navigator(_with_swing(dive, navigator) if swings else dive.records, navigator)
        rms.append(figures(dive, run.causal, run.origin_deg).heading_rms_rad)
    return HeadingOutcome(job.seed, rms[0], rms[1])


def _with_swing(dive: Dive, navigator: Navigator) -> Iterator[Record]:
    """The dive's records; the user starts the routine before the turns and ends it after them."""
    orders = [
        (dive.plan.rest_s, NavigatorAction.START_CALIBRATION),
        (dive.truth.track_start_s, NavigatorAction.FINISH_CALIBRATION),
    ]
    for record in dive.records:
        while orders and getattr(record, "arrived_s", 0.0) >= orders[0][0]:
            navigator.command(NavigatorCommand(orders.pop(0)[1], kind="swing"))
        yield record
