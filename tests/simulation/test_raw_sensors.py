"""Raw bytes of the small sensors, through the reference readers, give back what was measured."""

import math
from calendar import timegm

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.protocol.esp32_messages import GpsFields
from bluerov_slam.simulation.board_readers.ezo_ec import EzoEcReader
from bluerov_slam.simulation.board_readers.ms5837 import ms5837_compute, ms5837_prom_ok
from bluerov_slam.simulation.board_readers.nmea import NmeaReader
from bluerov_slam.simulation.board_readers.readings import ImuSample, unknown_fields
from bluerov_slam.simulation.board_readers.tsys01 import tsys01_prom_ok, tsys01_temperature_degc
from bluerov_slam.simulation.board_readers.witmotion import WitMotionReader
from bluerov_slam.simulation.raw_sensors import (
    EZO_OK,
    MS5837_PROM,
    TSYS01_PROM,
    ezo_line,
    ms5837_adc,
    nmea_second,
    tsys01_adc,
    witmotion_packets,
)
from bluerov_slam.simulation.sensors import GpsReading, ImuReading

RATE_MHZ = 20_000
counts = st.tuples(*[st.integers(-32_768, 32_767)] * 3)


class Reports:
    def __init__(self) -> None:
        self.bursts: list[tuple[int, int, list[ImuSample]]] = []
        self.gps: list[GpsFields] = []

    def imu_burst(self, t0_us: int, dt_us: int, samples: list[ImuSample]) -> None:
        self.bursts.append((t0_us, dt_us, list(samples)))

    def gps_report(self, report: GpsFields) -> None:
        self.gps.append(report)


def gps_reports(*readings: GpsReading, talker: str = "GN") -> list[GpsFields]:
    reader, reports = NmeaReader(), Reports()
    for second, reading in enumerate(readings):
        reader.feed(nmea_second(reading, talker), 1_000_000 * (second + 1), reports)
    assert reader.errors == 0
    return reports.gps


def fix(**changes: object) -> GpsReading:
    known = {
        "fix": 3,
        "satellites": 9,
        "hdop": 1.24,
        "latitude_deg": 60.1,
        "longitude_deg": 24.9,
        "altitude_m": 47.0,
        "speed_mps": 0.5,
        "course_rad": 1.0,
        "utc_unix_s": 1_751_500_000.0,
    }
    return GpsReading(**(known | changes))


@given(counts, counts, counts, st.tuples(*[st.floats(-math.pi, math.pi)] * 3))
def test_the_imu_gives_its_counts_back(
    acceleration: tuple[int, int, int],
    angular_rate: tuple[int, int, int],
    magnetic_field: tuple[int, int, int],
    angles_rad: tuple[float, float, float],
) -> None:
    reading = ImuReading(acceleration, angular_rate, magnetic_field, angles_rad)
    packets = witmotion_packets(reading)
    reader, reports = WitMotionReader(), Reports()
    reader.feed(packets + packets, 1_000_000, RATE_MHZ, reports)
    reader.feed(packets, 1_100_000, RATE_MHZ, reports)
    sample = reports.bursts[0][2][0]
    assert (sample.acceleration, sample.angular_rate, sample.magnetic_field) == (
        acceleration,
        angular_rate,
        magnetic_field,
    )
    fields = unknown_fields()
    reader.fill(fields, 1_100_000)
    for name, angle_rad in zip(("roll", "pitch", "yaw"), angles_rad, strict=True):
        off_cdeg = math.remainder(fields[f"{name}_cdeg"] - math.degrees(angle_rad) * 100.0, 36_000.0)
        assert abs(off_cdeg) <= 0.5 + 0.5 * 18_000 / 32_768 + 1e-6
    for axis, count in zip("xyz", acceleration, strict=True):
        assert abs(fields[f"acceleration_{axis}_mg"] - count * 16_000.0 / 32_768.0) <= 0.5


@given(
    st.floats(-90.0, 90.0),
    st.floats(-180.0, 180.0),
    st.floats(-400.0, 9_000.0),
    st.floats(0.0, 300.0),
    st.floats(0.0, 2.0 * math.pi),
    st.integers(4, 30),
    st.floats(0.5, 99.0),
    st.sampled_from(["GN", "GP"]),
)
def test_a_fix_comes_back_as_exactly_as_nmea_can_say_it(
    latitude_deg: float,
    longitude_deg: float,
    altitude_m: float,
    speed_mps: float,
    course_rad: float,
    satellites: int,
    hdop: float,
    talker: str,
) -> None:
    reading = fix(
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_m=altitude_m,
        speed_mps=speed_mps,
        course_rad=course_rad,
        satellites=satellites,
        hdop=hdop,
    )
    (report,) = gps_reports(reading, talker=talker)
    assert report.fix == 3
    half_digit_of_a_minute_e7 = 0.5e-5 / 60.0 * 1e7
    assert abs(report.latitude_e7 - latitude_deg * 1e7) <= 0.5 + half_digit_of_a_minute_e7 + 1e-6
    assert abs(report.longitude_e7 - longitude_deg * 1e7) <= 0.5 + half_digit_of_a_minute_e7 + 1e-6
    assert abs(report.altitude_mm - altitude_m * 1000.0) <= 50.0 + 1e-6
    assert abs(report.speed_cmps - speed_mps * 100.0) <= 0.5 + 0.5e-3 * 51.4445
    assert abs(math.remainder(report.course_cdeg - math.degrees(course_rad) * 100.0, 36_000.0)) <= 0.5 + 1e-6
    assert report.satellites == satellites
    assert abs(report.hdop_x100 - hdop * 100.0) <= 0.5 + 1e-6


def test_the_fix_type_follows_from_the_gsa_of_the_second_before() -> None:
    assert [report.fix for report in gps_reports(fix(fix=2), fix(fix=2), fix(fix=2))] == [3, 2, 2]


def test_no_fix_is_empty_and_a_known_time_is_still_told() -> None:
    nothing = GpsReading(0, 2, 99.99, 0.0, 0.0, 0.0, 0.0, 0.0, None)
    timed = GpsReading(0, 2, 99.99, 0.0, 0.0, 0.0, 0.0, 0.0, 1_751_500_000.0)
    assert b"RMC,,V,,,,,,,,,,N*" in nmea_second(nothing)
    assert b"GGA,,,,,,0,02,99.99,,,,,,*" in nmea_second(nothing)
    first, second = gps_reports(nothing, timed)
    assert (first.fix, first.utc_ms, first.satellites, first.hdop_x100) == (0, 0, 2, 9999)
    assert (second.fix, second.utc_ms) == (0, 1_751_500_000_000)
    assert (second.latitude_e7, second.longitude_e7, second.altitude_mm) == (0, 0, 0)


@given(st.integers(timegm((2000, 1, 1, 0, 0, 0)) * 100, timegm((2100, 1, 1, 0, 0, 0)) * 100 - 1))
def test_time_comes_back_to_the_hundredth_of_a_second(utc_cs: int) -> None:
    (report,) = gps_reports(fix(utc_unix_s=utc_cs / 100.0))
    assert report.utc_ms == utc_cs * 10


@pytest.mark.parametrize(
    ("conductivity_us", "salinity_psu", "line"),
    [
        (53_123.4, 34.567, b"53120,34.57\r"),
        (9_999.4, 5.6, b"9999,5.60\r"),
        (9_999.6, 5.6, b"10000,5.60\r"),
        (123.44, 0.06, b"123.4,0.06\r"),
        (7.126, None, b"7.13\r"),
        (0.0, 0.0, b"0.00,0.00\r"),
        (123_456.0, 42.0, b"123500,42.00\r"),
    ],
)
def test_the_probe_speaks_with_four_digits(conductivity_us: float, salinity_psu: float | None, line: bytes) -> None:
    assert ezo_line(conductivity_us, salinity_psu) == line


@given(st.floats(0.0, 500_000.0), st.floats(0.0, 42.0))
def test_a_reading_of_the_probe_comes_back(conductivity_us: float, salinity_psu: float) -> None:
    reader = EzoEcReader()
    reader.feed(EZO_OK, 1_000_000)
    reader.feed(ezo_line(conductivity_us, salinity_psu), 2_000_000)
    fields = unknown_fields()
    reader.fill(fields, 2_000_000)
    half_digit_us = max(0.005, 0.5 * 10.0 ** (math.floor(math.log10(max(conductivity_us, 1.0))) - 3))
    assert abs(fields["full_conductivity_dus"] - conductivity_us * 10.0) <= 0.5 + 10.0 * half_digit_us * (1.0 + 1e-6)
    assert abs(fields["ec_salinity_cpsu"] - salinity_psu * 100.0) <= 0.5 + 1e-6


def test_the_proms_pass_their_checks() -> None:
    assert ms5837_prom_ok(MS5837_PROM)
    assert tsys01_prom_ok(TSYS01_PROM)


@given(st.floats(1_000.0, 3_200_000.0), st.floats(-20.0, 85.0))
def test_the_depth_sensors_converter_gives_back_pressure_and_temperature(
    pressure_pa: float, temperature_degc: float
) -> None:
    result = ms5837_compute(MS5837_PROM, *ms5837_adc(pressure_pa, temperature_degc))
    assert abs(result.pressure_pa - pressure_pa) <= 0.5
    assert abs(result.temperature_cdegc - temperature_degc * 100.0) <= 0.5 + 1e-9


@given(st.floats(-40.0, 125.0))
def test_the_thermometers_converter_gives_back_the_temperature(temperature_degc: float) -> None:
    adc = tsys01_adc(temperature_degc)
    off_degc = abs(tsys01_temperature_degc(TSYS01_PROM, adc) - temperature_degc)
    step_degc = tsys01_temperature_degc(TSYS01_PROM, adc + 1) - tsys01_temperature_degc(TSYS01_PROM, adc)
    assert off_degc <= 0.51 * step_degc
    assert step_degc < 1e-4


def test_converter_readings_stay_in_their_24_bits() -> None:
    for pressure_pa, temperature_degc in np.random.default_rng(1).uniform((-1e7, -500.0), (1e8, 900.0), (200, 2)):
        d1, d2 = ms5837_adc(pressure_pa, temperature_degc)
        assert 1 <= d1 < 1 << 24
        assert 1 <= d2 < 1 << 24
        assert 1 <= tsys01_adc(temperature_degc) < 1 << 24
