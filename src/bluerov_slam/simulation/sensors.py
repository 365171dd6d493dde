"""The virtual instruments beside the sonars: HWT905, u-blox, MS5837, TSYS01 and EZO EC, with noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import Scene, geodetic
from bluerov_slam.simulation.vehicle import VehicleState
from bluerov_slam.simulation.water import (
    GRAVITY_MPS2,
    SURFACE_PRESSURE_PA,
    practical_salinity_psu,
)

ACCELERATION_LSB_MPS2 = 16.0 * GRAVITY_MPS2 / 32768.0
ANGULAR_RATE_LSB_RADPS = math.radians(2000.0) / 32768.0
FIRST_FIX_S = 6.0  # after power-up; a receiver that still has its almanac and a clock
FIX_AFTER_SURFACING_S = 3.0

_MAGNETIC_FIELD_NED_NT = (21_200.0, -200.0, 42_600.0)
_MAGNETIC_LSB_NT = 13.0
_HARD_IRON_NT = (900.0, -1_400.0, 500.0)
_ACCELERATION_NOISE_MPS2 = 0.02
_GYRO_NOISE_RADPS = math.radians(0.05)
_GYRO_BIAS_RADPS = (math.radians(0.12), math.radians(-0.07), math.radians(0.09))
_ANGLE_NOISE_RAD = math.radians(0.03)
_PRESSURE_NOISE_PA = 15.0
_TEMPERATURE_NOISE_DEGC = 0.003
_MS5837_OFFSET_DEGC = 0.35
_DIFFERENCE_S = 0.1

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImuReading:
    """One set of HWT905 packets, in device units, axes as mounted: body FRD."""

    acceleration: tuple[int, int, int]
    angular_rate: tuple[int, int, int]
    magnetic_field: tuple[int, int, int]
    angles_rad: tuple[float, float, float]
    acceleration_g: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GpsReading:
    """One report of the receiver; `fix` is 0, 2 or 3. Without a fix the position is 0, as the receiver's NMEA."""

    fix: int
    satellites: int
    hdop: float
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    speed_mps: float
    course_rad: float
    utc_unix_s: float | None


class Instruments:
    """Reads every instrument at a virtual time. Noise is drawn call by call from one seeded generator each."""

    def __init__(self, scenario: Scenario, scene: Scene) -> None:
        self._scenario = scenario
        self._scene = scene
        self._imu_rng = np.random.default_rng([scenario.seed, 0x1A0])
        self._gps_rng = np.random.default_rng([scenario.seed, 0x695])
        self._ctd_rng = np.random.default_rng([scenario.seed, 0xC7D])
        self._gps_wander_m = [0.0, 0.0]
        self._gps_out_of_water_s: float | None = None
        self._gps_powered_s = 0.0

    def power_up(self, at_s: float) -> None:
        """The board and with it the GPS receiver got power at this instant."""
        self._gps_powered_s = at_s

    def state(self, at_s: float) -> VehicleState:
        """The true state, for those who draw or judge."""
        return self._scene.state(self._scenario.mission_start_s + at_s)

    def imu(self, at_s: float) -> ImuReading:
        """Specific force, angular rate, magnetic field and the sensor's own angles."""
        before, now, after = (self.state(at_s + step) for step in (-_DIFFERENCE_S, 0.0, _DIFFERENCE_S))
        rotation = _rotation_ned_frd(now)
        force_ned = (_position(after) - 2.0 * _position(now) + _position(before)) / _DIFFERENCE_S**2
        force_ned[2] -= GRAVITY_MPS2
        turn = _rotation_ned_frd(before).T @ _rotation_ned_frd(after)
        rate = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        noise = self._imu_rng.standard_normal(12)
        force = rotation.T @ force_ned + _ACCELERATION_NOISE_MPS2 * noise[0:3]
        rate = rate / (4.0 * _DIFFERENCE_S) + np.array(_GYRO_BIAS_RADPS) + _GYRO_NOISE_RADPS * noise[3:6]
        field_nt = rotation.T @ np.array(_MAGNETIC_FIELD_NED_NT) + np.array(_HARD_IRON_NT) + 60.0 * noise[6:9]
        angles = np.array([now.roll_rad, now.pitch_rad, now.yaw_rad]) + _ANGLE_NOISE_RAD * noise[9:12]
        return ImuReading(
            _int16(force / ACCELERATION_LSB_MPS2),
            _int16(rate / ANGULAR_RATE_LSB_RADPS),
            _int16(field_nt / _MAGNETIC_LSB_NT),
            (float(angles[0]), float(angles[1]), math.remainder(float(angles[2]), 2.0 * math.pi)),
            tuple((force / GRAVITY_MPS2).tolist()),
        )

    def gps(self, at_s: float) -> GpsReading:
        """The report of this second: no fix under water, nor right after surfacing."""
        state = self.state(at_s)
        noise = self._gps_rng.standard_normal(5)
        for axis in (0, 1):
            self._gps_wander_m[axis] = 0.95 * self._gps_wander_m[axis] + 0.25 * float(noise[axis])
        utc_unix_s = self._scenario.utc_start_unix_s + at_s
        powered_s = at_s - self._gps_powered_s
        time_known = utc_unix_s if powered_s >= FIRST_FIX_S - 2.0 else None
        if not state.fix_possible:
            self._gps_out_of_water_s = None
            return GpsReading(0, 0, 99.99, 0.0, 0.0, 0.0, 0.0, 0.0, time_known)
        if self._gps_out_of_water_s is None:
            self._gps_out_of_water_s = at_s
        waited_s = at_s - self._gps_out_of_water_s
        if powered_s < FIRST_FIX_S or (self._gps_out_of_water_s > FIRST_FIX_S and waited_s < FIX_AFTER_SURFACING_S):
            return GpsReading(0, min(3, int(waited_s)), 99.99, 0.0, 0.0, 0.0, 0.0, 0.0, time_known)
        latitude_deg, longitude_deg = geodetic(self._scene, state)
        north_deg = self._gps_wander_m[0] / 111_195.0
        east_deg = self._gps_wander_m[1] / (111_195.0 * math.cos(math.radians(latitude_deg)))
        satellites = 8 + int(abs(noise[2]) * 2.0)
        return GpsReading(
            fix=3,
            satellites=satellites,
            hdop=0.8 + 4.0 / satellites,
            latitude_deg=latitude_deg + north_deg,
            longitude_deg=longitude_deg + east_deg,
            altitude_m=47.0 + 0.8 * float(noise[3]),
            speed_mps=abs(state.speed_mps + 0.05 * float(noise[4])),
            course_rad=state.yaw_rad % (2.0 * math.pi),
            utc_unix_s=time_known,
        )

    def pressure_pa(self, at_s: float) -> float:
        """Absolute pressure of the MS5837."""
        clean = self._scenario.water.pressure_pa(self.state(at_s).depth_m)
        return clean + _PRESSURE_NOISE_PA * float(self._ctd_rng.standard_normal())

    def depth_sensor_temperature_degc(self, at_s: float) -> float:
        """The MS5837's own temperature: slower and a little warmer than the water."""
        water = self._scenario.water
        lagged = water.temperature_degc(self.state(max(0.0, at_s - 8.0)).depth_m)
        return lagged + _MS5837_OFFSET_DEGC + 0.01 * float(self._ctd_rng.standard_normal())

    def temperature_degc(self, at_s: float) -> float:
        """The TSYS01."""
        clean = self._scenario.water.temperature_degc(self.state(at_s).depth_m)
        return clean + _TEMPERATURE_NOISE_DEGC * float(self._ctd_rng.standard_normal())

    def conductivity(self, at_s: float) -> tuple[float, float]:
        """The EZO EC: conductivity in uS/cm, and its own idea of salinity (which ignores pressure)."""
        depth_m = self.state(at_s).depth_m
        water = self._scenario.water
        noise = 1.0 + 0.0004 * float(self._ctd_rng.standard_normal())
        conductivity = water.conductivity_s_per_m(depth_m) * noise
        salinity_psu = practical_salinity_psu(conductivity, water.temperature_degc(depth_m), 0.0)
        return conductivity * 1.0e4, salinity_psu

    @property
    def surface_pressure_pa(self) -> float:
        """What the firmware takes as the pressure at the surface."""
        return SURFACE_PRESSURE_PA


def _position(state: VehicleState) -> FloatArray:
    return np.array([state.north_m, state.east_m, state.depth_m])


def _rotation_ned_frd(state: VehicleState) -> FloatArray:
    """Body to world, from yaw, pitch, roll in that order."""
    cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
    cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
    cy, sy = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def _int16(values: FloatArray) -> tuple[int, int, int]:
    x, y, z = np.clip(np.rint(values), -32768, 32767).astype(int).tolist()
    return x, y, z
