"""The acoustic array's pulses on their way into the filter, as delays against what the estimate predicts.

The first position comes from a whole fix, where nothing else has told one; from then on only the delays count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.navigation_aid import AcousticDelays
from bluerov_slam.pipeline.navigator_words import Wait
from bluerov_slam.records import PositionFix

if TYPE_CHECKING:
    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.pipeline.acoustic_options import AcousticOptions
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_position import Positions
    from bluerov_slam.records import AcousticFix

SENSOR: Final = "acoustics"
# A transmitter on a line hangs and swings by so much.
BEACON_DEPTH_STD_M: Final = 0.3


class AcousticIntake:
    """AcousticFix in; the account is the sensor `acoustics`."""

    def __init__(self, core: Core, positions: Positions, options: AcousticOptions) -> None:
        self._core = core
        self._positions = positions
        self._options = options

    def take(self, record: AcousticFix) -> None:
        """One pulse, good or not."""
        core, status = self._core, self._core.book[SENSOR]
        status.hear(record.arrived_s)
        beacon = record.beacon_deg_m
        if core.timeline is None:
            status.wait_for(Wait.NO_ATTITUDE, record.arrived_s)
        elif beacon is None or beacon[2] is None:
            status.wait_for(Wait.NO_BEACON, record.arrived_s)
        elif not record.accepted and not record.alternatives:
            return  # the pipeline's own word says why
        elif not core.position_known or core.place.frame is None:
            status.wait_for(Wait.NO_ORIGIN, record.arrived_s)
            self._begin_with(record)
        else:
            status.wait_for(None, record.arrived_s)
            self._offer(record, (beacon[0], beacon[1], beacon[2]))

    def _begin_with(self, record: AcousticFix) -> None:
        """The first position of a dive that no GPS saw begin."""
        if record.position_deg is None or record.covariance_ned_m2 is None or not self._core.heading_known():
            return
        rows = record.covariance_ned_m2
        covariance = (rows[0][0], rows[0][1], rows[1][1])
        self._positions.fix(PositionFix(record.measured_s, record.arrived_s, SENSOR, *record.position_deg, covariance))

    def _offer(self, record: AcousticFix, beacon: tuple[float, float, float]) -> None:
        core, options = self._core, self._options
        assert core.timeline is not None
        filter_ = core.timeline.filter
        north_m, east_m = core.place.offset_m(beacon[0], beacon[1])
        place_std_m = record.beacon_std_m if record.beacon_std_m is not None else options.beacon_std_m
        measurement = AcousticDelays(
            at_s=record.measured_s,
            receivers_m=options.array.subset(record.receivers),
            delays_s=np.array(record.delays_s),
            covariance_s2=np.array(record.delay_covariance_s2),
            sound_speed_mps=record.sound_speed_mps,
            beacon_ned_m=np.array((north_m, east_m, beacon[2])),
            mounting=options.mounting,
            beacon_covariance_m2=np.diag((place_std_m**2, place_std_m**2, BEACON_DEPTH_STD_M**2)),
            alternatives=tuple((np.array(delays), share) for delays, share in record.alternatives),
            covariance_of=lambda: filter_.covariance,
        )
        core.timeline.offer(measurement, self._done)

    def _done(self, result: UpdateResult) -> None:
        core = self._core
        core.account(result)
        if result.accepted:
            core.last_fix_s = result.at_s if core.last_fix_s is None else max(core.last_fix_s, result.at_s)
