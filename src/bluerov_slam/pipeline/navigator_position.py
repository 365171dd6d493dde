"""Fixes of every kind on their way into the filter: the first one, the good ones, the wrong ones and the stubborn."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.measurements import HorizontalPosition
from bluerov_slam.navigation.process import Earth, ProcessModel
from bluerov_slam.pipeline.navigator_fix import FIX_WANDER, FixIntake, WanderingPosition
from bluerov_slam.pipeline.navigator_gps import GpsGate, Streak
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
# Refused fixes agree where the vehicle can have gone from one to the next; after a gap anything could, so not further
# than this. Two in a row that lie near are a manoeuvre, and no echoes; further off it takes more, and time.
AGREE_WITHIN_M, AGREE_SPEED_MPS, AGREE_MOST_M, AGREE_GAP_S = 3.0, 2.0, 10.0, 30.0
TURNED_WITHIN_M = 12.0
TURNED_VELOCITY_STD_MPS = 0.5
MOVED_AT_LEAST = 3
# The slow error follows the learned scale in steps, and its speed never goes below a tenth.
WANDER_STEP = 0.1
LEAST_WANDER = 0.1
# What a source states is followed in steps, too.
RESTATED = 0.02
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
        self._wander_m: Array | None = None
        gps = options.gps
        self._refused = {
            "gps": Streak(gps.consistent_within_m, gps.consistent_speed_mps),
            "position": Streak(AGREE_WITHIN_M, AGREE_SPEED_MPS, AGREE_GAP_S, AGREE_MOST_M),
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
        core, options = self._core, self._core.options.fix
        scale = core.book["position"].noise_scale
        self._pace_wander(scale)
        # What this fix states beyond the usual is its own, so it is white.
        slow_share2 = 1.0 - options.white_share**2
        white_m2 = stated.covariance_m2 * options.white_share**2
        white_m2 += _beyond(stated.covariance_m2 - stated.usual_m2) * slow_share2
        white_m2 *= scale**2
        self._restate_wander(_root(stated.usual_m2 * slow_share2) * max(scale, 1.0))
        self._offer(stated.fix, "position", white_m2, options.lever_arm_frd_m, self._wander_m)

    def _restate_wander(self, wander_m: Array) -> None:
        """The source states another error: then the slow error so far has grown (or shrunk) with it, and the position
        that was taken from its fixes is as wrong. What is expected of the next fix stays the same.
        """
        before_m, timeline = self._wander_m, self._core.timeline
        if before_m is not None and np.abs(wander_m - before_m).max() < RESTATED * np.abs(before_m).max():
            return
        self._wander_m = wander_m
        if before_m is None or timeline is None:
            return
        values = np.linalg.solve(wander_m, before_m @ timeline.filter.estimate.block(FIX_WANDER))
        share = np.zeros((3, 2))
        share[:2] = before_m - wander_m
        timeline.buffer.mix_errors("position", FIX_WANDER, share, values)

    def _pace_wander(self, scale: float) -> None:
        """Learned innovations show how fast the slow error changes, not how large it is: quiet fixes may all be wrong
        by the same metres. So a smaller scale makes it slower; only a larger one makes it larger.
        """
        timeline = self._core.timeline
        if timeline is None or abs(scale / self._wander_scale - 1.0) < WANDER_STEP:
            return
        self._wander_scale = scale
        filter_ = timeline.filter
        noise = replace(process_noise(self._core.options), fix_wander_time_s=self._wander_time_s())
        filter_.process = ProcessModel(filter_.layout, noise, filter_.process.earth)

    def _wander_time_s(self) -> float:
        return self._core.options.fix.wander_time_s / min(max(self._wander_scale, LEAST_WANDER), 1.0) ** 2

    def _gps(self, fix: Fix | None) -> None:
        if fix is None:
            return
        options = self._core.options.gps
        wander = options.std_m_per_hdop**2 * (1.0 - options.white_share**2)
        covariance = fix.std_m**2 * np.eye(2)
        white = covariance * options.white_share**2
        white += _beyond(covariance * (1.0 - options.white_share**2) - wander * np.eye(2))
        white *= self._core.book["gps"].noise_scale ** 2
        self._offer(fix, "gps", white, options.lever_arm_frd_m)

    def _offer(
        self,
        fix: Fix,
        source: str,
        white_m2: Array,
        lever_frd_m: tuple[float, float, float],
        wander_m: Array | None = None,
    ) -> None:
        """`wander_m`: the slow error of fixes from outside; GPS has its own."""
        core = self._core
        if core.timeline is None:
            core.book[source].wait_for(Wait.NO_ATTITUDE, fix.arrived_s)
            return
        core.book[source].wait_for(None, fix.arrived_s)
        if core.place.frame is None:
            self.settle(fix)
        place_ne_m = core.place.offset_m(fix.latitude_deg, fix.longitude_deg)
        position = HorizontalPosition(fix.at_s, *place_ne_m, white_m2, source, lever_frd_m, wander_m is None)
        measurement: Measurement = position
        if wander_m is not None:
            measurement = WanderingPosition(position, wander_m)
            core.pace.compare(fix.at_s, np.array(place_ne_m), white_m2, wander_m @ wander_m.T, self._wander_time_s())
        done = partial(self._done, fix=fix, source=source, place_ne_m=place_ne_m, measurement=measurement)
        core.timeline.offer(measurement, done, gated=core.position_known)

    def _done(
        self, result: UpdateResult, fix: Fix, source: str, place_ne_m: tuple[float, float], measurement: Measurement
    ) -> None:
        core = self._core
        core.account(result)
        core.book[source].changed = True
        if result.accepted:
            self._refused[source].end()
            if not core.position_known:
                core.position_known = True
                core.position_since_s = core.now_s
                core.say(f"Position known, from {LABELS[source]}")
            core.last_fix_s = result.at_s
            if source == "position":
                self._forecast(place_ne_m, measurement)
            return
        if source == "gps":
            core.book[source].refuse(Fault.GPS_JUMP, fix.arrived_s)
        self._refused[source].add(fix)
        if source == "position" and self._turned(result, measurement):
            return
        if self._stays(source):
            self._reacquire(source, place_ne_m, measurement)

    def _forecast(self, place_ne_m: tuple[float, float], measurement: Measurement) -> None:
        """Remember what is expected from here on, where no sensor of motion will tell."""
        core = self._core
        if core.motion_measured or core.timeline is None:
            return
        filter_ = core.timeline.filter
        innovation = measurement.evaluate(filter_.estimate, filter_.layout)
        if innovation is not None:
            core.pace.begin(filter_, np.array(place_ne_m), innovation)

    def _turned(self, result: UpdateResult, measurement: Measurement) -> bool:
        """Fixes in a row that were refused, agree and lie near: not echoes, but a vehicle that turned or stopped."""
        core, streak = self._core, self._refused["position"]
        off_m = float(np.sqrt(result.residual @ result.residual))
        if streak.length < 2 or off_m > TURNED_WITHIN_M or core.timeline is None:
            return False
        streak.end()
        core.timeline.buffer.add_uncertainty("position", (off_m, off_m, 0.0))
        core.timeline.buffer.add_uncertainty("velocity", (TURNED_VELOCITY_STD_MPS, TURNED_VELOCITY_STD_MPS, 0.0))
        core.timeline.offer(Snapped(measurement, core.timeline.at_s), core.account)
        core.last_fix_s = core.timeline.at_s
        return True

    def _stays(self, source: str) -> bool:
        """Whether refused fixes have agreed with each other for so long that they must be believed."""
        options, streak = self._core.options, self._refused[source]
        if source == "gps":
            return streak.lasts_s >= options.gps.jump_persists_s
        persists_s = options.fix.jump_persists_s
        if not self._core.motion_measured:
            persists_s = options.fix.jump_persists_unaided_s
        return streak.length >= MOVED_AT_LEAST and streak.lasts_s >= persists_s

    def settle(self, fix: Fix) -> None:
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
        core.pace.hold()
        for streak in self._refused.values():
            streak.end()
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


def _beyond(excess_m2: Array) -> Array:
    """The part of a difference of covariances that is above zero."""
    values, vectors = np.linalg.eigh(excess_m2)
    beyond: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return beyond


def _root(covariance_m2: Array) -> Array:
    """The symmetric root of a covariance."""
    values, vectors = np.linalg.eigh(covariance_m2)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root
