"""Position fixes from outside and a DVL's velocities: what of them may be believed, and how far."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.ekf import Innovation
from bluerov_slam.navigation.measurements import GroundVelocity, HorizontalPosition
from bluerov_slam.navigation.steady_velocity import SteadyVelocity
from bluerov_slam.pipeline.navigator_gps import Fix
from bluerov_slam.pipeline.navigator_watch import FrozenWatch, TimeWatch, all_finite
from bluerov_slam.pipeline.navigator_words import Fault

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.state import NavEstimate, StateLayout
    from bluerov_slam.pipeline.navigator_options import DvlOptions, FixOptions
    from bluerov_slam.pipeline.navigator_sensors import SensorStatus
    from bluerov_slam.records import PositionFix, VehicleMotionDelta

    Array = NDArray[np.float64]

FIX_WANDER = "fix_wander"
OLDEST_FIX_S = 10.0
# Beyond these a covariance is a mistake of whoever made it.
STD_POSSIBLE_M = (0.01, 1000.0)
# What a source usually states, averaged over so long.
USUAL_TIME_S = 60.0
# Acoustic positions move by centimetres even when the vehicle lies still.
FROZEN_AFTER_S, FROZEN_AT_LEAST = 20.0, 10
DVL_INTERVAL_S = (0.01, 2.0)
DVL_FASTEST_MPS = 6.0


@dataclass(frozen=True, slots=True)
class WanderingPosition:
    """A position whose slow error is a state of its own: the block `fix_wander`, in units of `wander_m` (2, 2)."""

    position: HorizontalPosition
    wander_m: Array

    @property
    def sensor(self) -> str:
        """As the position's."""
        return self.position.sensor

    @property
    def at_s(self) -> float:
        """As the position's."""
        return self.position.at_s

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """z = (p + R l) north, east + wander."""
        innovation = self.position.evaluate(estimate, layout)
        if innovation is None or FIX_WANDER not in layout:
            return innovation
        place = layout[FIX_WANDER]
        jacobian = innovation.jacobian
        jacobian[:, place] = self.wander_m
        return Innovation(innovation.residual - self.wander_m @ estimate.values[place], jacobian, innovation.noise)


@dataclass(frozen=True, slots=True)
class StatedFix:
    """A fix with its whole covariance, and what its source usually states: (2, 2) north and east."""

    fix: Fix
    covariance_m2: Array
    usual_m2: Array


class FixIntake:
    """PositionFix in, fixes with an uncertainty out."""

    def __init__(self, options: FixOptions, status: SensorStatus) -> None:
        self._options = options
        self._status = status
        self._times = TimeWatch(OLDEST_FIX_S)
        self._frozen = FrozenWatch(FROZEN_AFTER_S, FROZEN_AT_LEAST)
        self._usual_m2: Array | None = None
        self._usual_s = -math.inf

    def take(self, record: PositionFix) -> StatedFix | None:
        """A fix to be offered to the filter, None if it is none."""
        self._status.hear(record.arrived_s)
        fault = self._times.check(record.measured_s, record.arrived_s)
        if fault is Fault.REPEATED_TIME and not self._times.hangs:
            return None
        place = (record.latitude_deg, record.longitude_deg)
        if not all_finite(place):
            fault = Fault.NOT_A_NUMBER
        elif abs(record.latitude_deg) > 90.0 or abs(record.longitude_deg) > 360.0 or max(map(abs, place)) < 1e-3:
            fault = Fault.IMPOSSIBLE
        if self._frozen.check(place, record.measured_s):
            fault = fault or Fault.FROZEN
        covariance = self._covariance(record)
        if covariance is None:
            fault = fault or Fault.IMPOSSIBLE
        if fault is not None or covariance is None:
            self._status.refuse(fault or Fault.IMPOSSIBLE, record.arrived_s)
            return None
        std_m = math.sqrt(0.5 * float(covariance[0, 0] + covariance[1, 1]))
        fix = Fix(record.measured_s - self._options.latency_s, record.arrived_s, *place, std_m)
        return StatedFix(fix, covariance, self._usual(covariance, record.measured_s))

    def _usual(self, covariance_m2: Array, at_s: float) -> Array:
        """With this one."""
        if self._usual_m2 is None:
            self._usual_m2 = covariance_m2
        else:
            share = -math.expm1(-max(0.0, at_s - self._usual_s) / USUAL_TIME_S)
            self._usual_m2 = self._usual_m2 + share * (covariance_m2 - self._usual_m2)
        self._usual_s = max(at_s, self._usual_s)
        return self._usual_m2

    def _covariance(self, record: PositionFix) -> Array | None:
        if record.covariance_ne_m2 is None:
            return self._options.std_m**2 * np.eye(2)
        north, both, east = record.covariance_ne_m2
        if not all_finite((north, both, east)):
            return None
        low, high = (std * std for std in STD_POSSIBLE_M)
        if not (low <= north <= high and low <= east <= high and both * both < north * east):
            return None
        return np.array([[north, both], [both, east]])


class DvlIntake:
    """VISION_POSITION_DELTA in, velocities over ground out."""

    def __init__(self, options: DvlOptions, status: SensorStatus) -> None:
        self._options = options
        self._status = status
        self._times = TimeWatch(2.0)
        self._steady = SteadyVelocity()

    def take(
        self, record: VehicleMotionDelta, measured_s: float, angular_rate_frd_radps: Array | None
    ) -> GroundVelocity | None:
        """The mean velocity over the message's interval, at its middle."""
        self._status.hear(record.arrived_s)
        fault = self._times.check(measured_s, record.arrived_s)
        if fault is Fault.REPEATED_TIME and not self._times.hangs:
            return None
        shortest_s, longest_s = DVL_INTERVAL_S
        if not all_finite((*record.displacement_frd_m, record.interval_s, record.confidence_percent)):
            fault = Fault.NOT_A_NUMBER
        elif not shortest_s <= record.interval_s <= longest_s:
            fault = fault or Fault.IMPOSSIBLE
        elif record.confidence_percent < self._options.bad_below_percent:
            fault = fault or Fault.DVL_CONFIDENCE
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return None
        velocity = np.array(record.displacement_frd_m) / record.interval_s
        speed = math.sqrt(float(velocity @ velocity))
        if speed > DVL_FASTEST_MPS:
            self._status.refuse(Fault.IMPOSSIBLE, record.arrived_s)
            return None
        self._status.wait_for(None, record.arrived_s)
        std_mps = math.hypot(self._options.std_mps, self._options.std_per_mps * speed) * self._status.noise_scale
        rate = np.zeros(3) if angular_rate_frd_radps is None else angular_rate_frd_radps
        steady = self._steady.before(measured_s, velocity[:2])
        return GroundVelocity(
            measured_s - 0.5 * record.interval_s,
            velocity,
            std_mps * std_mps * np.eye(3),
            rate,
            self._options.lever_arm_frd_m,
            steady_frd_mps=steady,
        )
