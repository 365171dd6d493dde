"""The virtual instruments beside the sonars: HWT905, u-blox, MS5837, TSYS01 and EZO EC, with noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation import instrument_errors as errors_of
from bluerov_slam.simulation.conditions import RECORDED, conditions_of
from bluerov_slam.simulation.instrument_errors import InstrumentErrors
from bluerov_slam.simulation.place import gravity_mps2, magnetic_field_ned_nt, metres_per_degree
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import RecordedScene, Scene, geodetic
from bluerov_slam.simulation.vehicle import VehicleState
from bluerov_slam.simulation.water import (
    GRAVITY_MPS2,
    practical_salinity_psu,
)

ACCELERATION_LSB_MPS2 = 16.0 * GRAVITY_MPS2 / 32768.0
ANGULAR_RATE_LSB_RADPS = math.radians(2000.0) / 32768.0
FIRST_FIX_S = 6.0  # after power-up; a receiver that still has its almanac and a clock
FIX_AFTER_SURFACING_S = 3.0

_MAGNETIC_LSB_NT = 13.0
_TEMPERATURE_NOISE_DEGC = 0.003
_MS5837_OFFSET_DEGC = 0.35
_IMU_BLOCK_S = 4.0
_IMU_DELAY_S = 0.010  # of its low-pass filter
_GPS_SETTLING_S, _GPS_UNSETTLED = 10.0, 1.5  # the first fixes after an interruption are worse by this share
_GPS_OUTAGE_EVERY_S, _GPS_OUTAGE_S = 150.0, 4.0
_WASHED_S = 1.2  # how long a receiver lives on without its antenna

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImuReading:
    """One set of HWT905 packets, in device units, axes as mounted: body FRD; yaw from magnetic north."""

    acceleration: tuple[int, int, int]
    angular_rate: tuple[int, int, int]
    magnetic_field: tuple[int, int, int]
    angles_rad: tuple[float, float, float]


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
    """Reads every instrument at a virtual time. Each must be read in order of time; noise follows from the seed."""

    def __init__(self, scenario: Scenario, scene: Scene, errors: InstrumentErrors | None = None) -> None:
        self._scenario = scenario
        self._scene = scene
        self.errors = errors or errors_for(scenario, scene)
        self._gravity_mps2 = gravity_mps2(scene.origin_latitude_deg)
        self._imu_rng = np.random.default_rng([scenario.seed, 0x1A0])
        self._gps_rng = np.random.default_rng([scenario.seed, 0x695])
        self._ctd_rng = np.random.default_rng([scenario.seed, 0xC7D])
        self._imu_times_s: list[float] = []
        self._imu_readings: list[ImuReading] = []
        self._imu_next = 0
        self._gps_out_of_water_s: float | None = 0.0
        self._gps_seen_s = -math.inf
        self._gps_powered_s = 0.0
        self._gps_outage_until_s = -math.inf

    def power_up(self, at_s: float) -> None:
        """The board and with it the GPS receiver got power at this instant."""
        self._gps_powered_s = self._gps_out_of_water_s = at_s

    def state(self, at_s: float) -> VehicleState:
        """The true state, for those who draw or judge."""
        return self._scene.state(self._scenario.mission_start_s + at_s)

    def imu(self, at_s: float, interval_s: float = 0.05) -> ImuReading:
        """Specific force, angular rate, magnetic field and the sensor's own angles; the next one `interval_s` later."""
        index = self._imu_next
        if index >= len(self._imu_times_s) or abs(self._imu_times_s[index] - at_s) > 1.0e-6:
            times_s: FloatArray = at_s + interval_s * np.arange(max(1.0, _IMU_BLOCK_S / interval_s))
            self._imu_times_s, self._imu_readings = times_s.tolist(), self._imu_block(times_s)
            index = 0
        self._imu_next = index + 1
        return self._imu_readings[index]

    def _imu_block(self, times_s: FloatArray) -> list[ImuReading]:
        """A few seconds at once, because one sample alone costs nearly as much."""
        errors = self.errors
        motion = self._scene.motion(self._scenario.mission_start_s + times_s - _IMU_DELAY_S)
        noise = self._imu_rng.standard_normal((len(times_s), 12))
        force_ned = motion.acceleration_ned_mps2 - (0.0, 0.0, self._gravity_mps2)
        force = np.einsum("nji,nj->ni", motion.rotation_ned_frd, force_ned) @ errors.acceleration_matrix.T
        force += errors.acceleration_bias_mps2(times_s) + errors_of.ACCELERATION_WHITE_MPS2 * noise[:, 0:3]
        rate = motion.angular_rate_frd_radps @ errors.gyro_matrix.T
        rate += errors.gyro_bias_radps(times_s) + errors_of.GYRO_WHITE_RADPS * noise[:, 3:6]
        field_nt = errors.magnetic_field_nt(times_s, motion.rotation_ned_frd, motion.amperes)
        field_nt = field_nt + errors_of.MAGNETIC_WHITE_NT * noise[:, 6:9]
        angles = _euler(motion.rotation_ned_frd)
        declination = math.atan2(errors.field_ned_nt[1], errors.field_ned_nt[0])
        angles[:, :2] += errors.tilt_error_rad(times_s)
        angles[:, 2] += errors.compass_error_rad(times_s, motion.rotation_ned_frd, motion.amperes) - declination
        angles += errors_of.ANGLE_WHITE_RAD * noise[:, 9:12]
        angles[:, 2] = np.remainder(angles[:, 2] + math.pi, 2.0 * math.pi) - math.pi
        return [
            ImuReading((ax, ay, az), (p, q, r), (mx, my, mz), (roll, pitch, yaw))
            for (ax, ay, az), (p, q, r), (mx, my, mz), (roll, pitch, yaw) in zip(
                _int16(force / ACCELERATION_LSB_MPS2),
                _int16(rate / ANGULAR_RATE_LSB_RADPS),
                _int16(field_nt / _MAGNETIC_LSB_NT),
                angles.tolist(),
                strict=True,
            )
        ]

    def gps(self, at_s: float) -> GpsReading:
        """The report of this second: no fix under water, nor right after surfacing, nor now and then for a while."""
        state = self.state(at_s)
        noise = self._gps_rng.standard_normal(6).tolist()
        if self._gps_rng.random() < 1.0 / _GPS_OUTAGE_EVERY_S:
            self._gps_outage_until_s = at_s + _GPS_OUTAGE_S * (0.5 + abs(noise[5]))
        utc_unix_s = self._scenario.utc_start_unix_s + at_s
        powered_s = at_s - self._gps_powered_s
        time_known = utc_unix_s if powered_s >= FIRST_FIX_S - 2.0 else None
        if state.fix_possible and at_s >= self._gps_outage_until_s:
            self._gps_seen_s = at_s
        elif at_s - self._gps_seen_s > _WASHED_S:
            self._gps_out_of_water_s = None
        if at_s - self._gps_seen_s > _WASHED_S:
            return GpsReading(0, 0, 99.99, 0.0, 0.0, 0.0, 0.0, 0.0, time_known)
        if self._gps_out_of_water_s is None:
            self._gps_out_of_water_s = at_s
        waited_s = at_s - self._gps_out_of_water_s
        again = self._gps_out_of_water_s > self._gps_powered_s
        if powered_s < FIRST_FIX_S or (again and waited_s < FIX_AFTER_SURFACING_S):
            return GpsReading(0, min(3, int(waited_s)), 99.99, 0.0, 0.0, 0.0, 0.0, 0.0, time_known)
        worse = 1.0 + _GPS_UNSETTLED * math.exp(-waited_s / _GPS_SETTLING_S)
        latitude_deg, longitude_deg = geodetic(self._scene, state)
        north_m, east_m, up_m = self.errors.gps_wander_m(at_s)
        north_m += errors_of.GPS_WHITE_M * noise[0]
        east_m += errors_of.GPS_WHITE_M * noise[1]
        per_north, per_east = metres_per_degree(latitude_deg)
        satellites = 8 + int(abs(noise[2]) * 2.0)
        speed_mps = abs(state.speed_mps + 0.05 * noise[4])
        course = state.yaw_rad if state.course_rad is None else state.course_rad
        course += 0.06 * noise[5] / max(0.1, state.speed_mps)
        return GpsReading(
            fix=3,
            satellites=satellites,
            hdop=(0.8 + 1.2 / satellites) * worse,
            latitude_deg=latitude_deg + worse * north_m / per_north,
            longitude_deg=longitude_deg + worse * east_m / per_east,
            altitude_m=47.0 + worse * (up_m + 0.8 * noise[3]),
            speed_mps=speed_mps,
            course_rad=course % (2.0 * math.pi),
            utc_unix_s=time_known,
        )

    def pressure_pa(self, at_s: float) -> float:
        """Absolute pressure of the MS5837."""
        column_m = self._scene.water_above_m(self._scenario.mission_start_s + at_s)
        clean = self._scenario.water.pressure_pa(column_m, self._gravity_mps2)
        noise = errors_of.PRESSURE_WHITE_PA * float(self._ctd_rng.standard_normal())
        return clean + self.errors.pressure_error_pa(at_s) + noise

    def depth_sensor_temperature_degc(self, at_s: float) -> float:
        """The MS5837's own temperature: slower and a little warmer than the water."""
        water = self._scenario.water
        lagged = water.temperature_degc(self._depth_m(max(0.0, at_s - 8.0)))
        return lagged + _MS5837_OFFSET_DEGC + 0.01 * float(self._ctd_rng.standard_normal())

    def temperature_degc(self, at_s: float) -> float:
        """The TSYS01."""
        clean = self._scenario.water.temperature_degc(self._depth_m(at_s))
        return clean + _TEMPERATURE_NOISE_DEGC * float(self._ctd_rng.standard_normal())

    def conductivity(self, at_s: float) -> tuple[float, float]:
        """The EZO EC: conductivity in uS/cm, and its own idea of salinity (which ignores pressure)."""
        depth_m = self._depth_m(at_s)
        water = self._scenario.water
        noise = 1.0 + 0.0004 * float(self._ctd_rng.standard_normal())
        conductivity = water.conductivity_s_per_m(depth_m) * noise
        salinity_psu = practical_salinity_psu(conductivity, water.temperature_degc(depth_m), 0.0)
        return conductivity * 1.0e4, salinity_psu

    def _depth_m(self, at_s: float) -> float:
        return max(0.0, self._scene.water_above_m(self._scenario.mission_start_s + at_s))


def errors_for(scenario: Scenario, scene: Scene) -> InstrumentErrors:
    """The instruments of this scenario, where this scene is."""
    field = magnetic_field_ned_nt(scene.origin_latitude_deg, scene.origin_longitude_deg, scenario.utc_start_unix_s)
    recorded = isinstance(scene, RecordedScene)
    conditions = RECORDED if recorded else conditions_of(scenario.conditions, scenario.noise_family)
    return InstrumentErrors(conditions, scenario.seed, field, scenario.uncalibrated)


def _euler(rotations: FloatArray) -> FloatArray:
    """Roll, pitch, yaw: (n, 3)."""
    return np.column_stack(
        (
            np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2]),
            -np.arcsin(np.clip(rotations[:, 2, 0], -1.0, 1.0)),
            np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]),
        )
    )


def _int16(values: FloatArray) -> list[list[int]]:
    return np.clip(np.rint(values), -32768, 32767).astype(int).tolist()  # type: ignore[no-any-return]
