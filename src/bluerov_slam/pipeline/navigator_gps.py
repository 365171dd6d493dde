"""When GPS may be believed: at the surface, after a few fixes that agree, and never at 0 N 0 E.

The link has two forms of it: GPS frames of a newer firmware, and the position inside SENSORS of an old one, which is
repeated until the receiver reports again. Where frames come, SENSORS are not asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bluerov_slam.pipeline.navigator_watch import FrozenWatch, TimeWatch
from bluerov_slam.pipeline.navigator_words import Fault, Wait
from bluerov_slam.records import FixType

if TYPE_CHECKING:
    from bluerov_slam.pipeline.navigator_options import GpsOptions
    from bluerov_slam.pipeline.navigator_sensors import SensorStatus
    from bluerov_slam.records import GpsFix, SensorSample

EARTH_RADIUS_M = 6_371_000.0
NULL_ISLAND_DEG = 1e-3
# Frames come once a second; after so long without one the position in SENSORS counts again.
FRAMES_GONE_S = 5.0
# The streak of agreeing fixes ends with a gap like this.
STREAK_GAP_S = 5.0
# A receiver moored or on a bench may hold its position to the last digit; one that is carried on cannot.
FROZEN_AFTER_S = 20.0
FROZEN_MOVED_M = 15.0


@dataclass(frozen=True, slots=True)
class Fix:
    """A horizontal position that passed every check of its own source. `std_m` per axis, of all its errors."""

    at_s: float
    arrived_s: float
    latitude_deg: float
    longitude_deg: float
    std_m: float


def distance_m(latitude_a: float, longitude_a: float, latitude_b: float, longitude_b: float) -> float:
    """Between two places in degrees, good for a few kilometres (and enormous beyond, which is all that matters)."""
    north = math.radians(latitude_b - latitude_a)
    east = math.radians(math.remainder(longitude_b - longitude_a, 360.0)) * math.cos(math.radians(latitude_a))
    return EARTH_RADIUS_M * math.hypot(north, east)


class Streak:
    """How many fixes in a row agree with each other: the next lies no further from the last than the vehicle can go."""

    def __init__(
        self, within_m: float, speed_mps: float, gap_s: float = STREAK_GAP_S, most_m: float = math.inf
    ) -> None:
        self._within_m = within_m
        self._speed_mps = speed_mps
        self._gap_s = gap_s
        self._most_m = most_m
        self._last: Fix | None = None
        self._first_s = math.nan
        self.length = 0

    @property
    def lasts_s(self) -> float:
        """From its first fix to its last."""
        return 0.0 if self._last is None else self._last.at_s - self._first_s

    def add(self, fix: Fix) -> bool:
        """Whether it continues the streak."""
        last, self._last = self._last, fix
        if last is None:
            self.length, self._first_s = 1, fix.at_s
            return True
        apart_s = fix.at_s - last.at_s
        allowed_m = min(self._within_m + self._speed_mps * max(0.0, apart_s), self._most_m)
        apart_m = distance_m(last.latitude_deg, last.longitude_deg, fix.latitude_deg, fix.longitude_deg)
        if apart_s > self._gap_s or apart_m > allowed_m:
            self.length, self._first_s = 1, fix.at_s
            return apart_m <= allowed_m
        self.length += 1
        return True

    def end(self) -> None:
        """Start counting anew."""
        self.length, self._last = 0, None


class GpsGate:
    """Turns reports of the receiver into fixes fit for the filter."""

    def __init__(self, options: GpsOptions, status: SensorStatus) -> None:
        self._options = options
        self._status = status
        self._times = TimeWatch(options.age_limit_s)
        self._streak = Streak(options.consistent_within_m, options.consistent_speed_mps)
        self._frozen = FrozenWatch(FROZEN_AFTER_S, 10)
        self._frame_s = -math.inf
        self._sample_position: tuple[float, float] | None = None
        self._taken_s = -math.inf
        self._frozen_moved_m = 0.0

    def frame(self, record: GpsFix, depth_m: float | None, travelled_m: float) -> Fix | None:
        """A report of its own. `depth_m` None: unknown, so the antenna may be out of the water."""
        self._frame_s = record.arrived_s
        self._status.hear(record.arrived_s)
        fault = self._times.check(record.measured_s, record.arrived_s)
        if fault is not None:
            self._refuse(fault, record.arrived_s)
            return None
        if record.fix is FixType.NONE:
            self._wait(Wait.GPS_NO_FIX, record.arrived_s)
            return None
        return self._position(
            record.measured_s,
            record.arrived_s,
            record.latitude_deg,
            record.longitude_deg,
            record.hdop,
            depth_m,
            travelled_m,
        )

    def sample(self, record: SensorSample, depth_m: float | None, travelled_m: float) -> Fix | None:
        """The position inside SENSORS: taken when it changes, else once a second."""
        if record.arrived_s - self._frame_s < FRAMES_GONE_S or not record.gps_alive:
            return None
        if record.gps_latitude_deg is None or record.gps_longitude_deg is None:
            self._wait(Wait.GPS_NO_FIX, record.arrived_s)
            return None
        position = (record.gps_latitude_deg, record.gps_longitude_deg)
        if position == self._sample_position and record.measured_s - self._taken_s < 1.0:
            self._status.hear(record.arrived_s)
            return None
        self._sample_position, self._taken_s = position, record.measured_s
        return self._position(record.measured_s, record.arrived_s, *position, None, depth_m, travelled_m)

    def _position(
        self,
        measured_s: float,
        arrived_s: float,
        latitude_deg: float | None,
        longitude_deg: float | None,
        hdop: float | None,
        depth_m: float | None,
        travelled_m: float,
    ) -> Fix | None:
        options = self._options
        if latitude_deg is None or longitude_deg is None or _is_null_island(latitude_deg, longitude_deg):
            # A receiver that claims a fix and has no position: the codec takes exactly 0 N 0 E away.
            self._refuse(Fault.NULL_ISLAND, arrived_s)
            return None
        if not (math.isfinite(latitude_deg) and math.isfinite(longitude_deg) and abs(latitude_deg) <= 90.0):
            self._refuse(Fault.NOT_A_NUMBER, arrived_s)
            return None
        if depth_m is not None and depth_m > options.depth_limit_m:
            self._streak.end()
            self._wait(Wait.GPS_UNDER_WATER, arrived_s)
            return None
        if self._is_frozen((latitude_deg, longitude_deg), measured_s, travelled_m):
            self._refuse(Fault.FROZEN, arrived_s)
            return None
        hdop = options.unknown_hdop if hdop is None or not math.isfinite(hdop) else hdop
        if hdop > options.hdop_limit:
            self._streak.end()
            self._wait(Wait.GPS_POOR, arrived_s)
            return None
        fix = Fix(
            measured_s - options.latency_s,
            arrived_s,
            latitude_deg,
            longitude_deg,
            options.std_m_per_hdop * max(hdop, 0.7),
        )
        if not self._streak.add(fix):
            self._status.refuse(Fault.GPS_JUMP, arrived_s)
            return None
        if self._streak.length < options.consistent_fixes:
            self._wait(Wait.GPS_SETTLING, arrived_s)
            return None
        self._status.wait_for(None, arrived_s)
        return fix

    def _is_frozen(self, position: tuple[float, float], at_s: float, travelled_m: float) -> bool:
        if not self._frozen.check(position, at_s):
            if self._frozen.count == 1:
                self._frozen_moved_m = travelled_m
            return False
        return travelled_m - self._frozen_moved_m > FROZEN_MOVED_M

    def _refuse(self, fault: Fault, at_s: float) -> None:
        if fault is Fault.REPEATED_TIME and not self._times.hangs:
            return
        self._streak.end()
        self._status.refuse(fault, at_s)

    def _wait(self, wait: Wait, at_s: float) -> None:
        if wait is Wait.GPS_NO_FIX:
            self._streak.end()
        self._status.wait_for(wait, at_s)


def _is_null_island(latitude_deg: float, longitude_deg: float) -> bool:
    return abs(latitude_deg) < NULL_ISLAND_DEG and abs(longitude_deg) < NULL_ISLAND_DEG
