"""The filter in time: measurements wait until the motion has reached their instant; late ones go where they belong."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bluerov_slam.navigation.delay_buffer import DEPTH_S, DelayBuffer
from bluerov_slam.navigation.rotation import wrap_angle

if TYPE_CHECKING:
    from collections.abc import Callable

    from bluerov_slam.navigation.ekf import ErrorStateFilter, Innovation, Measurement, UpdateResult
    from bluerov_slam.navigation.process import ImuSample
    from bluerov_slam.navigation.state import NavEstimate, StateLayout

# Nearer to the estimate's instant than this (half an IMU interval at 20 Hz) a value is used as it is: at 0.5 m/s and
# 20 deg/s that is 13 mm and half a degree, and it saves running the filter again for every value.
NEAR_S = 0.026
# A velocity that dies away and walks is followed in steps that are short against that.
LONGEST_STEP_S = 1.0
LONGEST_GAP_S = 600.0
# What an IMU may have missed between two samples that lie further apart than usual.
USUAL_INTERVAL_S = 0.12
MISSED_RATE_RADPS = 0.15
WOBBLE_RADPS = 0.06
# What rolls to and fro within this time does not turn.
TURNING_S = 2.0
MISSED_ACCELERATION_MPS2 = 0.3


@dataclass(frozen=True, slots=True)
class Offer:
    """A measurement on its way into the filter. `gate_probability` None: taken whatever it says."""

    measurement: Measurement
    gate_probability: float | None
    robust: Literal["huber"] | None
    done: Callable[[UpdateResult], None] | None = None


@dataclass(frozen=True, slots=True)
class Snapped:
    """A measurement taken as of another, very near instant."""

    measurement: Measurement
    at_s: float

    @property
    def sensor(self) -> str:
        """As the measurement's."""
        return self.measurement.sensor

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """As the measurement's."""
        return self.measurement.evaluate(estimate, layout)


class Timeline:
    """Runs one filter. `shift_ne_m` adds up what updates moved the position by, as opposed to motion.

    `on_jump` hears of single updates that moved position or heading further than a jump's limit: `jump_m` or
    `jump_share` of the horizontal standard deviation before it, whichever is larger; `jump_rad`.
    """

    def __init__(
        self,
        filter_: ErrorStateFilter,
        gate_probability: float,
        jump_m: float,
        jump_share: float,
        jump_rad: float,
        on_jump: Callable[[], None],
        gyro_scale_std: float = 0.0,
        gyro_cross_axis_std: float = 0.0,
    ) -> None:
        self.filter = filter_
        self.buffer = DelayBuffer(filter_)
        self.too_old = 0
        self.shift_ne_m = [0.0, 0.0]
        self._jump_m = jump_m
        self._jump_share = jump_share
        self._jump_rad = jump_rad
        self._on_jump = on_jump
        self._turning_radps = np.zeros(3)
        self._gyro_std = np.array((gyro_cross_axis_std, gyro_cross_axis_std, gyro_scale_std))
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
        elif measurement.at_s < self.at_s - DEPTH_S:
            self.too_old += 1
        else:
            self._use(offer)

    def strapdown(self, sample: ImuSample) -> None:
        """Move on by an IMU sample."""
        if sample.at_s <= self.at_s:
            return
        self.buffer.predict_strapdown(sample)
        self._turning_radps += (sample.angular_rate_frd_radps - self._turning_radps) * min(
            1.0, sample.interval_s / TURNING_S
        )
        turning_radps = math.sqrt(float(self._turning_radps @ self._turning_radps)) - WOBBLE_RADPS
        if turning_radps > 0.0:
            # As much after half a turn as the scale's error of it; wobbling, which adds up to nothing, is left out.
            self.buffer.add_uncertainty(
                "attitude", self._gyro_std * math.sqrt(math.pi * turning_radps * sample.interval_s)
            )
        missed_s = sample.interval_s - USUAL_INTERVAL_S
        if missed_s > 0.0:
            self.buffer.add_uncertainty("attitude", MISSED_RATE_RADPS * missed_s)
            self.buffer.add_uncertainty("velocity", MISSED_ACCELERATION_MPS2 * missed_s)
        self._use_due()

    def kinematic(
        self, to_s: float, attitude_walk: float, velocity_walk: float, velocity_time_s: float = math.inf
    ) -> None:
        """Move on without an IMU, stopping wherever a measurement waits, at least once a second."""
        self.filter.process.kinematic_velocity_time_s = velocity_time_s
        while to_s - self.at_s > LONGEST_STEP_S and to_s - self.at_s < LONGEST_GAP_S:
            self._kinematic(self.at_s + LONGEST_STEP_S, attitude_walk, velocity_walk)
        self._kinematic(to_s, attitude_walk, velocity_walk)

    def _kinematic(self, to_s: float, attitude_walk: float, velocity_walk: float) -> None:
        while self._waiting and self._waiting[0][0] <= to_s:
            self.buffer.predict_kinematic(self._waiting[0][0], attitude_walk, velocity_walk)
            self._use_due()
        self.buffer.predict_kinematic(to_s, attitude_walk, velocity_walk)
        self._use_due()

    def move(self, north_m: float, east_m: float) -> None:
        """The same place in other coordinates: nothing in the covariance changes. Late values start from here."""
        self.filter.estimate.values[0] += north_m
        self.filter.estimate.values[1] += east_m
        self.shift_ne_m[0] += north_m
        self.shift_ne_m[1] += east_m
        self.buffer = DelayBuffer(self.filter)
        self._waiting.clear()

    def _use_due(self) -> None:
        due_s = self.at_s + NEAR_S
        if not self._waiting or self._waiting[0][0] > due_s:
            return
        due = []
        while self._waiting and self._waiting[0][0] <= due_s:
            due.append(heapq.heappop(self._waiting)[2])
        # In the buffer's own order of what happens at one instant, or it would run them again.
        for offer in sorted(due, key=lambda each: each.measurement.sensor):
            self._use(offer)

    def _use(self, offer: Offer) -> None:
        measurement, filter_ = offer.measurement, self.filter
        if abs(measurement.at_s - self.at_s) <= NEAR_S:
            measurement = Snapped(measurement, self.at_s)
        north, east = filter_.estimate.values[:2].tolist()
        variance_m2 = float(filter_.covariance[0, 0] + filter_.covariance[1, 1])
        heading = level_heading_rad(filter_)
        result = self.buffer.update(measurement, offer.gate_probability, offer.robust)
        if result is None:
            return
        if result.accepted:
            moved_north, moved_east = filter_.estimate.values[:2].tolist()
            moved_north -= north
            moved_east -= east
            self.shift_ne_m[0] += moved_north
            self.shift_ne_m[1] += moved_east
            turned = abs(wrap_angle(level_heading_rad(filter_) - heading))
            allowed_m = max(self._jump_m, self._jump_share * math.sqrt(variance_m2))
            if turned > self._jump_rad or math.hypot(moved_north, moved_east) > allowed_m:
                self._on_jump()
        if offer.done is not None:
            offer.done(result)


def level_heading_rad(filter_: ErrorStateFilter) -> float:
    """True heading of the estimate."""
    rotation = filter_.estimate.rotation_ned_frd
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
