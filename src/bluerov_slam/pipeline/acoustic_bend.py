"""How far the water bends the sound's way, from what the CTD has sampled on this dive, and how unsure that is.

A flat ray that crosses a thermocline loses its elevation: theta^2 becomes theta^2 - 2 dc / c, and 6 degrees may arrive
as none. Inside the depths that were sampled the ray is traced. Of the rest only a likely change of the sound speed is
known; what it does to the elevation stays the same for minutes, so that a single pulse has to carry the doubt of many.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.ray_tracing import SoundProfile, bend_rad
from bluerov_slam.errors import OutOfValidityError

if TYPE_CHECKING:
    from bluerov_slam.records import CtdSample

BIN_M: Final = 0.5
DEEPEST_M: Final = 500.0
SPEEDS_MPS: Final = (1380.0, 1620.0)
LONGEST_GAP_M: Final = 2.0
PER_METRE_MPS: Final = 0.5
LARGEST_CHANGE_MPS: Final = 5.0
"""What the sound speed may change by in water that was not sampled, one sigma: half a weak thermocline."""
SEEN_SHARE: Final = 0.7
"""Water that has changed by so much where it was sampled may go on changing: this share of it, if that is more."""
SHARING_PULSES: Final = 16.0
"""A profile that is off is off for minutes: so many pulses in a row have the same error."""
LARGEST_BEND_STD_RAD: Final = 0.3
KEPT_M: Final = 1.0


class AcousticBend:
    """Takes CTD samples, gives the bend of the direct ray and its standard deviation."""

    def __init__(self) -> None:
        self._sums = np.zeros(round(DEEPEST_M / BIN_M))
        self._counts = np.zeros(len(self._sums), dtype=np.int64)
        self._key: tuple[float, float, float, int] | None = None
        self._last = (0.0, 0.0)

    def water(self, record: CtdSample) -> None:
        """One sample; those without depth or sound speed, and probes in the air, say nothing."""
        depth, speed = record.depth_m, record.sound_speed_mps
        if depth is None or speed is None or not SPEEDS_MPS[0] < speed < SPEEDS_MPS[1]:
            return
        if 0.0 < depth < DEEPEST_M:
            self._sums[int(depth / BIN_M)] += speed
            self._counts[int(depth / BIN_M)] += 1

    def of(self, vehicle_depth_m: float, beacon_depth_m: float, range_m: float) -> tuple[float, float]:
        """Bend (down positive) and standard deviation of the elevation by refraction, rad."""
        vehicle, beacon = max(vehicle_depth_m, 0.0), max(beacon_depth_m, 0.0)
        sampled = int(np.count_nonzero(self._counts))
        key = (round(vehicle / KEPT_M), round(beacon / KEPT_M), round(range_m / KEPT_M), sampled)
        if key != self._key:
            self._key, self._last = key, self._traced(vehicle, beacon, range_m)
        return self._last

    def _traced(self, vehicle: float, beacon: float, range_m: float) -> tuple[float, float]:
        places = np.flatnonzero(self._counts)
        rise = abs(beacon - vehicle)
        if not len(places):
            return 0.0, _doubt(rise, rise, range_m, 0.0)
        depth, speed = (places + 0.5) * BIN_M, self._sums[places] / self._counts[places]
        bottom = max(vehicle, beacon, float(depth[-1])) + BIN_M
        try:
            profile = SoundProfile.of_samples(depth, speed, bottom, LONGEST_GAP_M)
            bend = bend_rad(profile, beacon, vehicle, range_m)
        except OutOfValidityError:
            return 0.0, _doubt(rise, rise, range_m, 0.0)
        unknown_m = profile.guessed(vehicle, beacon) * rise
        if bend is None:
            # No direct ray: what arrives has been reflected, or the profile is wrong. Its elevation says nothing.
            return 0.0, LARGEST_BEND_STD_RAD
        return bend, _doubt(unknown_m, rise, range_m, float(np.ptp(speed)))


def _doubt(unknown_m: float, rise_m: float, range_m: float, seen_mps: float) -> float:
    """A change dc spread evenly over the rise turns the ray by dc R / (2 c rise), in a step up to twice that."""
    change = min(PER_METRE_MPS * unknown_m, max(LARGEST_CHANGE_MPS, SEEN_SHARE * seen_mps))
    bend = 1.5 * change * range_m / (1500.0 * max(rise_m, 1.0))
    return min(math.sqrt(SHARING_PULSES) * bend, LARGEST_BEND_STD_RAD)
