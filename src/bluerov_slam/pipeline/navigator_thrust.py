"""Thruster commands to velocity through water: which of them are fresh, possible and mean that the vehicle swims."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.measurements import WaterVelocity
from bluerov_slam.navigation.steady_velocity import SteadyVelocity
from bluerov_slam.navigation.vehicle_model import BLUEROV2, PWM_STOP_US, MovingVehicle, ThrustModel
from bluerov_slam.pipeline.navigator_watch import TimeWatch
from bluerov_slam.pipeline.navigator_words import Fault, Wait

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.pipeline.navigator_options import ThrustOptions
    from bluerov_slam.pipeline.navigator_sensors import SensorStatus
    from bluerov_slam.records import VehicleBattery, VehicleServoOutput

    Array = NDArray[np.float64]

PWM_POSSIBLE_US = (800, 2200)
# So near the stop an ESC does nothing.
NEUTRAL_US = 20
# At the surface with the thrusters stopped for so long the vehicle may be back on deck, where still thrusters do not
# mean still water around it.
RESTING_S = 20.0
VOLTAGE_POSSIBLE_V = (6.0, 26.0)


class ThrustIntake:
    """Servo outputs and battery in, velocity through water out."""

    def __init__(self, options: ThrustOptions, status: SensorStatus, model: ThrustModel | None = None) -> None:
        self._options = options
        self._status = status
        self._model = model or ThrustModel(options.layout or BLUEROV2)
        self._vehicle = MovingVehicle(self._model)
        self._steady = SteadyVelocity()
        self._times = TimeWatch(2.0)
        self._pwm_us: tuple[int, ...] | None = None
        self._pwm_s = -math.inf
        self._ran_s: float | None = None
        self._taken_s = -math.inf
        self._moves_mps: tuple[float, float] | None = None
        self._voltage_v: float | None = None
        self._voltage_s = -math.inf

    def battery(self, record: VehicleBattery) -> None:
        """Its voltage, if it is one."""
        voltage = record.voltage_v
        low, high = VOLTAGE_POSSIBLE_V
        if voltage is not None and math.isfinite(voltage) and low <= voltage <= high:
            self._voltage_v, self._voltage_s = voltage, record.arrived_s

    def effort(self, at_s: float) -> Array | None:
        """Share of its full current that each thruster draws; None while nobody says."""
        if self._pwm_us is None or at_s - self._pwm_s > self._options.stale_after_s:
            return None
        return self._model.effort(self._pwm_us)

    def ahead_mps(self, at_s: float) -> tuple[float, float] | None:
        """Speed through the water ahead and to starboard by the model; None while nobody tells the commands."""
        return None if at_s - self._pwm_s > self._options.stale_after_s else self._moves_mps

    def servos(
        self,
        record: VehicleServoOutput,
        measured_s: float,
        depth_m: float | None,
        angular_rate_frd_radps: Array | None,
    ) -> WaterVelocity | None:
        """The velocity that the commands so far have led to. None where they say nothing about it, or nothing new.

        `angular_rate_frd_radps` None: there is no IMU, and with it nothing that bridges the time between two values.
        """
        self._status.hear(record.arrived_s)
        fault = self._times.check(measured_s, record.arrived_s)
        if fault is Fault.REPEATED_TIME and not self._times.hangs:
            return None
        pwm_us = record.pwm_us
        low, high = PWM_POSSIBLE_US
        count = len(self._model.layout.thrusters)
        possible = len(pwm_us) >= count and all(low <= pwm <= high for pwm in pwm_us[:count])
        if fault is None and not possible and any(pwm_us[:count]):
            fault = Fault.PWM_RANGE
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return None
        if not possible:
            self._status.wait_for(Wait.THRUSTERS_OFF, record.arrived_s)
            return None
        held_s = measured_s - self._pwm_s
        before, self._pwm_us, self._pwm_s = self._pwm_us, pwm_us, measured_s
        if any(abs(pwm - PWM_STOP_US) > NEUTRAL_US for pwm in pwm_us[:count]):
            self._ran_s = measured_s
        if not self._swims(measured_s, depth_m):
            self._status.wait_for(Wait.THRUSTERS_OFF, record.arrived_s)
            return None
        self._status.wait_for(None, record.arrived_s)
        voltage_v = (
            self._voltage_v if record.arrived_s - self._voltage_s < self._options.battery_stale_after_s else None
        )
        if before is None or not 0.0 < held_s <= self._options.stale_after_s:
            # What happened meanwhile is unknown: some seconds under the present command are a guess, no measurement.
            self._vehicle.reset()
            self._vehicle.update(pwm_us, voltage_v, 10.0, None)
            self._moves_mps = None
            return None
        rate = None if angular_rate_frd_radps is None else angular_rate_frd_radps.tolist()
        velocity = self._vehicle.update(before, voltage_v, held_s, rate)
        if velocity is not None:
            self._moves_mps = (float(velocity.velocity_frd_mps[0]), float(velocity.velocity_frd_mps[1]))
        period_s = self._options.period_without_imu_s if rate is None else self._options.period_s
        if velocity is None or measured_s - self._taken_s < period_s - 1e-3:
            return None
        self._taken_s = measured_s
        std_mps = self._options.noise_mps / math.sqrt(period_s) * self._status.noise_scale
        # Heave is left to the depth sensor, which knows it far better.
        surge_sway = velocity.velocity_frd_mps[:2]
        steady = self._steady.before(measured_s, surge_sway)
        # The scale is learned from the steady part; what a wrong one makes of the rest is error.
        changing_mps = np.array(self._options.scale_std) * np.abs(surge_sway - steady)
        return WaterVelocity(measured_s, surge_sway, np.hypot(std_mps, changing_mps), steady_frd_mps=steady)

    def _swims(self, at_s: float, depth_m: float | None) -> bool:
        if self._ran_s is None:
            return False
        return (depth_m is not None and depth_m > 0.5) or at_s - self._ran_s < RESTING_S
