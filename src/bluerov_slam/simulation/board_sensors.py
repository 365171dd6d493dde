"""The board's view of its small sensors: last readings, which of them are alive, and the SENSORS payload."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from bluerov_slam.protocol.sensor_frame import SensorFields, pack_sensors, sensor_fields
from bluerov_slam.records import Channel, Sender, SensorSample
from bluerov_slam.simulation.sensors import GpsReading, ImuReading, Instruments
from bluerov_slam.simulation.sonar_port import SonarPort
from bluerov_slam.simulation.water import (
    GRAVITY_MPS2,
    practical_salinity_psu,
    sound_speed_mps,
)

_DENSITY_KG_PER_M3 = 1025.0  # svp_depth of the wire is defined with this one
_PACKETS_PER_IMU_SAMPLE = 4
_IMU_TIMEOUT_S, _GPS_TIMEOUT_S, _EC_TIMEOUT_S = 1.2, 3.0, 3.0
_MACKENZIE_DEGC, _MACKENZIE_PSU = (-2.0, 30.0), (25.0, 40.0)
_U32 = 0xFFFFFFFF

Reading = TypeVar("Reading")


class BoardSensors:
    """Polls the instruments unless a fault keeps them silent."""

    def __init__(self, instruments: Instruments, is_silent: Callable[[str], bool], legacy: bool) -> None:
        self.i2c_failing = False
        self._instruments = instruments
        self._is_silent = is_silent
        self._legacy = legacy
        self._imu: tuple[float, ImuReading] | None = None
        self._gps: tuple[float, GpsReading] | None = None
        self._ec: tuple[float, tuple[float, float]] | None = None
        self._imu_packets = 0

    def poll_imu(self, now_s: float) -> ImuReading | None:
        """One sample, None while the IMU is silent."""
        if self._is_silent("imu"):
            return None
        reading = self._instruments.imu(now_s)
        self._imu = (now_s, reading)
        self._imu_packets += _PACKETS_PER_IMU_SAMPLE
        return reading

    def poll_gps(self, now_s: float) -> GpsReading | None:
        """One report, None while the receiver is silent."""
        if self._is_silent("gps"):
            return None
        reading = self._instruments.gps(now_s)
        self._gps = (now_s, reading)
        return reading

    def poll_conductivity(self, now_s: float) -> None:
        """The EZO EC answers once a second."""
        if not self._is_silent("ec"):
            self._ec = (now_s, self._instruments.conductivity(now_s))

    def payload(self, now_s: float, device_ms: int, ports: dict[Channel, SonarPort]) -> bytes:
        """SENSORS at this instant."""
        fields = sensor_fields(self._sample(now_s, device_ms, ports))
        return pack_sensors(_as_legacy(fields) if self._legacy else fields)

    def _sample(self, now_s: float, device_ms: int, ports: dict[Channel, SonarPort]) -> SensorSample:
        imu = _fresh(self._imu, now_s, _IMU_TIMEOUT_S)
        gps = _fresh(self._gps, now_s, _GPS_TIMEOUT_S)
        ec = _fresh(self._ec, now_s, _EC_TIMEOUT_S)
        depth_ok = not (self._is_silent("depth") or self.i2c_failing)
        temperature_ok = not (self._is_silent("celsius") or self.i2c_failing)
        pressure_pa = self._instruments.pressure_pa(now_s) if depth_ok else None
        temperature_degc = self._instruments.temperature_degc(now_s) if temperature_ok else None
        depth_m = self._depth_m(pressure_pa)
        conductivity_us, ec_salinity_psu = ec or (None, None)
        salinity_psu = _salinity_psu(conductivity_us, temperature_degc, depth_m)
        has_fix = gps is not None and gps.fix > 0
        acceleration = tuple(g * GRAVITY_MPS2 for g in imu.acceleration_g) if imu else None
        return SensorSample(
            measured_s=now_s,
            arrived_s=now_s,
            device_ms=device_ms,
            sender=Sender.FULL_RANGE,
            roll_rad=imu.angles_rad[0] if imu else None,
            pitch_rad=imu.angles_rad[1] if imu else None,
            yaw_rad=imu.angles_rad[2] if imu else None,
            acceleration_frd_mps2=(acceleration[0], acceleration[1], acceleration[2]) if acceleration else None,
            imu_packets=self._imu_packets & _U32,
            imu_errors=0,
            imu_alive=imu is not None,
            gps_latitude_deg=gps.latitude_deg if gps and has_fix else None,
            gps_longitude_deg=gps.longitude_deg if gps and has_fix else None,
            gps_altitude_m=gps.altitude_m if gps and has_fix else None,
            gps_satellites=gps.satellites if gps else 0,
            gps_alive=gps is not None,
            conductivity_s_per_m=None if conductivity_us is None else conductivity_us / 1.0e4,
            ec_salinity_psu=ec_salinity_psu,
            ec_alive=ec is not None,
            pressure_pa=pressure_pa,
            depth_sensor_temperature_degc=self._instruments.depth_sensor_temperature_degc(now_s) if depth_ok else None,
            depth_ok=depth_ok,
            temperature_degc=temperature_degc,
            temperature_ok=temperature_ok,
            sound_speed_wire_mps=_sound_speed_mps(temperature_degc, salinity_psu, depth_m),
            depth_wire_m=depth_m,
            salinity_wire_psu=salinity_psu,
            a_packets=ports[Channel.A].packets & _U32,
            a_bytes=ports[Channel.A].bytes & _U32,
            b_packets=ports[Channel.B].packets & _U32,
            b_bytes=ports[Channel.B].bytes & _U32,
        )

    def _depth_m(self, pressure_pa: float | None) -> float | None:
        if pressure_pa is None:
            return None
        over_surface_pa = pressure_pa - self._instruments.surface_pressure_pa
        return max(0.0, over_surface_pa / (_DENSITY_KG_PER_M3 * GRAVITY_MPS2))


def _fresh(stamped: tuple[float, Reading] | None, now_s: float, timeout_s: float) -> Reading | None:
    return stamped[1] if stamped is not None and now_s - stamped[0] <= timeout_s else None


def _salinity_psu(conductivity_us: float | None, temperature_degc: float | None, depth_m: float | None) -> float | None:
    if conductivity_us is None or temperature_degc is None:
        return None
    return max(0.0, practical_salinity_psu(conductivity_us / 1.0e4, temperature_degc, 1.005 * (depth_m or 0.0)))


def _sound_speed_mps(temperature_degc: float | None, salinity_psu: float | None, depth_m: float | None) -> float | None:
    """Mackenzie's formula where it holds; nothing in fresh water."""
    if temperature_degc is None or salinity_psu is None or depth_m is None:
        return None
    valid = (
        _MACKENZIE_DEGC[0] <= temperature_degc <= _MACKENZIE_DEGC[1]
        and _MACKENZIE_PSU[0] <= salinity_psu <= _MACKENZIE_PSU[1]
    )
    return sound_speed_mps(temperature_degc, salinity_psu, depth_m) if valid else None


def _as_legacy(fields: SensorFields) -> SensorFields:
    """What the user's old firmware sends: no extension, and the short fields wrap in silence."""
    known_ec, known_depth = fields.full_conductivity_dus != 0xFFFFFF, fields.full_pressure_pa != 0xFFFFFF
    return replace(
        fields,
        extension=0,
        conductivity_dus=fields.full_conductivity_dus & 0xFFFF if known_ec else 0,
        pressure_dmbar=(fields.full_pressure_pa // 10) & 0xFFFF if known_depth else 0,
        full_conductivity_dus=0,
        full_pressure_pa=0,
        salinity_dpsu=_wrapped_salinity(fields),
    )


def _wrapped_salinity(fields: SensorFields) -> int:
    """The probe's salinity in 0.1 PSU, cut to eight bits."""
    return (fields.ec_salinity_cpsu // 10) & 0xFF if fields.ec_salinity_cpsu != 0xFFFF else 0
