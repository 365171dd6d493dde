"""The vehicle's ArduSub, as its MAVLink stream shows it: real MAVLink 2 bytes, each with the time it arrives.

Its IMU, compass and clock are its own, with their own errors. Thruster outputs and battery are those of the flight.
With a DVL its driver's messages come through the same stream.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.simulation import flight as columns
from bluerov_slam.simulation.instrument_errors import InstrumentErrors
from bluerov_slam.simulation.truth import Motion, TruthRows
from bluerov_slam.simulation.water import WaterProfile

AUTOPILOT_SYSTEM, AUTOPILOT_COMPONENT = 1, 1
DVL_SYSTEM, DVL_COMPONENT = 255, 0  # as BlueOS's driver speaks
DVL_INTERVAL_S = 0.2
DVL_NOISE_MPS = 0.010
DVL_SCALE_STD, DVL_MOUNTING_STD_RAD = 0.003, math.radians(0.5)
_ATTITUDE_S, _SERVO_S, _SLOW_S = 0.1, 0.1, 1.0
_LATENCY_S, _JITTER_S = 0.015, 0.006
_STALL_CHANCE, _STALL_S = 0.002, 0.15
_CLOCK_PPM = 30.0
_BOOTED_BEFORE_S = 95.0
_DVL_LATENCY_S = 0.08
_DVL_GAP_EVERY_S, _DVL_GAP_S = 150.0, 3.0
_PRESSURE_OFFSET_PA, _PRESSURE_NOISE_PA = 1000.0, 20.0
_TILT_RAD = math.radians(0.4)
_RATE_NOISE_RADPS = math.radians(0.06)
_BLOCK_S = 10.0

FloatArray = NDArray[np.float64]


class DvlErrors:
    """How this DVL is mounted and calibrated: true velocity = measured / (1 + scale), turned by -yaw."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 0xD71])
        self.scale = DVL_SCALE_STD * float(np.clip(rng.standard_normal(), -2.5, 2.5))
        self.yaw_rad = DVL_MOUNTING_STD_RAD * float(np.clip(rng.standard_normal(), -2.5, 2.5))


class VirtualAutopilot:
    """Everything the vehicle says over MAVLink. Times in are virtual; `mission_start_s` is the truth's time of zero."""

    def __init__(
        self,
        truth: TruthRows,
        errors: InstrumentErrors,
        seed: int,
        *,
        mission_start_s: float = 0.0,
        water: WaterProfile | None = None,
        dvl: bool = False,
        altitude_m: Callable[[float, float, float], float] | None = None,
    ) -> None:
        self._truth = truth
        self._errors = errors
        self._rng = np.random.default_rng([seed, 0xA0])
        self._mission_start_s = mission_start_s
        self.dvl_errors = DvlErrors(seed)
        self._water = water or WaterProfile()
        self._pressure_offset_pa = _PRESSURE_OFFSET_PA * float(self._rng.standard_normal())
        self._dvl = dvl
        self._altitude_m = altitude_m
        self._mav = mavlink.MAVLink(None, srcSystem=AUTOPILOT_SYSTEM, srcComponent=AUTOPILOT_COMPONENT)
        self._dvl_mav = mavlink.MAVLink(None, srcSystem=DVL_SYSTEM, srcComponent=DVL_COMPONENT)
        self._tilt_bias = _TILT_RAD * self._rng.standard_normal(2)
        self._yaw_bias = errors.deviation.a_rad * 0.5 + math.radians(1.5) * float(self._rng.standard_normal())
        self._waiting: list[tuple[float, int, bytes]] = []
        self._order = 0
        self._made_until_s = 0.0
        self._free_s = 0.0
        self._dvl_gap_until_s = -math.inf

    def advance(self, until_s: float) -> list[tuple[float, bytes]]:
        """Every message that has arrived by this virtual time and was not given yet, in order of arrival."""
        while self._made_until_s <= until_s:
            self._make_block(self._made_until_s, self._made_until_s + _BLOCK_S)
            self._made_until_s += _BLOCK_S
        arrived: list[tuple[float, bytes]] = []
        while self._waiting and self._waiting[0][0] <= until_s:
            at_s, _, data = heapq.heappop(self._waiting)
            arrived.append((at_s, data))
        return arrived

    def _make_block(self, start_s: float, end_s: float) -> None:
        """All messages measured in this span."""
        self._attitudes(np.arange(start_s + 0.02, end_s, _ATTITUDE_S))
        for at_s in np.arange(start_s + 0.06, end_s, _SERVO_S).tolist():
            self._servo_output(at_s)
        for at_s in np.arange(start_s + 0.5, end_s, _SLOW_S).tolist():
            self._slow(at_s)
        if self._dvl:
            self._motion_deltas(np.arange(start_s, end_s + 0.5 * DVL_INTERVAL_S, DVL_INTERVAL_S))

    def _attitudes(self, times_s: FloatArray) -> None:
        motion = self._truth.motion(times_s + self._mission_start_s)
        rotation = motion.rotation_ned_frd
        noise = _RATE_NOISE_RADPS * self._rng.standard_normal((len(times_s), 3))
        # Its EKF keeps yaw on its own compass: the same disturbances as ours, less what it was calibrated for.
        wander = self._errors.compass_wander_rad(times_s) + self._yaw_bias
        rows = np.column_stack(
            (
                np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2]) + self._tilt_bias[0],
                -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0)) + self._tilt_bias[1],
                np.remainder(np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]) + wander + math.pi, 2.0 * math.pi)
                - math.pi,
                motion.angular_rate_frd_radps + noise,
            )
        )
        for at_s, row in zip(times_s.tolist(), rows.tolist(), strict=True):
            message = mavlink.MAVLink_attitude_message(self._boot_ms(at_s), *row)
            self._send(self._mav, message, at_s + _LATENCY_S)

    def _servo_output(self, at_s: float) -> None:
        before, _, _ = self._truth.place(at_s + self._mission_start_s)
        pwm = [int(value) for value in before[columns.FIRST_PWM :].tolist()]
        pwm += [0] * (16 - len(pwm))
        time_us = int(self._boot_ms(at_s) * 1000) & 0xFFFFFFFF
        message = mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pwm)
        self._send(self._mav, message, at_s + _LATENCY_S)

    def _slow(self, at_s: float) -> None:
        before, _, _ = self._truth.place(at_s + self._mission_start_s)
        voltage_v = float(before[columns.VOLTAGE]) + 0.02 * float(self._rng.standard_normal())
        amperes = max(0.0, float(before[columns.AMPERES]) + 0.2 * float(self._rng.standard_normal()))
        cells = [round(voltage_v * 1000.0)] + [0xFFFF] * 9
        battery = mavlink.MAVLink_battery_status_message(
            0, mavlink.MAV_BATTERY_FUNCTION_ALL, mavlink.MAV_BATTERY_TYPE_LIPO, 32767, cells, round(amperes * 100.0),
            -1, -1, -1,
        )  # fmt: skip
        heartbeat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_SUBMARINE,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED,
            2,  # ALT_HOLD
            mavlink.MAV_STATE_ACTIVE,
            3,
        )
        column_m = float(before[2] + before[columns.SURFACE])
        pressure_pa = self._water.pressure_pa(column_m) + self._pressure_offset_pa
        pressure_pa += _PRESSURE_NOISE_PA * float(self._rng.standard_normal())
        temperature_cdegc = round(100.0 * self._water.temperature_degc(column_m))
        pressure = mavlink.MAVLink_scaled_pressure2_message(
            self._boot_ms(at_s), pressure_pa / 100.0, 0.0, temperature_cdegc
        )
        for message in (battery, heartbeat, pressure):
            self._send(self._mav, message, at_s + _LATENCY_S)

    def _motion_deltas(self, edges_s: FloatArray) -> None:
        """One message per interval: how the vehicle moved over ground in it, in the DVL's own frame."""
        fine_s = np.linspace(edges_s[0], edges_s[-1], 4 * (len(edges_s) - 1) + 1)
        motion = self._truth.motion(fine_s + self._mission_start_s)
        body = np.einsum("nji,nj->ni", motion.rotation_ned_frd, motion.velocity_ned_mps)
        turn_c, turn_s = math.cos(self.dvl_errors.yaw_rad), math.sin(self.dvl_errors.yaw_rad)
        for number, start_s in enumerate(edges_s[:-1].tolist()):
            part = slice(4 * number, 4 * number + 5)
            noise = self._rng.standard_normal(4).tolist()
            if self._rng.random() < DVL_INTERVAL_S / _DVL_GAP_EVERY_S:
                self._dvl_gap_until_s = start_s + _DVL_GAP_S * (0.5 + abs(noise[3]))
            if start_s < self._dvl_gap_until_s or not self._has_bottom(motion, part.start):
                continue
            mean = body[part].T @ (0.125, 0.25, 0.25, 0.25, 0.125)
            ahead = (turn_c * mean[0] + turn_s * mean[1], turn_c * mean[1] - turn_s * mean[0], mean[2])
            moved = [
                DVL_INTERVAL_S * (value * (1.0 + self.dvl_errors.scale) + DVL_NOISE_MPS * error)
                for value, error in zip(ahead, noise, strict=False)
            ]
            angle = (DVL_INTERVAL_S * motion.angular_rate_frd_radps[part].mean(axis=0)).tolist()
            end_s = start_s + DVL_INTERVAL_S
            message = mavlink.MAVLink_vision_position_delta_message(
                int(self._boot_ms(end_s) * 1000), round(DVL_INTERVAL_S * 1e6), angle, moved, 90.0
            )
            self._send(self._dvl_mav, message, end_s + _DVL_LATENCY_S)

    def _has_bottom(self, motion: Motion, index: int) -> bool:
        if self._altitude_m is None:
            return True
        north, east, down = motion.position_ned_m[index].tolist()
        return 0.2 < self._altitude_m(north, east, down) < 50.0

    def _boot_ms(self, at_s: float) -> int:
        return int((at_s + _BOOTED_BEFORE_S) * (1.0 + _CLOCK_PPM * 1e-6) * 1000.0)

    def _send(self, sender: Any, message: Any, ready_s: float) -> None:
        """Pack it; the network delays it a little, and now and then a lot."""
        delay_s = _JITTER_S * float(self._rng.exponential())
        if self._rng.random() < _STALL_CHANCE:
            delay_s += _STALL_S * float(self._rng.random())
        data = bytes(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
        self._order += 1
        heapq.heappush(self._waiting, (ready_s + delay_s, self._order, data))
