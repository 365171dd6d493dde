import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bluerov_slam.protocol.esp32_messages import (
    GpsFields,
    StatusFields,
    unpack_imu_burst,
)
from bluerov_slam.protocol.esp32_records import device_status, gps_fields, gps_fix, imu_burst, imu_burst_fields
from bluerov_slam.records import FixType, GpsFix

VECTORS = json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())
MESSAGES = {message["name"]: message for message in VECTORS["messages"]}


def fix_of(name: str, **changes: int) -> GpsFix:
    return gps_fix(GpsFields(**{**MESSAGES[name]["fields"], **changes}), 1.0, 2.0)


def test_a_3d_fix_in_si_units() -> None:
    fix = fix_of("gps_3d")
    assert dataclasses.asdict(fix) == pytest.approx(
        {
            "measured_s": 1.0,
            "arrived_s": 2.0,
            "fix": FixType.FIX_3D,
            "satellites": 11,
            "hdop": 0.92,
            "latitude_deg": 47.6123,
            "longitude_deg": -2.7456,
            "altitude_m": -1.25,
            "speed_mps": 1.51,
            "course_rad": math.radians(359.99),
            "utc_unix_s": 1790000000.123,
        }
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"fix": 0},
        {"fix": 1},
        {"fix": 77},
        {"latitude_e7": 0, "longitude_e7": 0},
        {"latitude_e7": 900_000_001},
        {"longitude_e7": -1_800_000_001},
    ],
)
def test_without_a_fix_there_is_no_position(changes: dict[str, int]) -> None:
    fix = fix_of("gps_3d", **changes)
    assert (
        fix.latitude_deg is fix.longitude_deg is fix.altitude_m is fix.speed_mps is fix.course_rad is fix.hdop is None
    )
    assert fix.utc_unix_s is not None


@pytest.mark.parametrize(
    ("changes", "unknown"),
    [
        ({"fix": 2}, "altitude_m"),
        ({"utc_ms": 0}, "utc_unix_s"),
        ({"hdop_x100": 0xFFFF}, "hdop"),
        ({"hdop_x100": 0}, "hdop"),
        ({"speed_cmps": 0xFFFF}, "speed_mps"),
        ({"course_cdeg": 0xFFFF}, "course_rad"),
    ],
)
def test_single_unknown_values(changes: dict[str, int], unknown: str) -> None:
    fix = fix_of("gps_3d", **changes)
    assert getattr(fix, unknown) is None
    assert fix.latitude_deg is not None


@pytest.mark.parametrize("name", ["gps_3d", "gps_no_fix"])
def test_fixes_go_back_to_the_same_wire_fields(name: str) -> None:
    assert dataclasses.asdict(gps_fields(fix_of(name), MESSAGES[name]["fields"]["t_us"])) == MESSAGES[name]["fields"]


def test_imu_counts_in_si_units() -> None:
    fields = unpack_imu_burst(bytes.fromhex(MESSAGES["imu_burst"]["frame"])[5:-1])
    assert fields is not None
    burst = imu_burst(fields, 1.0, 2.0)
    assert burst.interval_s == pytest.approx(0.05)
    assert burst.acceleration_mps2[0, 2] == pytest.approx(9.80665)  # 2048 of 32768 at 16 g
    assert burst.angular_rate_radps[0, 1] == pytest.approx(math.radians(-2000))
    assert burst.magnetic_field_raw.tolist() == [[5, -6, 7], [60, -70, 80]]
    assert burst.acceleration_mps2.shape == burst.angular_rate_radps.shape == (2, 3)


def test_imu_values_go_back_to_the_same_counts() -> None:
    fields = unpack_imu_burst(bytes.fromhex(MESSAGES["imu_burst"]["frame"])[5:-1])
    assert fields is not None
    burst = imu_burst(fields, 1.0, 2.0)
    again = imu_burst_fields(123456, 50000, burst.acceleration_mps2, burst.angular_rate_radps, burst.magnetic_field_raw)
    assert (again.t0_us, again.dt_us, again.scale) == (123456, 50000, 1)
    np.testing.assert_array_equal(again.samples, fields.samples)


def test_imu_values_beyond_the_scale_saturate() -> None:
    huge: Any = np.array([[1e9, -1e9, 0.0]])
    fields = imu_burst_fields(0, 1, huge, huge, np.zeros((1, 3), np.int16))
    assert fields.samples.tolist() == [[32767, -32768, 0, 32767, -32768, 0, 0, 0, 0]]


def test_status_keeps_every_counter() -> None:
    fields = StatusFields(**MESSAGES["status"]["fields"])
    status = device_status(fields, 1.0, 2.0)
    assert status.firmware_version == (1, 2, 3)
    for name, value in MESSAGES["status"]["fields"].items():
        if not name.startswith("firmware"):
            assert getattr(status, name) == value


def test_status_without_time_sync_has_no_echo() -> None:
    status = device_status(StatusFields(**MESSAGES["status_without_time_sync"]["fields"]), 1.0, 2.0)
    assert status.echoed_host_us is None
    assert status.echo_device_us is None
