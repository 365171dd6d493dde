"""What is known without any sensor: gravity, that an ROV floats upright, what drag and thrusters allow, still decks.

These hold the filter together while nothing measures velocity or attitude. They are weak on purpose.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.ekf import Innovation
from bluerov_slam.navigation.measurements import GravityDirection, SensorAngles, ZeroRate, ZeroVelocity
from bluerov_slam.pipeline.navigator_words import odd_thrust_text
from bluerov_slam.records import EventLevel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.process import ImuSample
    from bluerov_slam.navigation.state import NavEstimate, StateLayout
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.records import CtdSample

    Array = NDArray[np.float64]

NO_SENSOR = "prior"
# The accelerometer bridges a few seconds without a measured velocity (thruster values come every four); after this its
# errors show.
VELOCITY_MISSED_AFTER_S = 6.0
GRAVITY_PERIOD_S = 1.0
GRAVITY_STD_MPS2 = 0.4
LEVEL_PERIOD_S = 1.0
LEVEL_STD_RAD = math.radians(10.0)
# Salt or fresh, water conducts; air reads zero.
AIR_BELOW_S_PER_M = 0.001
AIR_OLD_S = 5.0
DECK_PERIOD_S = 1.0
DECK_WINDOW_S = 2.0
DECK_RATE_RADPS = math.radians(0.5)
DECK_FORCE_MPS2 = 0.08
DECK_VELOCITY_STD_MPS = 0.03
DECK_RATE_STD_RADPS = math.radians(0.05)
# A thrust scale so many prior standard deviations off (40 % of the speed ahead) is no usual vehicle any more. What is
# odd is not learned with confidence: once a minute the scale becomes as uncertain again as it was at first.
ODD_SCALE_STDS, USUAL_SCALE_STDS = 4.0, 3.5
ODD_SCALE_PERIOD_S = 60.0


@dataclass(frozen=True, slots=True)
class SlowThroughWater:
    """The velocity through water is near zero whichever way the vehicle points: said in NED, so that no attitude is
    learnt from it. In body axes its Jacobian would take the unknown heading for an observed one.
    """

    at_s: float
    horizontal_std_mps: float
    vertical_std_mps: float
    sensor: str = NO_SENSOR

    def evaluate(self, estimate: NavEstimate, layout: StateLayout) -> Innovation | None:
        """0 = v - current."""
        through_water_ned = estimate.velocity_ned_mps.copy()
        jacobian = np.zeros((3, layout.size))
        jacobian[:, layout["velocity"]] = np.eye(3)
        if "current" in layout:
            place = layout["current"]
            through_water_ned[:2] -= estimate.values[place]
            jacobian[0, place.start] = jacobian[1, place.start + 1] = -1.0
        variances = (self.horizontal_std_mps**2, self.horizontal_std_mps**2, self.vertical_std_mps**2)
        return Innovation(-through_water_ned, jacobian, np.diag(variances))


class Aids:
    """Called after every burst, or after every step without an IMU."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._recent: deque[tuple[float, Array, Array]] = deque()
        self._gravity_s = -math.inf
        self._speed_s = -math.inf
        self._level_s = -math.inf
        self._deck_s = -math.inf
        self._air_s = -math.inf
        self._odd_s = -math.inf

    def water(self, record: CtdSample) -> None:
        """Whether the conductivity probe is in the air."""
        conductivity = record.conductivity_s_per_m
        if conductivity is not None and conductivity < AIR_BELOW_S_PER_M:
            self._air_s = record.arrived_s
        elif conductivity is not None:
            self._air_s = -math.inf

    def after_samples(self, samples: list[ImuSample]) -> None:
        """Gravity, a speed limit, and rest on deck."""
        at_s = samples[-1].at_s
        for sample in samples:
            self._recent.append((sample.at_s, sample.specific_force_frd_mps2, sample.angular_rate_frd_radps))
        while self._recent[0][0] < at_s - DECK_WINDOW_S:
            self._recent.popleft()
        if self._core.now_s - self._air_s < AIR_OLD_S and self._rest_on_deck(at_s):
            return
        if at_s - self._core.velocity_aid_s < VELOCITY_MISSED_AFTER_S:
            return
        if at_s - self._gravity_s >= GRAVITY_PERIOD_S:
            self._gravity_s = at_s
            assert self._core.timeline is not None
            gravity_mps2 = self._core.timeline.filter.process.earth.gravity_mps2
            force = np.mean([force for when, force, _ in self._recent if when > at_s - GRAVITY_PERIOD_S], axis=0)
            self._core.offer(GravityDirection(at_s, force, gravity_mps2, GRAVITY_STD_MPS2, sensor=NO_SENSOR))
        self.limit_speed(at_s)

    def without_imu(self, at_s: float, attitude_measured: bool) -> None:
        """An ROV's weight hangs below its buoyancy: it stays upright within some ten degrees."""
        if not attitude_measured and at_s - self._level_s >= LEVEL_PERIOD_S:
            self._level_s = at_s
            self._core.offer(SensorAngles(at_s, 0.0, 0.0, None, LEVEL_STD_RAD, sensor=NO_SENSOR))

    def wander_off(self, to_s: float) -> None:
        """Before a step without any sensor of motion: the course that a pilot holds is not the one of a while ago."""
        timeline, options = self._core.timeline, self._core.options
        assert timeline is not None
        elapsed_s = to_s - timeline.at_s
        if elapsed_s > 0.0 and float(timeline.filter.std("current").max()) < options.thrust.current_std_mps:
            timeline.buffer.add_uncertainty("current", options.imu.kinematic_course_walk_mps * math.sqrt(elapsed_s))

    def limit_speed(self, at_s: float) -> None:
        """One opinion in so many seconds that the speed through water is that of an ROV."""
        options = self._core.options.thrust
        if at_s - self._speed_s < options.speed_prior_time_s:
            return
        self._speed_s = at_s
        std_mps = options.speed_prior_std_mps
        self._core.offer(SlowThroughWater(at_s, std_mps, 0.5 * std_mps))

    def watch_thrust_scale(self, at_s: float) -> None:
        """A vehicle far faster or slower than its thrusters say: said in words, and the scale is trusted less."""
        core, options = self._core, self._core.options.thrust
        assert core.timeline is not None
        scale: Array = core.timeline.filter.estimate.block("thrust_scale")
        stds = np.abs(scale) / options.scale_std
        worst = int(np.argmax(stds))
        status = core.book["thrust"]
        if stds[worst] < (USUAL_SCALE_STDS if status.remark else ODD_SCALE_STDS):
            status.note("")
            return
        if at_s - self._odd_s < ODD_SCALE_PERIOD_S:
            return
        self._odd_s = at_s
        core.timeline.buffer.add_uncertainty("thrust_scale", options.scale_std)
        text = odd_thrust_text(round(100.0 * float(scale[worst])))
        if not status.remark:
            core.say(text, EventLevel.WARNING)
        status.note(text)

    def _rest_on_deck(self, at_s: float) -> bool:
        if at_s - self._recent[0][0] < 0.8 * DECK_WINDOW_S:
            return False
        forces = np.array([force for _, force, _ in self._recent])
        rates = np.array([rate for _, _, rate in self._recent])
        if forces.std(axis=0).max() > DECK_FORCE_MPS2 or rates.std(axis=0).max() > DECK_RATE_RADPS:
            return False
        if at_s - self._deck_s >= DECK_PERIOD_S:
            self._deck_s = at_s
            self._core.offer(ZeroVelocity(at_s, DECK_VELOCITY_STD_MPS, sensor=NO_SENSOR))
            self._core.offer(ZeroRate(at_s, rates.mean(axis=0), DECK_RATE_STD_RADPS, sensor=NO_SENSOR))
        return True
