import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.protocol.fixed_point import round_half_away, saturated
from bluerov_slam.protocol.sensor_frame import SensorFields, pack_sensors, sensor_fields, sensor_sample, unpack_sensors
from bluerov_slam.records import Sender, SensorSample

VECTORS = json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())
SENSORS = {message["name"]: message for message in VECTORS["messages"] if message["type"] == 1}


def fields_of(name: str, **changes: int) -> SensorFields:
    return SensorFields(**{**SENSORS[name]["fields"], **changes})


def sample_of(name: str, **changes: int) -> SensorSample:
    return sensor_sample(fields_of(name, **changes), 1.0, 2.0)


def in_vector_units(sample: SensorSample) -> dict[str, Any]:
    def scaled(value: float | None, factor: float = 1.0) -> float | None:
        return None if value is None else value * factor

    def degrees(value: float | None) -> float | None:
        return None if value is None else math.degrees(value)

    return {
        "sender": sample.sender.name.lower(),
        "conductivity_us": scaled(sample.conductivity_s_per_m, 1e4),
        "pressure_mbar": scaled(sample.pressure_pa, 1e-2),
        "temperature_degc": sample.temperature_degc,
        "depth_temperature_degc": sample.depth_sensor_temperature_degc,
        "roll_deg": degrees(sample.roll_rad),
        "pitch_deg": degrees(sample.pitch_rad),
        "yaw_deg": degrees(sample.yaw_rad),
        "latitude_deg": sample.gps_latitude_deg,
        "longitude_deg": sample.gps_longitude_deg,
        "altitude_m": sample.gps_altitude_m,
        "ec_salinity_psu": sample.ec_salinity_psu,
        "sound_speed_mps": sample.sound_speed_wire_mps,
        "depth_m": sample.depth_wire_m,
        "salinity_psu": sample.salinity_wire_psu,
    }


@pytest.mark.parametrize("name", SENSORS)
def test_golden_frames_both_ways(name: str) -> None:
    payload = bytes.fromhex(SENSORS[name]["frame"])[5:-1]
    assert unpack_sensors(payload) == fields_of(name)
    assert pack_sensors(fields_of(name)) == payload


@pytest.mark.parametrize("name", SENSORS)
def test_golden_records(name: str) -> None:
    expected = SENSORS[name]["record"]
    for key, value in in_vector_units(sample_of(name)).items():
        assert value == (pytest.approx(expected[key], abs=1e-9) if isinstance(expected[key], float) else expected[key])


@given(st.binary(min_size=76, max_size=76))
def test_any_76_bytes_survive_the_round_trip(payload: bytes) -> None:
    fields = unpack_sensors(payload)
    assert fields is not None
    assert pack_sensors(fields) == payload
    sensor_sample(fields, 0.0, 0.0)


@pytest.mark.parametrize("length", [0, 75, 77])
def test_any_other_length_is_refused(length: int) -> None:
    assert unpack_sensors(bytes(length)) is None


@pytest.mark.parametrize("name", [name for name in SENSORS if SENSORS[name]["fields"]["extension"] == 1])
def test_our_own_sender_reproduces_full_range_frames(name: str) -> None:
    sample = sample_of(name)
    again = sensor_sample(sensor_fields(sample), 1.0, 2.0)
    assert again == sample


def full_range(**changes: Any) -> SensorSample:
    return dataclasses.replace(sample_of("sensors_full_range"), **changes)


def test_short_fields_saturate_instead_of_wrapping() -> None:
    fields = sensor_fields(
        full_range(conductivity_s_per_m=5.3, pressure_pa=701_325.0, salinity_wire_psu=35.5, depth_wire_m=700.0)
    )
    assert (fields.conductivity_dus, fields.full_conductivity_dus) == (65535, 530_000)
    assert (fields.pressure_dmbar, fields.full_pressure_pa) == (65535, 701_325)
    assert (fields.salinity_dpsu, fields.depth_cm) == (255, 65535)


def test_60_m_reads_as_60_m() -> None:
    pressure_pa = 101_325 + 1025 * 9.80665 * 60
    sample = sensor_sample(sensor_fields(full_range(pressure_pa=pressure_pa)), 0.0, 0.0)
    assert sample.pressure_pa == pytest.approx(pressure_pa, abs=0.5)


def test_unknown_values_are_marked_not_zero() -> None:
    unknown = full_range(
        conductivity_s_per_m=None,
        pressure_pa=None,
        sound_speed_wire_mps=None,
        depth_wire_m=None,
        salinity_wire_psu=None,
    )
    fields = sensor_fields(unknown)
    assert fields.full_conductivity_dus == fields.full_pressure_pa == 0xFFFFFF
    assert fields.conductivity_dus == fields.pressure_dmbar == fields.sound_speed_dmps == fields.depth_cm == 0xFFFF
    assert fields.salinity_dpsu == 0xFF
    assert sensor_sample(fields, 1.0, 2.0) == unknown


def test_the_extension_never_says_absent_for_a_huge_value() -> None:
    fields = sensor_fields(full_range(conductivity_s_per_m=1e6, pressure_pa=1e12))
    assert fields.full_conductivity_dus == fields.full_pressure_pa == 0xFFFFFE


@pytest.mark.parametrize(
    ("change", "record_field"),
    [
        ({"depth_ok": 0}, "pressure_pa"),
        ({"depth_ok": 0}, "depth_sensor_temperature_degc"),
        ({"depth_ok": 0}, "depth_wire_m"),
        ({"full_pressure_pa": 0}, "pressure_pa"),
        ({"temperature_ok": 0}, "temperature_degc"),
        ({"ec_alive": 0}, "conductivity_s_per_m"),
        ({"ec_alive": 0}, "ec_salinity_psu"),
        ({"imu_alive": 0}, "yaw_rad"),
        ({"imu_alive": 0}, "acceleration_frd_mps2"),
        ({"gps_alive": 0}, "gps_latitude_deg"),
        ({"latitude_e7": -900_000_001}, "gps_latitude_deg"),
        ({"longitude_e7": 1_800_000_001}, "gps_longitude_deg"),
        ({"sound_speed_dmps": 0}, "sound_speed_wire_mps"),
    ],
)
def test_a_dead_sensor_has_no_value(change: dict[str, int], record_field: str) -> None:
    assert getattr(sample_of("sensors_full_range"), record_field) is not None
    assert getattr(sample_of("sensors_full_range", **change), record_field) is None


def test_distrusted_values_are_left_out() -> None:
    fields = fields_of("sensors_legacy")
    assert sensor_sample(fields, 0, 0, conductivity_trusted=False).conductivity_s_per_m is None
    assert sensor_sample(fields, 0, 0, pressure_trusted=False).pressure_pa is None
    assert sensor_sample(fields, 0, 0).sender is Sender.LEGACY


def test_legacy_salinity_is_believed_where_the_probe_agrees() -> None:
    assert sample_of("sensors_legacy", salinity_dpsu=201, ec_salinity_cpsu=2000).salinity_wire_psu == pytest.approx(
        20.1
    )
    assert sample_of("sensors_legacy", salinity_dpsu=201, ec_salinity_cpsu=3500).salinity_wire_psu is None


@pytest.mark.parametrize(
    ("value", "expected"), [(0.5, 1), (-0.5, -1), (1.5, 2), (2.5, 3), (-2.5, -3), (0.49, 0), (0, 0)]
)
def test_halves_round_away_from_zero(value: float, expected: int) -> None:
    assert round_half_away(value) == expected


@given(st.floats(allow_nan=False), st.integers(-100, 0), st.integers(1, 100))
def test_saturated_stays_in_range_and_near_the_value(value: float, minimum: int, maximum: int) -> None:
    counts = saturated(value, minimum, maximum)
    assert minimum <= counts <= maximum
    assert abs(counts - min(max(value, minimum), maximum)) <= 0.5
