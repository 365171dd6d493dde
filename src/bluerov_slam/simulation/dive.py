"""A whole dive at once: its truth for those who judge, and what the estimator gets, in order of arrival.

The board's bytes go over the simulated line and the autopilot's over simulated MAVLink; nothing passes beside them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.protocol.mavlink_map import vehicle_record
from bluerov_slam.records import LinkBytes, PositionFix, VehicleRecord
from bluerov_slam.simulation import flight as columns
from bluerov_slam.simulation.board import Board
from bluerov_slam.simulation.conditions import conditions_of
from bluerov_slam.simulation.dive_plan import DivePlan
from bluerov_slam.simulation.flight import STEP_S, Flight
from bluerov_slam.simulation.hull import ANTENNA_FRD_M
from bluerov_slam.simulation.instrument_errors import CompassDeviation, InstrumentErrors
from bluerov_slam.simulation.place import gravity_mps2
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import FlownScene
from bluerov_slam.simulation.sensors import Instruments, errors_for
from bluerov_slam.simulation.thrusters import FRAMES
from bluerov_slam.simulation.truth import TruthRows
from bluerov_slam.simulation.tumble import tumble_rows
from bluerov_slam.simulation.virtual_autopilot import DvlErrors, VirtualAutopilot
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.simulation.world import build_world

READ_S = 0.02
_UPTIME_S = 40.0
_BEYOND_S = 12.0

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrueState:
    """The truth of one instant. `water_velocity_frd_mps`: of the vehicle through the water around it, eddies and all;
    `current_ned_mps` is the current proper, which a filter's current state stands for."""

    at_s: float
    position_ned_m: FloatArray
    velocity_ned_mps: FloatArray
    acceleration_ned_mps2: FloatArray
    rotation_ned_frd: FloatArray
    angular_rate_frd_radps: FloatArray
    water_velocity_frd_mps: FloatArray
    current_ned_mps: FloatArray
    pwm_us: tuple[int, ...]
    voltage_v: float
    gyro_bias_radps: FloatArray
    accel_bias_mps2: FloatArray
    compass_deviation_rad: float
    compass_wander_rad: float

    @property
    def heading_rad(self) -> float:
        """From true north."""
        return math.atan2(self.rotation_ned_frd[1, 0], self.rotation_ned_frd[0, 0])


@dataclass(frozen=True, slots=True)
class TrueTrack:
    """The truth of many instants; first axis = time."""

    times_s: FloatArray
    position_ned_m: FloatArray
    velocity_ned_mps: FloatArray
    acceleration_ned_mps2: FloatArray
    rotation_ned_frd: FloatArray
    angular_rate_frd_radps: FloatArray
    water_velocity_frd_mps: FloatArray
    current_ned_mps: FloatArray
    pwm_us: FloatArray
    voltage_v: FloatArray
    gyro_bias_radps: FloatArray
    accel_bias_mps2: FloatArray
    compass_deviation_rad: FloatArray
    compass_wander_rad: FloatArray


class DiveTruth:
    """What really happened. The estimator never sees any of it.

    `thrust_scale` (surge, sway): true velocity through water over the nominal vehicle's for the same thrust, less 1.
    `compass`: deviation coefficients of the level vehicle without thruster load. The track begins at
    `track_start_s`.
    """

    def __init__(self, plan: DivePlan, seed: int) -> None:
        self.origin_deg = (plan.origin_latitude_deg, plan.origin_longitude_deg)
        self.start_s, self.end_s = 0.0, plan.duration_s
        self.track_start_s = plan.track_start_s
        self.gravity_mps2 = gravity_mps2(plan.origin_latitude_deg)
        self.antenna_frd_m = ANTENNA_FRD_M
        self.dvl_errors = DvlErrors(seed)
        self.thrust_scale = (0.0, 0.0)
        # Instruments are read in blocks, some of which reach beyond the end.
        steps = math.ceil((self.end_s + _BEYOND_S) / STEP_S)
        if plan.kind == "tumble":
            rows = tumble_rows(steps, seed, STEP_S, plan.thrusters)
        else:
            conditions = conditions_of(plan.conditions, plan.noise_family)
            flight = Flight(plan.route(), conditions, seed, 0.0, FRAMES[plan.thrusters])
            rows = flight.fly(steps)
            self.thrust_scale = (flight.hull.surge_scale, flight.hull.sway_scale)
        self.rows = TruthRows(rows, 0.0, STEP_S)
        scenario = _scenario(plan, seed)
        self.scene = FlownScene(
            self.rows, self.origin_deg, lambda: build_world(scenario.seed, plan.water_depth_m), scenario.seed
        )
        self.errors: InstrumentErrors = errors_for(scenario, self.scene)

    @property
    def compass(self) -> CompassDeviation:
        """A, B and C."""
        return self.errors.deviation

    def at(self, at_s: float) -> TrueState:
        """The truth at one virtual time."""
        track = self.track(np.array([at_s]))
        return TrueState(
            at_s,
            track.position_ned_m[0],
            track.velocity_ned_mps[0],
            track.acceleration_ned_mps2[0],
            track.rotation_ned_frd[0],
            track.angular_rate_frd_radps[0],
            track.water_velocity_frd_mps[0],
            track.current_ned_mps[0],
            tuple(int(value) for value in track.pwm_us[0]),
            float(track.voltage_v[0]),
            track.gyro_bias_radps[0],
            track.accel_bias_mps2[0],
            float(track.compass_deviation_rad[0]),
            float(track.compass_wander_rad[0]),
        )

    def track(self, times_s: FloatArray) -> TrueTrack:
        """The truth at many virtual times."""
        times_s = np.asarray(times_s, np.float64)
        motion = self.rows.motion(times_s)
        before, after, share = self.rows.rows_at(times_s)
        mixed = before + share[:, None] * (after - before)
        current = np.column_stack((mixed[:, columns.CURRENT], np.zeros(len(times_s))))
        rotation = motion.rotation_ned_frd
        return TrueTrack(
            times_s,
            motion.position_ned_m,
            motion.velocity_ned_mps,
            motion.acceleration_ned_mps2,
            rotation,
            motion.angular_rate_frd_radps,
            mixed[:, columns.THROUGH_WATER],
            current,
            before[:, columns.FIRST_PWM :],
            mixed[:, columns.VOLTAGE],
            self.errors.gyro_bias_radps(times_s),
            self.errors.acceleration_bias_mps2(times_s),
            self.errors.compass_error_rad(times_s, rotation, motion.amperes),
            self.errors.compass_wander_rad(times_s),
        )


class SimulatedDive:
    """One dive of a plan and seed. `board`: the native firmware core, else the Python reference; closed at the end."""

    def __init__(self, plan: DivePlan, seed: int, board: Board | None = None) -> None:
        self.plan = plan
        self.seed = seed
        self.truth = DiveTruth(plan, seed)
        self._board = board

    def inputs(self) -> Iterator[LinkBytes | VehicleRecord | PositionFix]:
        """What the host hears, in order of arrival, on the virtual clock. Once per dive."""
        truth, scenario = self.truth, _scenario(self.plan, self.seed)
        instruments = Instruments(scenario, truth.scene, truth.errors)
        esp32 = VirtualEsp32(scenario, scene=truth.scene, board=self._board, instruments=instruments)
        autopilot = VirtualAutopilot(truth.rows, truth.errors, self.seed, water=self.plan.water, dvl=self.plan.dvl)
        decoder = mavlink.MAVLink(None)
        try:
            for number in range(1, math.floor(truth.end_s / READ_S) + 1):
                now_s = number * READ_S
                for arrived_s, data in autopilot.advance(now_s) if self.plan.kind != "tumble" else ():
                    message = decoder.decode(bytearray(data))
                    record = vehicle_record(message.get_type(), message.to_dict(), arrived_s)
                    if record is not None:
                        yield record
                data = esp32.advance(now_s)
                if data:
                    yield LinkBytes(data, now_s)
        finally:
            esp32.close()


def _scenario(plan: DivePlan, seed: int) -> Scenario:
    """The board and its surroundings for a dive: no sonars, the usual rates, switched on a while ago."""
    return replace(
        Scenario(),
        name=plan.name,
        seed=seed,
        water_depth_m=plan.water_depth_m,
        water=plan.water,
        origin_latitude_deg=plan.origin_latitude_deg,
        origin_longitude_deg=plan.origin_longitude_deg,
        ping_period_ms=0,
        b_starts_mid_ping=False,
        uptime_s=_UPTIME_S,
        conditions=plan.conditions,
        noise_family=plan.noise_family,
        uncalibrated=plan.uncalibrated,
        acoustics=None if plan.acoustics is None else replace(plan.acoustics, link="serial"),
        faults=plan.faults,
        clock_drift_ppm=float(np.clip(12.0 * np.random.default_rng([seed, 0xC10C]).standard_normal(), -40.0, 40.0)),
    )
