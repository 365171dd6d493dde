"""Under water from end to end: a lawnmower of a kilometre, GPS at its start, then nothing but a transmitter.

The dive is that of the navigation cases under hard conditions (unknown current, thrust scale, compass deviation, IMU
and magnetometer with their errors), so the attitude's error is the navigator's own. The transmitter stands 10 m below
the vehicle in the middle of the field: row (i) of the study, whose bound is 1.9 m at one pulse in five seconds.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.evaluation.bounds import Beacon, Fixes, bound
from bluerov_slam.evaluation.dive_bounds import GYRO, true_track, uncertainty_of
from bluerov_slam.evaluation.navigation_run import run_navigator
from bluerov_slam.evaluation.simulated_dive import Dive, PathFigures, figures, saved_before, simulate
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.pipeline.navigator_options import NavigatorOptions
from bluerov_slam.simulation import instrument_errors
from bluerov_slam.simulation.acoustic_pings import PingErrors, PingPlan, SimulatedPings
from bluerov_slam.simulation.dive_plan import DIVE_PLANS

if TYPE_CHECKING:
    from bluerov_slam.records import Record

PLAN = replace(DIVE_PLANS["n3"], name="acoustic", afloat_first_s=60.0, afloat_last_s=0.0, depth_m=5.0)
BEACON_NED_M = (90.0, 40.0, 15.0)
# The study knows the transmitter's place exactly. Here its user does, and says so; the place is off by that much.
BEACON_STD_M = 0.1
EVERY_S = 5.0
# A cross that looks down, and a fifth receiver on a stalk below it: directions near the array's plane are seen, too.
ARRAY = ReceiverArray(np.vstack((ReceiverArray.cross().positions_m, (0.25, 0.0, 0.0))), name="cross with stalk")
MOUNTING_RAD = (0.0, -math.pi / 2.0, 0.0)
LEVER_FRD_M = (0.1, 0.0, 0.2)
ERRORS = PingErrors(beacon_m=BEACON_STD_M)
_STEP_S = 1.0


@dataclass(frozen=True, slots=True)
class AcousticDiveOutcome:
    """One seed. `bound_m`: smoothed, with white direction noise alone, no echoes, no bias."""

    seed: int
    causal: PathFigures
    smoothed: PathFigures | None
    bound_m: float
    accepted: int
    rejected: int
    nis_ratio: float
    fixed_only: PathFigures | None = None


def options() -> NavigatorOptions:
    """The navigator's defaults with an array on board, in water known to be mixed: the pings come straight."""
    return NavigatorOptions(
        acoustics=AcousticOptions(
            array=ARRAY,
            mounting=_mounting(),
            beacon_std_m=BEACON_STD_M,
            beacon_depth_std_m=BEACON_STD_M,
            sound_speed_fixed=True,
        )
    )


def _mounting() -> ArrayMounting:
    return ArrayMounting(rotation_from_euler(*MOUNTING_RAD), np.array(LEVER_FRD_M))


def acoustic_dive(seed: int, errors: PingErrors | None = None, smooth: bool = False) -> AcousticDiveOutcome:
    """Dive, hear, navigate, judge. The smoothed track is that of a second pass, as `navigate` makes it."""
    dive = simulate(PLAN, seed, None)
    pings = list(pings_of(dive, seed, errors))
    navigator = Navigator(options(), saved_before(dive))
    run = run_navigator(merged(dive.records, pings), navigator, smooth)
    smoothed = None
    if smooth:
        second = Navigator(options(), saved_before(dive))
        smoothed = run_navigator(merged(dive.records, pings), second, smooth, navigator.smoothed()).smoothed
    heard = run.nis["acoustics"]
    return AcousticDiveOutcome(
        seed,
        figures(dive, run.causal, run.origin_deg),
        None if smoothed is None else figures(dive, smoothed, run.origin_deg),
        dive_bound_m(dive, (errors or ERRORS).direction_rad),
        heard.accepted,
        heard.rejected,
        heard.nis / max(heard.dof, 1),
    )


def pings_of(dive: Dive, seed: int, errors: PingErrors | None = None) -> Iterator[Record]:
    """The array's reports."""
    latitude_deg, longitude_deg, _ = LocalFrame(*dive.truth.origin_deg).to_geodetic(*BEACON_NED_M[:2])
    plan = PingPlan(BEACON_NED_M, EVERY_S, largest_range_m=110.0)
    stated = (latitude_deg, longitude_deg, BEACON_NED_M[2])
    return SimulatedPings(dive.truth, plan, ARRAY, _mounting(), stated, seed, errors or ERRORS).reports()


def merged(records: Sequence[Record], others: Iterable[Record]) -> Iterator[Record]:
    """In order of arrival."""
    return heapq.merge(records, others, key=lambda record: getattr(record, "arrived_s", 0.0))


def dive_bound_m(dive: Dive, direction_rad: float) -> float:
    """ATE bound of this very track with a beacon."""
    truth = dive.truth
    times = np.arange(truth.start_s, truth.end_s + 1e-9, _STEP_S)
    track = true_track(truth.track(times), truth.track(times[:-1] + 0.5 * _STEP_S), over_ground=False)
    steps = sorted({round((at_s - truth.start_s) / _STEP_S) for at_s in dive.gps_times_s() if at_s <= times[-1]})
    fixes = Fixes(steps, instrument_errors.GPS_WHITE_M, instrument_errors.GPS_WANDER_M, 60.0)
    beacon = Beacon(BEACON_NED_M[:2], BEACON_NED_M[2] - PLAN.depth_m, direction_rad, round(EVERY_S / _STEP_S))
    first = round((truth.track_start_s - truth.start_s) / _STEP_S)
    epochs = np.unique(np.append(np.arange(first, track.steps + 1, 10), track.steps))
    return bound(track, uncertainty_of(dive.plan), fixes, beacon, GYRO, epochs).ate_m
