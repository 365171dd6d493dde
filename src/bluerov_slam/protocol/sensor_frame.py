"""The 76 bytes of SENSORS: exact integers of the wire, and the record in SI units made from them.

Three of the original fields are too small for the sea: conductivity and pressure are repeated at full range in the
former padding (extension version 1), and what does not fit a short field saturates. A legacy sender (extension 0)
wraps in silence; whether its values can be believed is for the caller to find out.
"""

from __future__ import annotations

import math
import struct
from dataclasses import astuple, dataclass

from bluerov_slam.protocol.fixed_point import (
    I16_MAX,
    I16_MIN,
    I32_MAX,
    I32_MIN,
    U8_MAX,
    U16_MAX,
    U24_MAX,
    is_position_e7,
    saturated,
)
from bluerov_slam.records import Sender, SensorSample

SENSORS_BYTES = 76
EXTENSION_FULL_RANGE = 1
STANDARD_GRAVITY_MPS2 = 9.80665
LEGACY_SALINITY_TOLERANCE_PSU = 2.0

_LAYOUT = struct.Struct("<I6hIHB2ih2B2HBB3s3sHhBhB2HB4I")


@dataclass(frozen=True, slots=True)
class SensorFields:
    """SENSORS as on the wire, in wire order; units are in the names (`cdeg` 0.01 degree, `mg` 0.001 g...)."""

    device_ms: int
    roll_cdeg: int
    pitch_cdeg: int
    yaw_cdeg: int
    acceleration_x_mg: int
    acceleration_y_mg: int
    acceleration_z_mg: int
    imu_packets: int
    imu_errors: int
    imu_alive: int
    latitude_e7: int
    longitude_e7: int
    altitude_dm: int
    satellites: int
    gps_alive: int
    conductivity_dus: int
    ec_salinity_cpsu: int
    ec_alive: int
    extension: int
    full_conductivity_dus: int
    full_pressure_pa: int
    pressure_dmbar: int
    depth_temperature_cdegc: int
    depth_ok: int
    temperature_cdegc: int
    temperature_ok: int
    sound_speed_dmps: int
    depth_cm: int
    salinity_dpsu: int
    a_packets: int
    a_bytes: int
    b_packets: int
    b_bytes: int


def unpack_sensors(payload: bytes) -> SensorFields | None:
    """Fields of 0x01; None unless there are exactly 76 bytes."""
    if len(payload) != SENSORS_BYTES:
        return None
    values = list(_LAYOUT.unpack(payload))
    for at in (19, 20):
        values[at] = int.from_bytes(values[at], "little")
    return SensorFields(*values)


def pack_sensors(fields: SensorFields) -> bytes:
    """Payload of 0x01."""
    values = list(astuple(fields))
    for at in (19, 20):
        values[at] = values[at].to_bytes(3, "little")
    return _LAYOUT.pack(*values)


def sensor_sample(
    fields: SensorFields,
    measured_s: float,
    arrived_s: float,
    *,
    conductivity_trusted: bool = True,
    pressure_trusted: bool = True,
) -> SensorSample:
    """The record of one frame; what the wire marks unavailable, or the caller does not trust, is None."""
    full_range = fields.extension == EXTENSION_FULL_RANGE
    imu_known = bool(fields.imu_alive) and any(_imu_counts(fields))
    position_known = bool(fields.gps_alive) and is_position_e7(fields.latitude_e7, fields.longitude_e7)
    conductivity_dus = _conductivity_dus(fields) if conductivity_trusted else None
    pressure_pa = _pressure_pa(fields) if pressure_trusted else None
    return SensorSample(
        measured_s=measured_s,
        arrived_s=arrived_s,
        device_ms=fields.device_ms,
        sender=Sender.FULL_RANGE if full_range else Sender.LEGACY,
        roll_rad=math.radians(fields.roll_cdeg / 100) if imu_known else None,
        pitch_rad=math.radians(fields.pitch_cdeg / 100) if imu_known else None,
        yaw_rad=math.radians(fields.yaw_cdeg / 100) if imu_known else None,
        acceleration_frd_mps2=_acceleration(fields) if imu_known else None,
        imu_packets=fields.imu_packets,
        imu_errors=fields.imu_errors,
        imu_alive=bool(fields.imu_alive),
        gps_latitude_deg=fields.latitude_e7 / 1e7 if position_known else None,
        gps_longitude_deg=fields.longitude_e7 / 1e7 if position_known else None,
        gps_altitude_m=fields.altitude_dm / 10 if position_known else None,
        gps_satellites=fields.satellites,
        gps_alive=bool(fields.gps_alive),
        conductivity_s_per_m=None if conductivity_dus is None else conductivity_dus / 1e5,
        ec_salinity_psu=fields.ec_salinity_cpsu / 100
        if fields.ec_alive and fields.ec_salinity_cpsu < U16_MAX
        else None,
        ec_alive=bool(fields.ec_alive),
        pressure_pa=pressure_pa,
        depth_sensor_temperature_degc=fields.depth_temperature_cdegc / 100 if fields.depth_ok else None,
        depth_ok=bool(fields.depth_ok),
        temperature_degc=fields.temperature_cdegc / 100 if fields.temperature_ok else None,
        temperature_ok=bool(fields.temperature_ok),
        sound_speed_wire_mps=fields.sound_speed_dmps / 10 if 0 < fields.sound_speed_dmps < U16_MAX else None,
        depth_wire_m=fields.depth_cm / 100 if fields.depth_ok and fields.depth_cm < U16_MAX else None,
        salinity_wire_psu=_wire_salinity_psu(fields),
        a_packets=fields.a_packets,
        a_bytes=fields.a_bytes,
        b_packets=fields.b_packets,
        b_bytes=fields.b_bytes,
    )


def sensor_fields(sample: SensorSample) -> SensorFields:
    """What a full-range sender puts on the wire for `sample`: short fields saturate, unknown values say so."""
    acceleration = sample.acceleration_frd_mps2 or (0.0, 0.0, 0.0)
    conductivity_dus = _scaled(sample.conductivity_s_per_m, 1e5)
    pressure_pa = _scaled(sample.pressure_pa, 1.0)
    return SensorFields(
        device_ms=sample.device_ms,
        roll_cdeg=_angle_cdeg(sample.roll_rad),
        pitch_cdeg=_angle_cdeg(sample.pitch_rad),
        yaw_cdeg=_angle_cdeg(sample.yaw_rad),
        acceleration_x_mg=saturated(acceleration[0] / STANDARD_GRAVITY_MPS2 * 1000, I16_MIN, I16_MAX),
        acceleration_y_mg=saturated(acceleration[1] / STANDARD_GRAVITY_MPS2 * 1000, I16_MIN, I16_MAX),
        acceleration_z_mg=saturated(acceleration[2] / STANDARD_GRAVITY_MPS2 * 1000, I16_MIN, I16_MAX),
        imu_packets=sample.imu_packets,
        imu_errors=sample.imu_errors,
        imu_alive=int(sample.imu_alive),
        latitude_e7=saturated((sample.gps_latitude_deg or 0.0) * 1e7, I32_MIN, I32_MAX),
        longitude_e7=saturated((sample.gps_longitude_deg or 0.0) * 1e7, I32_MIN, I32_MAX),
        altitude_dm=saturated((sample.gps_altitude_m or 0.0) * 10, I16_MIN, I16_MAX),
        satellites=sample.gps_satellites,
        gps_alive=int(sample.gps_alive),
        conductivity_dus=saturated(conductivity_dus, 0, U16_MAX),
        ec_salinity_cpsu=saturated(_scaled(sample.ec_salinity_psu, 100), 0, U16_MAX),
        ec_alive=int(sample.ec_alive),
        extension=EXTENSION_FULL_RANGE,
        full_conductivity_dus=_full_range(conductivity_dus),
        full_pressure_pa=_full_range(pressure_pa),
        pressure_dmbar=saturated(pressure_pa / 10, 0, U16_MAX),
        depth_temperature_cdegc=saturated((sample.depth_sensor_temperature_degc or 0.0) * 100, I16_MIN, I16_MAX),
        depth_ok=int(sample.depth_ok),
        temperature_cdegc=saturated((sample.temperature_degc or 0.0) * 100, I16_MIN, I16_MAX),
        temperature_ok=int(sample.temperature_ok),
        sound_speed_dmps=saturated(_scaled(sample.sound_speed_wire_mps, 10), 0, U16_MAX),
        depth_cm=saturated(_scaled(sample.depth_wire_m, 100), 0, U16_MAX),
        salinity_dpsu=saturated(_scaled(sample.salinity_wire_psu, 10), 0, U8_MAX),
        a_packets=sample.a_packets,
        a_bytes=sample.a_bytes,
        b_packets=sample.b_packets,
        b_bytes=sample.b_bytes,
    )


def _imu_counts(fields: SensorFields) -> tuple[int, ...]:
    """All zero is what a dead IMU leaves behind: gravity alone would show otherwise."""
    return (
        fields.roll_cdeg,
        fields.pitch_cdeg,
        fields.yaw_cdeg,
        fields.acceleration_x_mg,
        fields.acceleration_y_mg,
        fields.acceleration_z_mg,
    )


def _acceleration(fields: SensorFields) -> tuple[float, float, float]:
    return (
        fields.acceleration_x_mg / 1000 * STANDARD_GRAVITY_MPS2,
        fields.acceleration_y_mg / 1000 * STANDARD_GRAVITY_MPS2,
        fields.acceleration_z_mg / 1000 * STANDARD_GRAVITY_MPS2,
    )


def _conductivity_dus(fields: SensorFields) -> int | None:
    """In 0.1 uS/cm."""
    if not fields.ec_alive:
        return None
    if fields.extension == EXTENSION_FULL_RANGE:
        return fields.full_conductivity_dus if fields.full_conductivity_dus < U24_MAX else None
    return fields.conductivity_dus if fields.conductivity_dus < U16_MAX else None


def _pressure_pa(fields: SensorFields) -> float | None:
    """Absolute pressure; zero would be a vacuum, so it is what an unread sensor leaves behind."""
    if not fields.depth_ok:
        return None
    if fields.extension == EXTENSION_FULL_RANGE:
        return float(fields.full_pressure_pa) if 0 < fields.full_pressure_pa < U24_MAX else None
    return fields.pressure_dmbar * 10.0 if 0 < fields.pressure_dmbar < U16_MAX else None


def _wire_salinity_psu(fields: SensorFields) -> float | None:
    """`svp_sal`; a legacy sender wraps it at 25.6 PSU, which the probe's own salinity gives away."""
    if fields.salinity_dpsu == U8_MAX:
        return None
    salinity_psu = fields.salinity_dpsu / 10
    if fields.extension == EXTENSION_FULL_RANGE:
        return salinity_psu
    agrees = abs(salinity_psu - fields.ec_salinity_cpsu / 100) <= LEGACY_SALINITY_TOLERANCE_PSU
    return salinity_psu if fields.ec_alive and agrees else None


def _scaled(value: float | None, counts_per_unit: float) -> float:
    """Counts of a field whose largest value means unavailable."""
    return math.inf if value is None else value * counts_per_unit


def _full_range(counts: float) -> int:
    return U24_MAX if math.isinf(counts) else saturated(counts, 0, U24_MAX - 1)


def _angle_cdeg(angle_rad: float | None) -> int:
    return 0 if angle_rad is None else saturated(math.degrees(angle_rad) * 100, I16_MIN, I16_MAX)
