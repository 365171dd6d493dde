"""Going on after a restart: what was saved, older by the time that passed and less certain by what may have been."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.navigation_aid import BEACON, MOUNTING, WANDER
from bluerov_slam.navigation.rotation import quaternion_from_rotation
from bluerov_slam.pipeline.navigator_commands import SavedNavigation
from bluerov_slam.pipeline.navigator_start import (
    UNKNOWN_DEPTH_STD_M,
    UNKNOWN_HEADING_STD_RAD,
    UNKNOWN_VELOCITY_STD_MPS,
)
from bluerov_slam.records import EventLevel

if TYPE_CHECKING:
    from bluerov_slam.navigation.ekf import ErrorStateFilter
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_start import Start

LEAST_ADDED_M = 1.0
# What the filter estimates only with an acoustic array.
OPTIONAL = frozenset((MOUNTING, WANDER, BEACON, "sound_speed_scale"))


def save(core: Core, surface_pressure_pa: float | None, distance_m: float) -> SavedNavigation:
    """Everything that a restart needs, as plain numbers."""
    calibration = core.calibration.to_json()
    if core.timeline is None:
        return SavedNavigation(
            at_s=core.now_s,
            origin_deg=core.place.origin_deg,
            surface_pressure_pa=surface_pressure_pa,
            calibration=calibration,
        )
    filter_ = core.timeline.filter
    return SavedNavigation(
        at_s=core.timeline.at_s,
        origin_deg=core.place.origin_deg,
        position_known=core.position_known,
        quaternion_ned_frd=quaternion_from_rotation(filter_.estimate.rotation_ned_frd),
        layout=filter_.layout.blocks,
        values=tuple(filter_.estimate.values.tolist()),
        covariance=tuple(filter_.covariance[np.triu_indices(filter_.layout.size)].tolist()),
        last_fix_s=core.last_fix_s,
        surface_pressure_pa=surface_pressure_pa,
        distance_m=distance_m,
        reset_counter=core.reset_counter,
        calibration=calibration,
    )


def age_of(saved: SavedNavigation, stated_s: float | None, first_record_s: float, at_s: float) -> float | None:
    """How long ago it was saved, seconds; None where that cannot be true."""
    age_s = at_s - saved.at_s if stated_s is None else stated_s + (at_s - first_record_s)
    return age_s if math.isfinite(age_s) and age_s >= 0.0 else None


def resume(core: Core, filter_: ErrorStateFilter, saved: SavedNavigation, age_s: float | None, start: Start) -> bool:
    """Put what was saved into a fresh filter. False, with an event, where it is of no use."""
    if not saved.values or not saved.position_known or saved.origin_deg is None:
        return False
    if age_s is None or age_s > core.options.save_limit_s:
        old = "an unknown time" if age_s is None else f"{age_s / 60.0:.0f} minutes"
        core.say(
            f"The saved position is {old} old and is not used: the vehicle may have been moved", EventLevel.WARNING
        )
        return False
    # A block that an array brings with it may have come or gone since: the others are what they were.
    here = {name: filter_.layout[name] for name, _ in filter_.layout.blocks}
    covariance = filter_.covariance.copy()
    there = _places(saved.layout)
    shared = [name for name in there if name in here]
    fits = (set(there) ^ set(here)) <= OPTIONAL and all(len(there[name]) == _size(here[name]) for name in shared)
    if fits:
        whole = np.zeros((len(saved.values), len(saved.values)))
        whole[np.triu_indices(len(saved.values))] = saved.covariance
        whole += np.triu(whole, 1).T
        ours = np.concatenate([np.arange(here[name].start, here[name].stop) for name in shared])
        theirs = np.concatenate([np.array(there[name]) for name in shared])
        covariance[np.ix_(ours, ours)] = whole[np.ix_(theirs, theirs)]
    if not fits or not _is_covariance(covariance):
        core.say("The saved position is damaged or of another version and is not used", EventLevel.WARNING)
        return False
    filter_.estimate.values[ours] = np.array(saved.values)[theirs]
    filter_.covariance = covariance
    _grow(core, filter_, age_s)
    added_m = LEAST_ADDED_M + core.options.resume_speed_mps * age_s
    down = float(filter_.estimate.values[2])
    filter_.add_uncertainty("position", (added_m, added_m, UNKNOWN_DEPTH_STD_M))
    filter_.reset_block("velocity", (0.0, 0.0, 0.0), UNKNOWN_VELOCITY_STD_MPS)
    filter_.reset_block(
        "attitude", start.rotation_ned_frd, (start.tilt_std_rad, start.tilt_std_rad, UNKNOWN_HEADING_STD_RAD)
    )
    filter_.estimate.values[2] = down
    core.position_known = True
    core.last_fix_s = saved.last_fix_s
    core.reset_counter = saved.reset_counter + 1
    core.say(
        f"Going on from the position of {age_s:.0f} s ago. The vehicle may have moved by {added_m:.0f} m since; its "
        "uncertainty says so until the next fix"
    )
    return True


def _places(layout: tuple[tuple[str, int], ...]) -> dict[str, range]:
    places, start = {}, 0
    for name, size in layout:
        places[name] = range(start, start + size)
        start += size
    return places


def _size(place: slice) -> int:
    return int(place.stop - place.start)


def _grow(core: Core, filter_: ErrorStateFilter, age_s: float) -> None:
    """What wandered meanwhile, for every state with a process of its own."""
    process = filter_.process
    diagonal = filter_.covariance.reshape(-1)[:: filter_.layout.size + 1]
    diagonal += process.noise.walks(filter_.layout) * age_s
    for name, std, time_s in process.noise.wanders():
        if name in filter_.layout:
            place, decay = filter_.layout[name], math.exp(-age_s / time_s)
            filter_.estimate.values[place] *= decay
            filter_.covariance[place, :] *= decay
            filter_.covariance[:, place] *= decay
            diagonal[place] += std * std * (1.0 - decay * decay)


def _is_covariance(matrix: np.ndarray) -> bool:
    try:
        np.linalg.cholesky(matrix + 1e-12 * np.eye(len(matrix)))
    except np.linalg.LinAlgError:
        return False
    return True
