"""What the small sensors put on their wires for the values that the instruments measured.

Each sensor's own resolution applies: 16 bits of the HWT905, five decimals of NMEA minutes, four digits of the EZO EC,
24 bits of the two converters.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence

from bluerov_slam.protocol.checksums import xor8
from bluerov_slam.simulation.board_readers.ms5837 import ms5837_compute
from bluerov_slam.simulation.board_readers.tsys01 import tsys01_temperature_degc
from bluerov_slam.simulation.sensors import GpsReading, ImuReading

MS5837_PROM = (0x3A2D, 34_982, 36_352, 20_328, 22_354, 26_646, 26_146)
"""Coefficients of the datasheet's example, with a valid CRC-4 in front."""
TSYS01_PROM = (0x0000, 28_446, 24_926, 36_016, 32_791, 40_781, 0x1A2B, 0x3C74)
"""Coefficients of the datasheet's example; the last two words hold the serial number and the checksum."""
EZO_OK = b"*OK\r"
EZO_RESTARTED = b"*RS\r*RE\r"

_ADC_MAX = (1 << 24) - 1
_IMU_TEMPERATURE_DEGC = 25.0
_KNOTS_PER_MPS = 3600.0 / 1852.0
_MAX_SATELLITES_IN_GSA = 12
_UNKNOWN_DOP = 99.99
_GEOID_SEPARATION_M = 48.0
_EZO_DECIMALS = ((99.995, 2), (999.95, 1), (9_999.5, 0), (99_995.0, -1))


def witmotion_packets(reading: ImuReading) -> bytes:
    """Four packets of 11 bytes: acceleration, angular rate, angle, magnetic field."""
    temperature = round(_IMU_TEMPERATURE_DEGC * 100.0)
    roll, pitch, yaw = (_angle_raw(angle_rad) for angle_rad in reading.angles_rad)
    return (
        witmotion_packet(0x51, (*reading.acceleration, temperature))
        + witmotion_packet(0x52, (*reading.angular_rate, temperature))
        + witmotion_packet(0x53, (roll, pitch, yaw, 0))
        + witmotion_packet(0x54, (*reading.magnetic_field, temperature))
    )


def witmotion_packet(kind: int, values: Sequence[int]) -> bytes:
    """One packet of four signed 16-bit numbers."""
    packet = struct.pack("<BB4h", 0x55, kind, *values)
    return packet + bytes((sum(packet) & 0xFF,))


def nmea_second(reading: GpsReading, talker: str = "GN") -> bytes:
    """RMC, GGA and GSA of one second, in the order and with the digits of a u-blox receiver.

    Without a fix its fields are empty, without a known time those of time and date.
    """
    time, date = _utc_fields(reading.utc_unix_s)
    satellites, hdop = reading.satellites, f"{min(reading.hdop, _UNKNOWN_DOP):.2f}"
    if reading.fix == 0:
        used = "," * (_MAX_SATELLITES_IN_GSA - 1)
        return (
            nmea_sentence(f"{talker}RMC,{time},V,,,,,,,{date},,,N")
            + nmea_sentence(f"{talker}GGA,{time},,,,,0,{satellites:02d},{hdop},,,,,,")
            + nmea_sentence(f"{talker}GSA,A,1,{used},{_UNKNOWN_DOP},{hdop},{_UNKNOWN_DOP}")
        )
    position = f"{_latitude(reading.latitude_deg)},{_longitude(reading.longitude_deg)}"
    motion = f"{reading.speed_mps * _KNOTS_PER_MPS:.3f},{_course(reading.course_rad)}"
    ids = [f"{index + 1:02d}" for index in range(min(satellites, _MAX_SATELLITES_IN_GSA))]
    used = ",".join(ids + [""] * (_MAX_SATELLITES_IN_GSA - len(ids)))
    altitude = f"{reading.altitude_m:.1f},M,{_GEOID_SEPARATION_M:.1f},M"
    return (
        nmea_sentence(f"{talker}RMC,{time},A,{position},{motion},{date},,,A")
        + nmea_sentence(f"{talker}GGA,{time},{position},1,{satellites:02d},{hdop},{altitude},,")
        + nmea_sentence(f"{talker}GSA,A,{reading.fix},{used},{reading.hdop * 1.6:.2f},{hdop},{reading.hdop * 1.3:.2f}")
    )


def nmea_sentence(body: str) -> bytes:
    """A whole line around what stands between `$` and `*`."""
    return f"${body}*{xor8(body.encode()):02X}\r\n".encode()


def ezo_line(conductivity_us_per_cm: float, salinity_psu: float | None) -> bytes:
    """One reading of the EZO EC: four digits of conductivity, no more than two decimals."""
    decimals = next((d for limit, d in _EZO_DECIMALS if conductivity_us_per_cm < limit), -2)
    conductivity = f"{round(conductivity_us_per_cm, decimals):.{max(0, decimals)}f}"
    return (conductivity if salinity_psu is None else f"{conductivity},{salinity_psu:.2f}").encode() + b"\r"


def ms5837_adc(pressure_pa: float, temperature_degc: float, prom: Sequence[int] = MS5837_PROM) -> tuple[int, int]:
    """D1 and D2 for which the datasheet's computation gives these, each as the nearest 0.01 mbar and 0.01 degC."""
    wanted_cdegc, wanted_pa = round(temperature_degc * 100.0), round(pressure_pa)
    d2 = _first_at_least(lambda adc: ms5837_compute(prom, 0, adc).temperature_cdegc, wanted_cdegc)
    d1 = _first_at_least(lambda adc: ms5837_compute(prom, adc, d2).pressure_pa, wanted_pa)
    return d1, d2


def tsys01_adc(temperature_degc: float, prom: Sequence[int] = TSYS01_PROM) -> int:
    """The conversion result nearest to this temperature."""
    above = _first_at_least(lambda adc: tsys01_temperature_degc(prom, adc), temperature_degc)
    below = max(1, above - 1)
    return min((above, below), key=lambda adc: abs(tsys01_temperature_degc(prom, adc) - temperature_degc))


def _first_at_least(value: Callable[[int], float], wanted: float) -> int:
    """The smallest converter reading whose (rising) value reaches the wanted one; the end of the range if none does."""
    low, high = 1, _ADC_MAX
    while low < high:
        middle = (low + high) // 2
        if value(middle) < wanted:
            low = middle + 1
        else:
            high = middle
    return low


def _angle_raw(angle_rad: float) -> int:
    raw = round(angle_rad / math.pi * 32_768.0)
    return (raw + 32_768) % 65_536 - 32_768


def _latitude(latitude_deg: float) -> str:
    return f"{_degrees_minutes(latitude_deg, 2)},{'N' if latitude_deg >= 0.0 else 'S'}"


def _longitude(longitude_deg: float) -> str:
    return f"{_degrees_minutes(longitude_deg, 3)},{'E' if longitude_deg >= 0.0 else 'W'}"


def _degrees_minutes(angle_deg: float, degree_digits: int) -> str:
    # In units of the last digit first, so that 59.999999 minutes become a degree and never "60.00000".
    degrees, minutes_e5 = divmod(round(abs(angle_deg) * 6_000_000.0), 6_000_000)
    return f"{degrees:0{degree_digits}d}{minutes_e5 // 100_000:02d}.{minutes_e5 % 100_000:05d}"


def _course(course_rad: float) -> str:
    hundredths = round(math.degrees(course_rad) * 100.0) % 36_000
    return f"{hundredths // 100}.{hundredths % 100:02d}"


def _utc_fields(utc_unix_s: float | None) -> tuple[str, str]:
    """hhmmss.ss and ddmmyy."""
    if utc_unix_s is None:
        return "", ""
    days, of_day_cs = divmod(round(utc_unix_s * 100.0), 8_640_000)
    minutes, seconds_cs = divmod(of_day_cs, 6_000)
    time = f"{minutes // 60:02d}{minutes % 60:02d}{seconds_cs // 100:02d}.{seconds_cs % 100:02d}"
    # Days since 1 March 2000 in four-year cycles, whose leap day comes last; good for this century.
    cycle, of_cycle = divmod(days - 11_017, 1_461)
    year_of_cycle = min(of_cycle // 365, 3)
    of_year = of_cycle - 365 * year_of_cycle
    march_month = (5 * of_year + 2) // 153
    day = of_year - (153 * march_month + 2) // 5 + 1
    month = march_month + 3 if march_month < 10 else march_month - 9
    year = 4 * cycle + year_of_cycle + (1 if march_month >= 10 else 0)
    return time, f"{day:02d}{month:02d}{year % 100:02d}"
