"""N7: a Doppler log's and a heading's error found by three position fixes, on real tracks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.snapir_tracks import InjectedErrors, as_measured, plain_integration
from bluerov_slam.evaluation.trajectory import end_error_percent
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.navigator import Navigator, NavigatorOptions
from bluerov_slam.pipeline.navigator_options import CompassOptions, DvlOptions, ImuOptions
from bluerov_slam.records import NavState, PositionFix

if TYPE_CHECKING:
    from bluerov_slam.evaluation.snapir_tracks import SnapirTrack
    from bluerov_slam.pipeline.navigator_commands import SavedNavigation

FIX_STD_M = 0.5
_NEVER = 1e-4

# The installation as its owner would describe it: a navigation-grade attitude whose heading may be a few degrees off
# by a constant, and a Doppler log of which only the scale is unknown.
OPTIONS = NavigatorOptions(
    imu=ImuOptions(
        angle_tilt_std_rad=math.radians(0.1),
        angle_heading_std_rad=math.radians(0.1),
        kinematic_velocity_walk_mps=0.5,  # 2 m/s turning at 12 deg/s is 0.4 m/s2: no ROV's motion
    ),
    compass=CompassOptions(
        deviation_std_rad=(math.radians(3.0), _NEVER, _NEVER),
        uncalibrated_deviation_std_rad=(math.radians(3.0), _NEVER, _NEVER),
        wander_std_rad=_NEVER,
    ),
    dvl=DvlOptions(std_mps=0.02, std_per_mps=0.0, scale_std=0.015, yaw_std_rad=_NEVER),
)


@dataclass(frozen=True, slots=True)
class SnapirFigures:
    """`end_percent`: before the last fix, causal; `after_percent`: with it. Errors are estimated minus injected."""

    end_percent: float
    after_percent: float
    plain_percent: float
    plain_clean_percent: float
    heading_error_rad: float
    heading_std_rad: float
    scale_error: float
    scale_std: float


def snapir_figures(track: SnapirTrack, seed: int) -> SnapirFigures:
    """One track, with the noise of its three fixes by seed."""
    injected = InjectedErrors()
    navigator = Navigator(OPTIONS)
    before: NavState | None = None
    state: NavState | None = None
    fixes = 0
    for record in as_measured(track, injected, FIX_STD_M, np.random.default_rng([seed, track.number, 0x57])):
        if isinstance(record, PositionFix):
            fixes += 1
            before = state
        for output in navigator.feed(record):
            state = output if isinstance(output, NavState) else state
    assert fixes == 3
    assert before is not None
    assert state is not None
    saved = navigator.save()
    compass, compass_std = _first_of(saved, "compass")
    scale, scale_std = _first_of(saved, "dvl")
    truth = track.position_ned_m[:, :2]
    return SnapirFigures(
        _end_percent(track, before),
        _end_percent(track, state),
        end_error_percent(plain_integration(track, injected), truth),
        end_error_percent(plain_integration(track, InjectedErrors(0.0, 0.0)), truth),
        compass - injected.heading_rad,
        compass_std,
        scale - injected.scale,
        scale_std,
    )


def _first_of(saved: SavedNavigation, block: str) -> tuple[float, float]:
    """First value of a block of the error state, and its standard deviation."""
    sizes = dict(saved.layout)
    names = [name for name, _ in saved.layout]
    place = sum(sizes[name] for name in names[: names.index(block)])
    states = len(saved.values)
    diagonal = sum(states - row for row in range(place))  # the covariance is kept row by row from its diagonal on
    return saved.values[place], math.sqrt(saved.covariance[diagonal])


def _end_percent(track: SnapirTrack, state: NavState) -> float:
    assert state.position_ned_m is not None
    assert state.origin_deg is not None
    north, east, _ = LocalFrame(*track.origin_deg).to_ned_m(*state.origin_deg)
    estimate = np.array([state.position_ned_m[0] + north, state.position_ned_m[1] + east])
    truth = track.truth_ne_m(np.array([state.measured_s]))[0]
    return 100.0 * float(math.hypot(*(estimate - truth))) / track.distance_m
