"""The filter in time: measurements wait until the motion has reached their instant; late ones go where they belong."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bluerov_slam.navigation.rotation import wrap_angle

if TYPE_CHECKING:
    from collections.abc import Callable

    from bluerov_slam.navigation.ekf import ErrorStateFilter, Measurement, UpdateResult
    from bluerov_slam.navigation.process import ImuSample

# Half an IMU interval at 20 Hz: nearer to the estimate's instant than this a value is used as it is.
NEAR_S = 0.03
# Older than the filter's memory.
OLDEST_S = 1.0
# What an IMU may have missed between two samples that lie further apart than usual.
USUAL_INTERVAL_S = 0.12
MISSED_RATE_RADPS = 0.15
MISSED_ACCELERATION_MPS2 = 0.3


@dataclass(frozen=True, slots=True)
class Offer:
    """A measurement on its way into the filter. `gate_probability` None: taken whatever it says."""

    measurement: Measurement
    gate_probability: float | None
    robust: Literal["huber"] | None
    done: Callable[[UpdateResult], None] | None = None


class Timeline:
    """Runs one filter. `shift_ne_m` adds up what updates moved the position by, as opposed to motion.

    `on_jump` hears of single updates that moved position (m) or heading (rad) further than allowed.
    """

    def __init__(
        self,
        filter_: ErrorStateFilter,
        gate_probability: float,
        jump_m: float,
        jump_rad: float,
        on_jump: Callable[[str], None],
    ) -> None:
        self.filter = filter_
        self.too_old = 0
        self.shift_ne_m = [0.0, 0.0]
        self._jump_m = jump_m
        self._jump_rad = jump_rad
        self._on_jump = on_jump
        self._gate_probability = gate_probability
        self._waiting: list[tuple[float, int, Offer]] = []
        self._sequence = 0

    @property
    def at_s(self) -> float:
        """The instant of the estimate."""
        return self.filter.at_s

    def offer(
        self,
        measurement: Measurement,
        done: Callable[[UpdateResult], None] | None = None,
        *,
        gated: bool = True,
    ) -> None:
        """Use a measurement once the estimate has come to its instant; at once if it has."""
        gate = self._gate_probability if gated else None
        offer = Offer(measurement, gate, "huber" if gated else None, done)
        if measurement.at_s > self.at_s + NEAR_S:
            heapq.heappush(self._waiting, (measurement.at_s, self._sequence, offer))
            self._sequence += 1
        elif measurement.at_s < self.at_s - OLDEST_S:
            self.too_old += 1
        else:
            self._use(offer)

    def strapdown(self, sample: ImuSample) -> None:
        """Move on by an IMU sample."""
        filter_ = self.filter
        if not filter_.predict_strapdown(sample):
            return
        missed_s = sample.interval_s - USUAL_INTERVAL_S
        if missed_s > 0.0:
            filter_.add_uncertainty("attitude", MISSED_RATE_RADPS * missed_s)
            filter_.add_uncertainty("velocity", MISSED_ACCELERATION_MPS2 * missed_s)
        if self._waiting:
            self._use_due()

    def kinematic(self, to_s: float, attitude_walk: float, velocity_walk: float) -> None:
        """Move on without an IMU, stopping wherever a measurement waits."""
        while self._waiting and self._waiting[0][0] <= to_s:
            self.filter.predict_kinematic(self._waiting[0][0], attitude_walk, velocity_walk)
            self._use_due()
        self.filter.predict_kinematic(to_s, attitude_walk, velocity_walk)
        self._use_due()

    def forget_waiting(self) -> None:
        """Nothing that waits fits the estimate any more."""
        self._waiting.clear()

    def _use_due(self) -> None:
        due_s = self.at_s + NEAR_S
        while self._waiting and self._waiting[0][0] <= due_s:
            self._use(heapq.heappop(self._waiting)[2])

    def _use(self, offer: Offer) -> None:
        filter_ = self.filter
        north, east = filter_.estimate.values[:2].tolist()
        heading = level_heading_rad(filter_)
        result = filter_.update(offer.measurement, offer.gate_probability, offer.robust)
        if result is None:
            return
        if result.accepted:
            moved_north, moved_east = filter_.estimate.values[:2].tolist()
            moved_north -= north
            moved_east -= east
            self.shift_ne_m[0] += moved_north
            self.shift_ne_m[1] += moved_east
            turned = abs(wrap_angle(level_heading_rad(filter_) - heading))
            if turned > self._jump_rad or math.hypot(moved_north, moved_east) > self._jump_m:
                self._on_jump(result.sensor)
        if offer.done is not None:
            offer.done(result)


def level_heading_rad(filter_: ErrorStateFilter) -> float:
    """True heading of the estimate."""
    rotation = filter_.estimate.rotation_ned_frd
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
