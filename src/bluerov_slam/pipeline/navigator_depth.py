"""Depth from pressure: the surface pressure of this dive, the water's density, and whether it is a pressure at all."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

from bluerov_slam.navigation.seawater import (
    SEA_WATER_DENSITY_KG_PER_M3,
    STANDARD_ATMOSPHERE_PA,
    STANDARD_GRAVITY_MPS2,
    depth_m,
)
from bluerov_slam.pipeline.navigator_watch import FrozenWatch, TimeWatch
from bluerov_slam.pipeline.navigator_water import Water
from bluerov_slam.pipeline.navigator_words import Fault

if TYPE_CHECKING:
    from bluerov_slam.pipeline.navigator_options import DepthOptions
    from bluerov_slam.pipeline.navigator_sensors import SensorStatus
    from bluerov_slam.records import SensorSample, VehicleDepth

# The first moments at the surface give the surface pressure: long enough to average a few waves.
ZERO_OVER_S = 10.0
FIRST_S = 1.0
NEAR_SURFACE_M = 0.5
# A working MS5837 moves by a digit (1 Pa, or 10 Pa from an old firmware) several times a second.
FROZEN_AFTER_S = 5.0
FROZEN_AT_LEAST = 12
PRESSURE_POSSIBLE_PA = (50_000.0, 3.2e6)
# The vehicle's own depth is taken once the link has brought no pressure for so long.
LINK_GONE_S = 5.0


@dataclass(frozen=True, slots=True)
class DepthReading:
    """Depth of the sensor below the surface at an instant."""

    at_s: float
    depth_m: float


class DepthIntake:
    """Pressures in, depths out."""

    def __init__(self, options: DepthOptions, status: SensorStatus, surface_pressure_pa: float | None = None) -> None:
        self._options = options
        self._status = status
        self._times = TimeWatch(2.0)
        self._frozen = FrozenWatch(FROZEN_AFTER_S, FROZEN_AT_LEAST)
        self._taken_s = -math.inf
        self._link_s = -math.inf
        self._first: list[tuple[float, float]] = []
        self._recent: deque[tuple[float, float]] = deque()
        self.surface_pressure_pa = surface_pressure_pa
        self.zeroed_by_user = False
        self.zeroed_itself = surface_pressure_pa is not None
        self._zeroing_s: float | None = None
        self.water = Water(options.density_relative_std)
        self._relative_std = options.density_relative_std
        self._constant_density = False

    @property
    def newest_m(self) -> float | None:
        """The newest depth, None while none is known."""
        if self.surface_pressure_pa is None or not self._recent:
            return None
        return self.depth_m(self._recent[-1][1])

    @property
    def bias_std_m(self) -> float:
        """How well the zero is known."""
        if self.zeroed_by_user:
            return self._options.zeroed_bias_std_m
        return self._options.bias_std_m if self.zeroed_itself else self._options.unzeroed_bias_std_m

    @property
    def zeroed_afloat(self) -> bool:
        """Whether the zero was taken unasked, from a pressure at the start: the sensor may have been under water."""
        return self.zeroed_itself and not self.zeroed_by_user

    def scale_std_m(self, depth: float) -> float:
        """What an unknown density does to a depth."""
        return self._relative_std * abs(depth)

    def sample(self, record: SensorSample) -> DepthReading | None:
        """The depth of one SENSORS frame, None where there is none to be used."""
        if record.pressure_pa is None:
            return None
        self._link_s, self._constant_density = record.arrived_s, False
        return self._pressure(record.pressure_pa, record.measured_s, record.arrived_s)

    def vehicle(self, record: VehicleDepth, measured_s: float) -> DepthReading | None:
        """The depth of the vehicle's own sensor, where the link brings none."""
        if record.arrived_s - self._link_s < LINK_GONE_S:
            return None
        if record.pressure_pa is not None:
            return self._pressure(record.pressure_pa, measured_s, record.arrived_s)
        if record.depth_m is None:
            return None
        if self.surface_pressure_pa is None:
            # The vehicle zeroed it: any pressure serves as that of the surface.
            self.surface_pressure_pa, self.zeroed_itself = STANDARD_ATMOSPHERE_PA, True
        # By the autopilot's own constant density, and back by the same further down: its depth stays what it is.
        self._constant_density = True
        pressure_pa = self.surface_pressure_pa + record.depth_m * SEA_WATER_DENSITY_KG_PER_M3 * STANDARD_GRAVITY_MPS2
        # Logs round depths to decimetres: the same one for a while is no fault.
        return self._pressure(pressure_pa, measured_s, record.arrived_s, may_repeat=True)

    def _pressure(
        self, pressure_pa: float, measured_s: float, arrived_s: float, may_repeat: bool = False
    ) -> DepthReading | None:
        self._status.hear(arrived_s)
        fault = self._times.check(measured_s, arrived_s)
        if fault is Fault.REPEATED_TIME and not self._times.hangs:
            return None
        low, high = PRESSURE_POSSIBLE_PA
        if not math.isfinite(pressure_pa):
            fault = Fault.NOT_A_NUMBER
        elif not low <= pressure_pa <= high:
            fault = Fault.PRESSURE_RANGE
        elif not may_repeat and self._frozen.check(pressure_pa, measured_s):
            fault = Fault.FROZEN
        if fault is not None:
            self._status.refuse(fault, arrived_s)
            return None
        at_s = measured_s - self._options.latency_s
        self._learn_zero(at_s, pressure_pa)
        if self.surface_pressure_pa is None:
            return None
        self._recent.append((at_s, pressure_pa))
        while self._recent[0][0] < at_s - 2.0:
            self._recent.popleft()
        if at_s - self._taken_s < self._options.period_s - 1e-3:
            return None
        self._taken_s = at_s
        return DepthReading(at_s, self.depth_m(pressure_pa))

    def depth_m(self, pressure_pa: float) -> float:
        """Depth at a pressure, through the water as it is known."""
        assert self.surface_pressure_pa is not None
        if self._constant_density:
            return float(depth_m(pressure_pa, self.surface_pressure_pa))
        deep_m, self._relative_std = self.water.depth(pressure_pa, self.surface_pressure_pa)
        return deep_m

    def resume_zero(self, surface_pressure_pa: float) -> None:
        """The zero of before a restart: under water, no new one can be found."""
        self.surface_pressure_pa = surface_pressure_pa
        self.zeroed_itself, self._zeroing_s = True, None

    def zero_here(self) -> bool:
        """The user says that this is the surface. False: no pressure is known."""
        if not self._recent:
            return False
        before_pa, self.surface_pressure_pa = self.surface_pressure_pa, median(pressure for _, pressure in self._recent)
        if before_pa is not None:
            self.water.rezero(before_pa - self.surface_pressure_pa)
        self.zeroed_by_user, self.zeroed_itself, self._zeroing_s = True, True, None
        return True

    def _learn_zero(self, at_s: float, pressure_pa: float) -> None:
        """The first second gives a zero at once; the next few, if the vehicle stays up, a better one."""
        if self.surface_pressure_pa is None:
            self._first.append((at_s, pressure_pa))
            if at_s - self._first[0][0] < FIRST_S:
                return
            middle = median(pressure for _, pressure in self._first)
            low, high = self._options.surface_pressure_range_pa
            self.zeroed_itself = low <= middle <= high
            self.surface_pressure_pa = middle if self.zeroed_itself else STANDARD_ATMOSPHERE_PA
            self._zeroing_s = self._first[0][0] if self.zeroed_itself else None
        elif self._zeroing_s is not None:
            self._first.append((at_s, pressure_pa))
            if abs(self.depth_m(pressure_pa)) > NEAR_SURFACE_M or at_s - self._zeroing_s > ZERO_OVER_S:
                self._zeroing_s = None
                self._first.clear()
                return
            self.surface_pressure_pa = median(pressure for _, pressure in self._first)
