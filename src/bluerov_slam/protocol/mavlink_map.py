"""Records <-> fields of MAVLink messages, pure: nothing here knows a socket or pymavlink.

A function that finds its record incomplete returns None: nothing invalid is ever sent. Field names, units and
special values are those of the MAVLink common and ardupilotmega definitions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from bluerov_slam.records import (
    CtdSample,
    FixType,
    GpsFix,
    SensorSample,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleRange,
    VehicleRecord,
    VehicleServoOutput,
)

Fields = dict[str, Any]

UINT16_UNKNOWN = 0xFFFF
UINT32_RANGE = 1 << 32
MAX_NAME_CHARACTERS = 10
STATUSTEXT_CHARACTERS = 50
NAN = float("nan")
# BATTERY_STATUS reports up to ten cells; ArduSub puts the whole pack into the first one.
CELL_UNUSED_MV = 0xFFFF
# MAV_SENSOR_ROTATION_PITCH_270: the sensor looks at the bottom.
ORIENTATION_DOWN = 25


def attitude_fields(sample: SensorSample, angular_rate_frd_radps: tuple[float, float, float] | None) -> Fields | None:
    """ATTITUDE (30) from the sensor's own angles, None while the IMU is silent. Unknown rates are NaN, not zero."""
    if not sample.imu_alive or sample.roll_rad is None or sample.pitch_rad is None or sample.yaw_rad is None:
        return None
    roll_rate, pitch_rate, yaw_rate = angular_rate_frd_radps or (NAN, NAN, NAN)
    return {
        "time_boot_ms": sample.device_ms % UINT32_RANGE,
        "roll": _wrap_pi(sample.roll_rad),
        "pitch": _wrap_pi(sample.pitch_rad),
        "yaw": _wrap_pi(sample.yaw_rad),
        "rollspeed": roll_rate,
        "pitchspeed": pitch_rate,
        "yawspeed": yaw_rate,
    }


def scaled_pressure_fields(sample: SensorSample) -> Fields | None:
    """SCALED_PRESSURE (29): absolute pressure in hPa; temperature of the CTD's thermometer, else the depth sensor's.

    None without a pressure or a temperature: the message has no value for "unknown".
    """
    temperature_degc = sample.temperature_degc
    if temperature_degc is None:
        temperature_degc = sample.depth_sensor_temperature_degc
    if sample.pressure_pa is None or temperature_degc is None:
        return None
    return {
        "time_boot_ms": sample.device_ms % UINT32_RANGE,
        "press_abs": sample.pressure_pa / 100.0,
        "press_diff": 0.0,
        "temperature": round(temperature_degc * 100.0),
        "temperature_press_diff": 0,
    }


def gps_raw_int_fields(fix: GpsFix) -> Fields | None:
    """GPS_RAW_INT (24) from a GPS frame, None without a fix: "no fix" is shown by silence, never by a position."""
    if fix.fix is FixType.NONE or fix.latitude_deg is None or fix.longitude_deg is None:
        return None
    return _gps_fields(
        time_us=int(fix.utc_unix_s * 1e6) if fix.utc_unix_s is not None else int(fix.measured_s * 1e6),
        fix_type=int(fix.fix),
        position_deg=(fix.latitude_deg, fix.longitude_deg),
        altitude_m=fix.altitude_m,
        hdop=fix.hdop,
        speed_mps=fix.speed_mps,
        course_rad=fix.course_rad,
        satellites=fix.satellites,
    )


def gps_raw_int_fields_of_sample(sample: SensorSample) -> Fields | None:
    """GPS_RAW_INT from SENSORS, for firmware that sends no GPS frame: 2D, because nothing says more."""
    if not sample.gps_alive or sample.gps_latitude_deg is None or sample.gps_longitude_deg is None:
        return None
    return _gps_fields(
        time_us=int(sample.measured_s * 1e6),
        fix_type=int(FixType.FIX_2D),
        position_deg=(sample.gps_latitude_deg, sample.gps_longitude_deg),
        altitude_m=sample.gps_altitude_m,
        hdop=None,
        speed_mps=None,
        course_rad=None,
        satellites=sample.gps_satellites,
    )


def named_values(ctd: CtdSample) -> tuple[tuple[str, float], ...]:
    """NAMED_VALUE_FLOAT names (at most ten characters) and values of what the water is like; unknown ones left out."""
    candidates = (
        ("WaterTemp", ctd.temperature_degc),
        ("SoundSpd", ctd.sound_speed_mps),
        ("Salinity", ctd.salinity_psu),
        ("CtdDepth", ctd.depth_m),
    )
    return tuple((name, value) for name, value in candidates if value is not None and math.isfinite(value))


def status_text_chunks(text: str) -> tuple[str, ...]:
    """`text` cut for STATUSTEXT: pieces of at most 50 characters, plain ASCII."""
    plain = text.encode("ascii", "replace").decode("ascii")
    return tuple(plain[i : i + STATUSTEXT_CHARACTERS] for i in range(0, len(plain), STATUSTEXT_CHARACTERS)) or ("",)


def vehicle_record(name: str, fields: Mapping[str, Any], arrived_s: float) -> VehicleRecord | None:
    """The record of a message from the vehicle, None for a message we do not use or whose values make no sense."""
    reader = _READERS.get(name)
    if reader is None:
        return None
    try:
        return reader(fields, arrived_s)
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _attitude(fields: Mapping[str, Any], arrived_s: float) -> VehicleAttitude | None:
    angles = tuple(float(fields[key]) for key in ("roll", "pitch", "yaw"))
    rates = tuple(float(fields[key]) for key in ("rollspeed", "pitchspeed", "yawspeed"))
    if not all(map(math.isfinite, angles + rates)):
        return None
    return VehicleAttitude(
        arrived_s, int(fields["time_boot_ms"]), angles[0], angles[1], angles[2], (rates[0], rates[1], rates[2])
    )


def _servo_output(fields: Mapping[str, Any], arrived_s: float) -> VehicleServoOutput:
    # Port 1 carries outputs 17 and up: no thruster of a BlueROV2 is there, but the numbering must not be mixed up.
    if int(fields.get("port", 0)) != 0:
        raise ValueError("not the main outputs")
    pwm_us = tuple(int(fields.get(f"servo{i}_raw", 0)) for i in range(1, 17))
    return VehicleServoOutput(arrived_s, int(fields["time_usec"]), pwm_us)


def _battery(fields: Mapping[str, Any], arrived_s: float) -> VehicleBattery:
    cells_mv = [int(v) for v in fields["voltages"] if int(v) != CELL_UNUSED_MV]
    cells_mv += [int(v) for v in fields.get("voltages_ext", ()) if int(v) not in (0, CELL_UNUSED_MV)]
    current_ca = int(fields["current_battery"])
    remaining = int(fields["battery_remaining"])
    return VehicleBattery(
        arrived_s,
        voltage_v=sum(cells_mv) / 1000.0 if cells_mv else None,
        current_a=current_ca / 100.0 if current_ca >= 0 else None,
        remaining_percent=remaining if 0 <= remaining <= 100 else None,
    )


def _motion_delta(fields: Mapping[str, Any], arrived_s: float) -> VehicleMotionDelta | None:
    angle = tuple(float(v) for v in fields["angle_delta"])
    position = tuple(float(v) for v in fields["position_delta"])
    interval_s = int(fields["time_delta_usec"]) * 1e-6
    confidence = float(fields["confidence"])
    if not all(map(math.isfinite, (*angle, *position, confidence))) or interval_s <= 0.0:
        return None
    return VehicleMotionDelta(
        arrived_s,
        int(fields["time_usec"]),
        interval_s,
        (angle[0], angle[1], angle[2]),
        (position[0], position[1], position[2]),
        confidence,
    )


def _depth(fields: Mapping[str, Any], arrived_s: float) -> VehicleDepth | None:
    pressure_pa = float(fields["press_abs"]) * 100.0
    if not math.isfinite(pressure_pa) or pressure_pa <= 0.0:
        return None
    # Exactly zero is what a driver without a thermometer sends.
    temperature_cdegc = int(fields["temperature"])
    temperature_degc = temperature_cdegc / 100.0 if temperature_cdegc else None
    return VehicleDepth(arrived_s, int(fields["time_boot_ms"]), pressure_pa, None, temperature_degc)


def _range(fields: Mapping[str, Any], arrived_s: float) -> VehicleRange | None:
    distance_cm = int(fields["current_distance"])
    within = int(fields["min_distance"]) <= distance_cm <= int(fields["max_distance"])
    if int(fields["orientation"]) != ORIENTATION_DOWN or not within or distance_cm <= 0:
        return None
    # 0 is "unknown", 1 is 0 %: the message's own convention.
    quality = int(fields.get("signal_quality", 0))
    percent = None if quality == 0 else 0 if quality == 1 else min(quality, 100)
    return VehicleRange(arrived_s, int(fields["time_boot_ms"]), distance_cm / 100.0, percent)


_READERS = {
    "ATTITUDE": _attitude,
    "SERVO_OUTPUT_RAW": _servo_output,
    "BATTERY_STATUS": _battery,
    "VISION_POSITION_DELTA": _motion_delta,
    "SCALED_PRESSURE2": _depth,
    "DISTANCE_SENSOR": _range,
}


def _gps_fields(
    *,
    time_us: int,
    fix_type: int,
    position_deg: tuple[float, float],
    altitude_m: float | None,
    hdop: float | None,
    speed_mps: float | None,
    course_rad: float | None,
    satellites: int,
) -> Fields | None:
    latitude_deg, longitude_deg = position_deg
    if (latitude_deg == 0.0 and longitude_deg == 0.0) or abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
        return None
    return {
        "time_usec": time_us,
        "fix_type": fix_type,
        "lat": round(latitude_deg * 1e7),
        "lon": round(longitude_deg * 1e7),
        # The message has no "unknown" for altitude: a 2D fix says that it must not be used.
        "alt": round(altitude_m * 1000.0) if altitude_m is not None else 0,
        "eph": _u16(hdop, 100.0),
        "epv": UINT16_UNKNOWN,
        "vel": _u16(speed_mps, 100.0),
        "cog": _u16(math.degrees(course_rad) % 360.0 if course_rad is not None else None, 100.0),
        "satellites_visible": min(satellites, 254),
    }


def _u16(value: float | None, scale: float) -> int:
    return UINT16_UNKNOWN if value is None else max(0, min(UINT16_UNKNOWN - 1, round(value * scale)))


def _wrap_pi(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)
