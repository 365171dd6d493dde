"""The acoustic array's pulses on their way into the filter, as delays against what the estimate predicts.

The first position comes from a whole fix, where nothing else has told one; from then on only the delays count.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.navigation_aid import BEACON, AcousticDelays, AidOptions, Verdict
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.measurements import HorizontalPosition
from bluerov_slam.pipeline.acoustic_bend import AcousticBend
from bluerov_slam.pipeline.navigator_gps import Fix
from bluerov_slam.pipeline.navigator_words import Wait

if TYPE_CHECKING:
    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.pipeline.acoustic_options import AcousticOptions
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_depth import DepthIntake
    from bluerov_slam.pipeline.navigator_position import Positions
    from bluerov_slam.pipeline.smoothed_poses import SmoothedPoses
    from bluerov_slam.records import AcousticFix, CtdSample

SENSOR: Final = "acoustics"
# A transmitter that states a place this far from its last one has moved: what was learned of the old one is void.
MOVED_M: Final = 1.0
# One pulse may have come by an echo, or be another transmitter's: so many must agree before a dive begins with them.
AGREEING: Final = 3
AGREE_STD: Final = 3.0
FASTEST_MPS: Final = 2.0
# A sensor that took its zero by itself did so on deck or afloat. A BlueROV2 is 0.25 m high and floats awash, its
# pressure sensor 0.1 to 0.2 m down: half of that is left out of every depth, and the stated error of the zero has room
# for the rest. Range is read out of elevation and depth, so that 0.1 m of 10 is a whole per cent of it.
ZEROED_BELOW_M: Final = 0.1
# A timing better than this is no measured one: the rest of the receivers' errors is larger.
LEAST_TIMING_S: Final = 2e-8


class AcousticIntake:
    """AcousticFix in; the account is the sensor `acoustics`."""

    def __init__(self, core: Core, positions: Positions, options: AcousticOptions, depth: DepthIntake) -> None:
        self._core = core
        self._positions = positions
        self._options = options
        self._depth = depth
        self._stated: tuple[float, float, float] | None = None
        self._pending: Verdict | None = None
        self._first: deque[AcousticFix] = deque(maxlen=AGREEING)
        self._bend = AcousticBend()
        # Offline, in a second pass: where the vehicle was.
        self.poses: SmoothedPoses | None = None

    def water(self, record: CtdSample) -> None:
        """What the CTD says of the water that the sound comes through."""
        self._bend.water(record)

    def take(self, record: AcousticFix) -> None:
        """One pulse, good or not."""
        core, status = self._core, self._core.book[SENSOR]
        status.hear(record.arrived_s)
        self._look_back(record.arrived_s)
        beacon = record.beacon_deg_m
        if core.timeline is None:
            status.wait_for(Wait.NO_ATTITUDE, record.arrived_s)
        elif beacon is None or beacon[2] is None:
            status.wait_for(Wait.NO_BEACON, record.arrived_s)
        elif not record.accepted and not record.alternatives:
            return  # the pipeline's own word says why
        elif not core.position_known or core.place.frame is None:
            status.wait_for(Wait.NO_ORIGIN, record.arrived_s)
            if record.accepted:
                self._begin_with(record)
        else:
            status.wait_for(None, record.arrived_s)
            self._offer(record, (beacon[0], beacon[1], beacon[2]))

    def _begin_with(self, record: AcousticFix) -> None:
        """The first position of a dive that no GPS saw begin."""
        core = self._core
        if record.position_deg is None or record.covariance_ned_m2 is None or not core.heading_known():
            return
        assert core.timeline is not None
        self._first.append(record)
        if len(self._first) < AGREEING or not all(_agree(record, other) for other in self._first):
            return
        covariance = np.array(record.covariance_ned_m2)[:2, :2]
        if core.place.frame is None:
            std_m = math.sqrt(0.5 * float(covariance.trace()))
            self._positions.settle(Fix(record.measured_s, record.arrived_s, *record.position_deg, std_m))
        north_m, east_m = core.place.offset_m(*record.position_deg)
        first = HorizontalPosition(record.measured_s, north_m, east_m, covariance, SENSOR, wanders=False)
        core.timeline.offer(first, self._begun, gated=False)

    def _begun(self, result: UpdateResult) -> None:
        if result.accepted and not self._core.position_known:
            self._core.position_known = True
            self._core.say("Position known, from the acoustic array")
        self._done(result)

    def _offer(self, record: AcousticFix, beacon: tuple[float, float, float]) -> None:
        core, options = self._core, self._options
        assert core.timeline is not None
        filter_ = core.timeline.filter
        north_m, east_m = core.place.offset_m(beacon[0], beacon[1])
        place_std_m = record.beacon_std_m if record.beacon_std_m is not None else options.beacon_std_m
        self._follow(beacon, place_std_m)
        covariance = np.array(record.delay_covariance_s2, dtype=np.float64)
        covariance += LEAST_TIMING_S**2 * np.eye(len(covariance))
        self._pending = verdict = Verdict()
        about = None if self.poses is None else self.poses(record.measured_s)
        seen_from_ned_m = filter_.estimate.position_ned_m if about is None else about.position_ned_m
        north, east, down = seen_from_ned_m.tolist()
        # The filter's own depth is counted from where the sensor was zeroed.
        beacon_down_m = beacon[2] - (ZEROED_BELOW_M if self._depth.zeroed_afloat else 0.0)
        bend, bend_std = 0.0, 0.0
        if not options.sound_speed_fixed:
            bend, bend_std = self._bend.of(down, beacon[2], math.hypot(north_m - north, east_m - east))
        measurement = AcousticDelays(
            at_s=record.measured_s,
            receivers_m=options.array.subset(record.receivers),
            delays_s=np.array(record.delays_s),
            covariance_s2=covariance,
            sound_speed_mps=record.sound_speed_mps,
            beacon_ned_m=np.array((north_m, east_m, beacon_down_m)),
            mounting=options.mounting,
            beacon_covariance_m2=np.diag((place_std_m**2, place_std_m**2, options.beacon_depth_std_m**2)),
            alternatives=tuple((np.array(delays), share) for delays, share in record.alternatives),
            options=AidOptions(core.book[SENSOR].noise_scale * options.direction_std_rad, options.outlier_share),
            covariance_of=lambda: filter_.covariance,
            about=about,
            bend_rad=bend,
            bend_std_rad=bend_std,
            verdict=verdict,
        )
        core.timeline.offer(measurement, self._done)
        self._look_back(record.arrived_s)

    def _follow(self, beacon: tuple[float, float, float], std_m: float) -> None:
        """Where the transmitter is by its own word; a new place has nothing of the error of the old one."""
        core, before = self._core, self._stated
        self._stated = beacon
        if before is None or core.timeline is None:
            return
        level_m = math.dist(core.place.offset_m(*beacon[:2]), core.place.offset_m(*before[:2]))
        if max(level_m, abs(beacon[2] - before[2])) > MOVED_M:
            core.timeline.buffer.reset_block(BEACON, (0.0, 0.0, 0.0), (std_m, std_m, self._options.beacon_depth_std_m))
        else:
            self._stated = before

    def _look_back(self, now_s: float) -> None:
        """A pulse that was left out as ambiguous comes to no result: it is found here."""
        if self._pending is not None and self._pending.hypothesis < 0:
            self._pending = None
            self._core.book[SENSOR].wait_for(Wait.AMBIGUOUS_PULSE, now_s)

    def _done(self, result: UpdateResult) -> None:
        core = self._core
        self._pending = None
        core.account(result)
        if result.accepted:
            core.last_fix_s = result.at_s if core.last_fix_s is None else max(core.last_fix_s, result.at_s)


def _agree(one: AcousticFix, other: AcousticFix) -> bool:
    """Whether one vehicle can have been at both places."""
    assert one.position_deg is not None
    assert one.covariance_ned_m2 is not None
    assert other.position_deg is not None
    assert other.covariance_ned_m2 is not None
    north_m, east_m, _ = LocalFrame(*one.position_deg).to_ned_m(*other.position_deg)
    spread_m2 = float((np.array(one.covariance_ned_m2) + np.array(other.covariance_ned_m2))[:2, :2].trace())
    moved_m = FASTEST_MPS * abs(one.measured_s - other.measured_s)
    return math.hypot(north_m, east_m) < AGREE_STD * math.sqrt(spread_m2) + moved_m
