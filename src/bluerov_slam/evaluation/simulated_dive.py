"""One simulated dive through the whole chain, and the figures that are taken from it.

A dive is simulated once; its board's bytes are decoded as live. The navigator may run over the records several times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.navigation_run import decoded, run_navigator
from bluerov_slam.evaluation.statistics import nees, share_in_band
from bluerov_slam.evaluation.trajectory import (
    SEGMENTS_M,
    aligned_ate_m,
    ate_m,
    end_error_m,
    path_length_m,
    relative_error_m,
)
from bluerov_slam.navigation.attitude.calibration import Calibration, MagnetometerCalibration, Provenance, matrix
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.navigator import Navigator, SavedNavigation
from bluerov_slam.records import GpsFix, ImuBurst
from bluerov_slam.simulation.dive import SimulatedDive

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from bluerov_slam.evaluation.navigation_run import Estimates, NavigationRun
    from bluerov_slam.pipeline.navigator_options import NavigatorOptions
    from bluerov_slam.records import Record
    from bluerov_slam.simulation.board import Board
    from bluerov_slam.simulation.dive import DiveTruth
    from bluerov_slam.simulation.dive_plan import DivePlan


@dataclass(frozen=True, slots=True)
class Dive:
    """What was heard, as records in order of arrival, and what happened."""

    plan: DivePlan
    seed: int
    truth: DiveTruth
    records: Sequence[Record]

    def gps_times_s(self) -> list[float]:
        """When the receiver had a position."""
        return [each.measured_s for each in self.records if isinstance(each, GpsFix) and each.latitude_deg is not None]

    def distance_m(self) -> float:
        """Length of the true track."""
        times = np.arange(self.truth.track_start_s, self.truth.end_s, 1.0)
        return path_length_m(self.truth.track(times).position_ned_m[:, :2])


@dataclass(frozen=True, slots=True)
class PathFigures:
    """Errors of one run over the track; metres, nothing aligned but `aligned_ate_m`."""

    ate_m: float
    end_m: float
    end_percent: float
    aligned_ate_m: float
    relative_m: tuple[float | None, ...]
    heading_rms_rad: float
    position_in_band: float
    pose_in_band: float
    position_nees: float
    pose_nees: float
    epochs: int


def simulate(plan: DivePlan, seed: int, board: Board | None) -> Dive:
    """Dive once and decode everything."""
    dive = SimulatedDive(plan, seed, board)
    return Dive(plan, seed, dive.truth, list(decoded(dive.inputs())))


def navigate(
    dive: Dive, options: NavigatorOptions | None = None, smooth: bool = False, without: Iterable[type] = ()
) -> NavigationRun:
    """The navigator over the dive's records, some kinds left out."""
    left_out = tuple(without)
    records = (each for each in dive.records if not isinstance(each, left_out))
    return run_navigator(records, Navigator(options, saved_before(dive)), smooth)


def saved_before(dive: Dive) -> SavedNavigation:
    """What the user's calibrations before the dive left behind, nothing else.

    The conditions state the compass errors that a magnetometer calibration leaves. So there was one; that it found the
    right offset and shape is in those errors, and all that it still has to say is how long the field is in raw units.
    """
    first = next(record for record in dive.records if isinstance(record, ImuBurst))
    norm = float(np.linalg.norm(first.magnetic_field_raw.astype(float), axis=1).mean())
    rows = matrix(np.eye(3) / norm)
    made = Provenance(math.nan, "", "before the simulated dive", 0)
    calibration = Calibration(magnetometer=MagnetometerCalibration((0.0, 0.0, 0.0), rows, norm, made))
    return SavedNavigation(at_s=0.0, calibration=calibration.to_json())


def figures(dive: Dive, estimates: Estimates, origin_deg: tuple[float, float] | None) -> PathFigures:
    """Errors from the beginning of the track to its end."""
    on_track = estimates.at_s >= dive.truth.track_start_s
    truth = dive.truth.track(estimates.at_s)
    position = in_truth_frame(estimates, origin_deg, dive.truth)
    errors = estimates.pose_errors(truth.position_ned_m, truth.rotation_ned_frd)
    errors[:, :3] = truth.position_ned_m - position
    errors, covariance = errors[on_track], estimates.pose_covariance[on_track]
    own, true = position[on_track, :2], truth.position_ned_m[on_track, :2]
    heading = estimates.heading_errors_rad(truth.rotation_ned_frd)[on_track]
    position_nees, pose_nees = nees(errors[:, :2], covariance[:, :2, :2]), nees(errors, covariance)
    return PathFigures(
        ate_m(own, true),
        end_error_m(own, true),
        100.0 * end_error_m(own, true) / dive.distance_m(),
        aligned_ate_m(own, true),
        tuple(relative_error_m(own, true, heading, segment) for segment in SEGMENTS_M),
        math.sqrt(float(np.mean(heading**2))),
        share_in_band(position_nees, 2),
        share_in_band(pose_nees, 6),
        float(np.mean(position_nees)),
        float(np.mean(pose_nees)),
        len(own),
    )


def in_truth_frame(
    estimates: Estimates, origin_deg: tuple[float, float] | None, truth: DiveTruth
) -> NDArray[np.float64]:
    """Positions about the simulation's origin: the navigator's own is wherever its first fix was."""
    if origin_deg is None:
        return estimates.position_ned_m
    north_m, east_m, _ = LocalFrame(*truth.origin_deg).to_ned_m(*origin_deg)
    return np.asarray(estimates.position_ned_m + np.array([north_m, east_m, 0.0]))
