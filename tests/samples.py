"""Records with plausible values, for tests that need one and care about a few fields only."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bluerov_slam.records import CtdSample, FixType, GpsFix, Sender, SensorSample

_SENSORS = SensorSample(
    measured_s=100.0,
    arrived_s=100.01,
    device_ms=12345,
    sender=Sender.FULL_RANGE,
    roll_rad=0.1,
    pitch_rad=-0.2,
    yaw_rad=1.5,
    acceleration_frd_mps2=(0.1, 0.0, -9.8),
    imu_packets=1000,
    imu_errors=0,
    imu_alive=True,
    gps_latitude_deg=47.6123,
    gps_longitude_deg=-2.7456,
    gps_altitude_m=5.0,
    gps_satellites=8,
    gps_alive=True,
    conductivity_s_per_m=4.2,
    ec_salinity_psu=35.0,
    ec_alive=True,
    pressure_pa=150000.0,
    depth_sensor_temperature_degc=15.2,
    depth_ok=True,
    temperature_degc=15.18,
    temperature_ok=True,
    sound_speed_wire_mps=1507.9,
    depth_wire_m=4.8,
    salinity_wire_psu=35.0,
    a_packets=420,
    a_bytes=28000,
    b_packets=380,
    b_bytes=32000,
)
_CTD = CtdSample(
    measured_s=100.0,
    arrived_s=100.01,
    temperature_degc=15.18,
    conductivity_s_per_m=4.2,
    pressure_pa=150000.0,
    depth_m=4.8,
    salinity_psu=34.9,
    sound_speed_mps=1507.9,
    surface_pressure_pa=101325.0,
)
_GPS = GpsFix(
    measured_s=100.0,
    arrived_s=100.01,
    fix=FixType.FIX_3D,
    satellites=9,
    hdop=0.9,
    latitude_deg=47.6123,
    longitude_deg=-2.7456,
    altitude_m=5.0,
    speed_mps=0.5,
    course_rad=1.0,
    utc_unix_s=1.7e9,
)


def sensor_sample(**changes: Any) -> SensorSample:
    """One SENSORS record with these fields changed."""
    return replace(_SENSORS, **changes)


def ctd_sample(**changes: Any) -> CtdSample:
    """One CTD record with these fields changed."""
    return replace(_CTD, **changes)


def gps_fix(**changes: Any) -> GpsFix:
    """One GPS record with these fields changed."""
    return replace(_GPS, **changes)
