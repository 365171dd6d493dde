"""Fixes of every kind on their way into the filter: the first one, the good ones, the wrong ones and the stubborn."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.measurements import HorizontalPosition
from bluerov_slam.navigation.process import Earth, ProcessModel
from bluerov_slam.pipeline.navigator_fix import FixIntake, WanderingPosition
from bluerov_slam.pipeline.navigator_gps import GpsGate, Persistence, Streak
from bluerov_slam.pipeline.navigator_gps_velocity import GpsVelocity
from bluerov_slam.pipeline.navigator_start import (
    UNKNOWN_HEADING_STD_RAD,
    UNKNOWN_POSITION_STD_M,
    compass_prior,
    process_noise,
)
from bluerov_slam.pipeline.navigator_timeline import Snapped
from bluerov_slam.pipeline.navigator_words import Fault, Wait
from bluerov_slam.records import EventLevel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.ekf import Measurement, UpdateResult
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_gps import Fix
    from bluerov_slam.records import GpsFix, PositionFix, SensorSample

    Array = NDArray[np.float64]

# A position that had to be forced shows that velocity and current were wrong as well.
REACQUIRED_VELOCITY_STD_MPS = 0.3
REACQUIRED_CURRENT_STD_MPS = 0.2
# Refused fixes that agree with each other and lie no further off than this are a manoeuvre; beyond, they must persist.
AGREE_WITHIN_M, AGREE_SPEED_MPS = 3.0, 2.0
TURNED_WITHIN_M = 12.0
TURNED_VELOCITY_STD_MPS = 0.5
# The slow error follows the learned scale in steps, and its speed never goes below a fifth.
WANDER_STEP = 0.1
LEAST_WANDER = 0.2
LABELS = {"gps": "GPS", "position": "position fixes"}


class Positions:
    """GPS and outside fixes of one navigator."""

    def __init__(self, core: Core) -> None:
        self._core = core
        options = core.options
        self.gps = GpsGate(options.gps, core.book["gps"])
        self.gps_velocity = GpsVelocity(core)
        self.fixes = FixIntake(options.fix, core.book["position"])
        self._wander_scale = 1.0
        self._refused: dict[str, Streak] = {
            source: Streak(AGREE_WITHIN_M, AGREE_SPEED_MPS) for source in ("gps", "position")
        }
        speed = options.gps.consistent_speed_mps
        self._persistence = {
            "gps": Persistence(options.gps.jump_persists_s, options.gps.consistent_within_m, speed),
            "position": Persistence(options.fix.jump_persists_s, options.gps.consistent_within_m, speed),
        }

    def gps_frame(self, record: GpsFix, travelled_m: float) -> None:
        """A GPS frame."""
        if record.utc_unix_s is not None:
            self._core.place.utc_unix_s = record.utc_unix_s
        fix = self.gps.frame(record, self._core.depth_m(), travelled_m)
        self._gps(fix)
        if fix is not None:
            self.gps_velocity.take(record, fix.at_s)

    def gps_sample(self, record: SensorSample, travelled_m: float) -> None:
        """The position inside SENSORS."""
        self._gps(self.gps.sample(record, self._core.depth_m(), travelled_m))

    def fix(self, record: PositionFix) -> None:
        """A position from outside."""
        stated = self.fixes.take(record)
        if stated is None:
            return
        options = self._core.options.fix
        scale = self._core.book["position"].noise_scale
        self._scale_wander(scale)
        wander = options.std_m**2 * (1.0 - options.white_share**2)
        white = stated.covariance_m2 * options.white_share**2 + _beyond(
            stated.covariance_m2, wander, options.white_share
        )
        white *= scale**2
        self._offer(stated.fix, "position", white, options.lever_arm_frd_m)

    def _scale_wander(self, scale: float) -> None:
        """Learned innovations show how fast the slow error changes, not how large it is: quiet fixes may all be wrong
        by the same metres. So a smaller scale makes it slower; only a larger one makes it larger.
        """
        timeline = self._core.timeline
        if timeline is None or abs(scale / self._wander_scale - 1.0) < WANDER_STEP:
            return
        self._wander_scale = scale
        filter_ = timeline.filter
        noise = process_noise(self._core.options)
        noise = replace(
            noise,
            fix_wander_std_m=noise.fix_wander_std_m * max(scale, 1.0),
            fix_wander_time_s=noise.fix_wander_time_s / min(max(scale, LEAST_WANDER), 1.0) ** 2,
        )
        filter_.process = ProcessModel(filter_.layout, noise, filter_.process.earth)

    def _gps(self, fix: Fix | None) -> None:
        if fix is None:
            return
        options = self._core.options.gps
        wander = options.std_m_per_hdop**2 * (1.0 - options.white_share**2)
        covariance = fix.std_m**2 * np.eye(2)
        white = covariance * options.white_share**2 + _beyond(covariance, wander, options.white_share)
        white *= self._core.book["gps"].noise_scale ** 2
        self._offer(fix, "gps", white, options.lever_arm_frd_m)

    def _offer(
        self,
        fix: Fix,
        source: str,
        white_m2: Array,
        lever_frd_m: tuple[float, float, float],
    ) -> None:
        core = self._core
        if core.timeline is None:
            core.book[source].wait_for(Wait.NO_ATTITUDE, fix.arrived_s)
            return
        core.book[source].wait_for(None, fix.arrived_s)
        if core.place.frame is None:
            self._settle(fix)
        north_m, east_m = core.place.offset_m(fix.latitude_deg, fix.longitude_deg)
        wanders_like_gps = source == "gps"
        position = HorizontalPosition(fix.at_s, north_m, east_m, white_m2, source, lever_frd_m, wanders_like_gps)
        measurement: Measurement = position if wanders_like_gps else WanderingPosition(position)

        done = partial(self._done, fix=fix, source=source, place_ne_m=(north_m, east_m), measurement=measurement)
        core.timeline.offer(measurement, done, gated=core.position_known)

    def _done(
        self, result: UpdateResult, fix: Fix, source: str, place_ne_m: tuple[float, float], measurement: Measurement
    ) -> None:
        core = self._core
        core.account(result)
        core.book[source].changed = True
        if result.accepted:
            self._persistence[source].forget()
            self._refused[source].end()
            if not core.position_known:
                core.position_known = True
                core.say(f"Position known, from {LABELS[source]}")
            core.last_fix_s = result.at_s
            return
        if source == "gps":
            core.book[source].refuse(Fault.GPS_JUMP, fix.arrived_s)
        if source == "position" and self._turned(result, fix, measurement):
            return
        if self._persistence[source].refused(fix):
            self._reacquire(source, place_ne_m, measurement)

    def _turned(self, result: UpdateResult, fix: Fix, measurement: Measurement) -> bool:
        """Two fixes in a row that were refused and agree: not echoes, but a vehicle that turned or stopped."""
        core, streak = self._core, self._refused["position"]
        off_m = float(np.sqrt(result.residual @ result.residual))
        streak.add(fix)
        if streak.length < 2 or off_m > TURNED_WITHIN_M or core.timeline is None:
            return False
        streak.end()
        core.timeline.buffer.add_uncertainty("position", (off_m, off_m, 0.0))
        core.timeline.buffer.add_uncertainty("velocity", (TURNED_VELOCITY_STD_MPS, TURNED_VELOCITY_STD_MPS, 0.0))
        core.timeline.offer(Snapped(measurement, core.timeline.at_s), core.account)
        core.last_fix_s = core.timeline.at_s
        self._persistence["position"].forget()
        return True

    def _settle(self, fix: Fix) -> None:
        """The first position: the origin, true north, and with it the heading."""
        core = self._core
        turn_rad = core.place.settle(fix.latitude_deg, fix.longitude_deg)
        align(core, turn_rad)

    def _reacquire(self, source: str, place_ne_m: tuple[float, float], measurement: Measurement) -> None:
        """The track was wrong: believe the fixes, and say so."""
        core = self._core
        assert core.timeline is not None
        filter_, buffer = core.timeline.filter, core.timeline.buffer
        north, east, down = filter_.estimate.position_ned_m.tolist()
        down_std = float(filter_.std("position")[2])
        buffer.reset_block("position", (*place_ne_m, down), (UNKNOWN_POSITION_STD_M, UNKNOWN_POSITION_STD_M, down_std))
        core.timeline.shift_ne_m[0] += place_ne_m[0] - north
        core.timeline.shift_ne_m[1] += place_ne_m[1] - east
        buffer.add_uncertainty("velocity", (REACQUIRED_VELOCITY_STD_MPS, REACQUIRED_VELOCITY_STD_MPS, 0.0))
        buffer.add_uncertainty("current", REACQUIRED_CURRENT_STD_MPS)
        # As of now: at its own instant it would come before the reset.
        core.timeline.offer(Snapped(measurement, core.timeline.at_s), core.account, gated=False)
        core.last_fix_s = core.timeline.at_s
        core.reset_counter += 1
        for persistence in self._persistence.values():
            persistence.forget()
        moved_m = float(np.hypot(place_ne_m[0] - north, place_ne_m[1] - east))
        core.say(
            f"The position was moved by {moved_m:.0f} m to the {LABELS[source]}, which stayed there although they "
            "contradicted the track",
            EventLevel.WARNING,
        )


def align(core: Core, turn_rad: float) -> None:
    """True north has become known: turn the heading by the declination and let the compass say it anew."""
    if core.timeline is None:
        return
    filter_ = core.timeline.filter
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    tilt_std = filter_.std("attitude")[:2]
    buffer = core.timeline.buffer
    buffer.reset_block(
        "attitude", turn @ filter_.estimate.rotation_ned_frd, (*tilt_std.tolist(), UNKNOWN_HEADING_STD_RAD)
    )
    values, std = compass_prior(core.options, core.calibration, declination_known=True)
    buffer.reset_block("compass", values, std)
    buffer.reset_block("compass_wander", 0.0, core.options.compass.wander_std_rad)
    filter_.set_earth(Earth(core.place.latitude_deg))


def _beyond(covariance_m2: Array, wander_m2: float, white_share: float) -> Array:
    """What of the slow error is larger than the wander that the filter knows: counted as white."""
    slow = covariance_m2 * (1.0 - white_share**2) - wander_m2 * np.eye(2)
    values, vectors = np.linalg.eigh(slow)
    beyond: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return beyond
