"""Wire integers of the ESP32's messages to records in SI units and back. Times come in already mapped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.protocol.esp32_messages import GpsFields, ImuBurstFields, ImuScale
from bluerov_slam.protocol.fixed_point import (
    I32_MAX,
    I32_MIN,
    U8_MAX,
    U16_MAX,
    is_position_e7,
    saturated,
    saturated_i16,
)
from bluerov_slam.protocol.sensor_frame import STANDARD_GRAVITY_MPS2
from bluerov_slam.records import DeviceStatus, FixType, GpsFix, ImuBurst

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.protocol.esp32_messages import StatusFields

# WitMotion HWT905: full scale 16 g and 2000 deg/s over 16 signed bits.
ACCELERATION_PER_COUNT_MPS2 = 16 * STANDARD_GRAVITY_MPS2 / 32768
ANGULAR_RATE_PER_COUNT_RADPS = math.radians(2000) / 32768
_PER_COUNT = np.array([ACCELERATION_PER_COUNT_MPS2] * 3 + [ANGULAR_RATE_PER_COUNT_RADPS] * 3)

_HDOP_MAX_X100 = U16_MAX - 1


def imu_burst(fields: ImuBurstFields, measured_s: float, arrived_s: float) -> ImuBurst:
    """The record of an IMU_BURST with `ImuScale.HWT905_RAW`."""
    scaled = fields.samples[:, :6] * _PER_COUNT
    return ImuBurst(
        measured_s=measured_s,
        arrived_s=arrived_s,
        interval_s=fields.dt_us / 1e6,
        acceleration_mps2=scaled[:, :3],
        angular_rate_radps=scaled[:, 3:],
        magnetic_field_raw=fields.samples[:, 6:],
    )


def imu_burst_fields(
    t0_us: int,
    dt_us: int,
    acceleration_mps2: NDArray[np.float64],
    angular_rate_radps: NDArray[np.float64],
    magnetic_field_raw: NDArray[np.int16],
) -> ImuBurstFields:
    """Wire fields of a burst; values beyond the sensor's scale saturate. Arrays are (n, 3)."""
    samples = np.concatenate(
        (
            saturated_i16(acceleration_mps2 / ACCELERATION_PER_COUNT_MPS2),
            saturated_i16(angular_rate_radps / ANGULAR_RATE_PER_COUNT_RADPS),
            magnetic_field_raw,
        ),
        axis=1,
    )
    return ImuBurstFields(t0_us, dt_us, ImuScale.HWT905_RAW, samples)


def gps_fix(fields: GpsFields, measured_s: float, arrived_s: float) -> GpsFix:
    """The record of a GPS frame. Without a fix, at exactly 0 N 0 E or off the Earth, there is no position."""
    fix = FixType(fields.fix) if fields.fix in (FixType.FIX_2D, FixType.FIX_3D) else FixType.NONE
    known = fix is not FixType.NONE and is_position_e7(fields.latitude_e7, fields.longitude_e7)
    return GpsFix(
        measured_s=measured_s,
        arrived_s=arrived_s,
        fix=fix,
        satellites=fields.satellites,
        hdop=fields.hdop_x100 / 100 if known and 0 < fields.hdop_x100 < U16_MAX else None,
        latitude_deg=fields.latitude_e7 / 1e7 if known else None,
        longitude_deg=fields.longitude_e7 / 1e7 if known else None,
        altitude_m=fields.altitude_mm / 1000 if known and fix is FixType.FIX_3D else None,
        speed_mps=fields.speed_cmps / 100 if known and fields.speed_cmps < U16_MAX else None,
        course_rad=math.radians(fields.course_cdeg / 100) if known and fields.course_cdeg < U16_MAX else None,
        utc_unix_s=fields.utc_ms / 1000 if fields.utc_ms else None,
    )


def gps_fields(fix: GpsFix, t_us: int) -> GpsFields:
    """Wire fields of a fix: 0 for an unknown position, all ones for unknown speed, course and dilution."""
    return GpsFields(
        t_us=t_us,
        fix=fix.fix,
        satellites=saturated(fix.satellites, 0, U8_MAX),
        hdop_x100=U16_MAX if fix.hdop is None else saturated(fix.hdop * 100, 1, _HDOP_MAX_X100),
        latitude_e7=saturated((fix.latitude_deg or 0.0) * 1e7, I32_MIN, I32_MAX),
        longitude_e7=saturated((fix.longitude_deg or 0.0) * 1e7, I32_MIN, I32_MAX),
        altitude_mm=saturated((fix.altitude_m or 0.0) * 1000, I32_MIN, I32_MAX),
        speed_cmps=U16_MAX if fix.speed_mps is None else saturated(fix.speed_mps * 100, 0, U16_MAX - 1),
        course_cdeg=U16_MAX
        if fix.course_rad is None
        else saturated(math.degrees(fix.course_rad) * 100, 0, U16_MAX - 1),
        utc_ms=0 if fix.utc_unix_s is None else round(fix.utc_unix_s * 1000),
    )


def device_status(fields: StatusFields, measured_s: float, arrived_s: float) -> DeviceStatus:
    """The record of a STATUS frame."""
    echoed = fields.echoed_host_us != 0
    return DeviceStatus(
        measured_s=measured_s,
        arrived_s=arrived_s,
        layout_version=fields.layout_version,
        firmware_version=(fields.firmware_major, fields.firmware_minor, fields.firmware_patch),
        uptime_ms=fields.uptime_ms,
        boot_count=fields.boot_count,
        reset_reason=fields.reset_reason,
        link_load_percent=fields.link_load_percent,
        tx_bytes=fields.tx_bytes,
        a_pings_dropped=fields.a_pings_dropped,
        b_pings_dropped=fields.b_pings_dropped,
        a_frame_errors=fields.a_frame_errors,
        b_frame_errors=fields.b_frame_errors,
        a_overflow_bytes=fields.a_overflow_bytes,
        b_overflow_bytes=fields.b_overflow_bytes,
        i2c_errors=fields.i2c_errors,
        imu_errors=fields.imu_errors,
        gps_errors=fields.gps_errors,
        ec_errors=fields.ec_errors,
        bad_commands=fields.bad_commands,
        echoed_host_us=fields.echoed_host_us if echoed else None,
        echo_device_us=fields.echo_device_us if echoed else None,
    )
