"""What an acoustic array reports along a dive: delays of every pulse with the errors that water adds to a direction.

This is the whole chain in one step, for runs of half an hour: the direction of each pulse is turned by noise of its own
and by an error that wanders slowly, some pulses arrive by way of an echo, and the delays carry timing noise. Samples
and what is made of them are simulated elsewhere (`acoustic_record`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.records import AcousticFix

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from bluerov_slam.simulation.dive import DiveTruth

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PingErrors:
    """Standard deviations of one beacon and array; angles in radians.

    Directions of a five-hydrophone array in water came out as -0.11 +- 3.16 deg against differential GPS (piUSBL):
    nearly all of it changes from pulse to pulse. The slow part and the mounting are larger here than that mean.
    """

    direction_rad: float = math.radians(3.0)  # of each pulse, each axis
    slow_rad: float = math.radians(0.5)
    slow_time_s: float = 240.0
    mounting_rad: float = math.radians(0.5)
    echo_share: float = 0.05
    timing_s: float = 0.8e-6
    sound_speed_share: float = 1.5e-3
    beacon_m: float = 0.0  # of the stated place, each axis


@dataclass(frozen=True, slots=True)
class PingPlan:
    """Transmitter at a place relative to the dive's origin, one pulse every `every_s`."""

    beacon_ned_m: tuple[float, float, float]
    every_s: float = 5.0
    largest_range_m: float = 100.0
    sound_speed_mps: float = 1490.0
    delay_s: float = 0.15  # from the pulse to its report


class SimulatedPings:
    """The reports of one dive, in order of time. The beacon's stated place is given as offset metres by the caller."""

    def __init__(
        self,
        truth: DiveTruth,
        plan: PingPlan,
        array: ReceiverArray,
        mounting: ArrayMounting,
        beacon_deg_m: tuple[float, float, float],
        seed: int,
        errors: PingErrors | None = None,
    ) -> None:
        self._truth = truth
        self._plan = plan
        self._array = array
        self._mounting = mounting
        self._stated = beacon_deg_m
        self._errors = errors or PingErrors()
        self._random = np.random.default_rng([seed, 0xAC0])

    def reports(self) -> Iterator[AcousticFix]:
        """Every pulse that was heard."""
        plan, errors, random = self._plan, self._errors, self._random
        times = np.arange(self._truth.track_start_s + 0.4 * plan.every_s, self._truth.end_s - 1.0, plan.every_s)
        track = self._truth.track(times)
        beacon = np.array(plan.beacon_ned_m) + errors.beacon_m * random.standard_normal(3)
        speed = plan.sound_speed_mps
        stated_speed = speed * (1.0 + errors.sound_speed_share * random.standard_normal())
        misaligned = _turn(errors.mounting_rad * random.standard_normal(3))
        decay = math.exp(-plan.every_s / errors.slow_time_s)
        slow = errors.slow_rad * random.standard_normal(3)
        count = len(self._array)
        for at_s, position, rotation in zip(times, track.position_ned_m, track.rotation_ned_frd, strict=True):
            slow = decay * slow + errors.slow_rad * math.sqrt(1.0 - decay * decay) * random.standard_normal(3)
            toward_ned = beacon - position
            if float(toward_ned @ toward_ned) > plan.largest_range_m**2:
                continue
            if random.random() < errors.echo_share:
                toward_ned = self._echo(toward_ned, float(position[2]))
            frd = rotation.T @ toward_ned - self._mounting.lever_arm_frd_m
            turned = _turn(slow) @ _turn(errors.direction_rad * random.standard_normal(3)) @ frd
            source = self._mounting.rotation_frd_array.T @ misaligned.T @ turned
            delays = self._array.delays_s(source, speed)
            noise = errors.timing_s * random.standard_normal(count)
            delays = delays + noise[0] - noise[1:]
            covariance = errors.timing_s**2 * (np.eye(count - 1) + 1.0)
            yield AcousticFix(
                measured_s=float(at_s),
                arrived_s=float(at_s) + plan.delay_s,
                accepted=True,
                reason="",
                sound_speed_mps=stated_speed,
                receivers=tuple(range(count)),
                delays_s=tuple(delays.tolist()),
                delay_covariance_s2=tuple(tuple(row) for row in covariance.tolist()),
                slip_probability=0.0,
                beacon_deg_m=self._stated,
                beacon_source="settings",
            )

    def _echo(self, toward_ned: Array, depth_m: float) -> Array:
        """By way of the surface, or of anything that stands around."""
        if self._random.random() < 0.5:
            image = toward_ned.copy()
            image[2] = -(toward_ned[2] + 2.0 * depth_m)
            return image
        anywhere = self._random.standard_normal(3) * (1.0, 1.0, 0.5)
        echo: Array = math.sqrt(float(toward_ned @ toward_ned)) * anywhere / np.linalg.norm(anywhere)
        return echo


def _turn(vector_rad: Array) -> Array:
    """The rotation by |v| about v (Rodrigues)."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    turn: Array = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return turn
