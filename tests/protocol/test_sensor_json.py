import json
from pathlib import Path
from typing import Any

import pytest

from bluerov_slam.protocol.sensor_frame import SensorFields, sensor_sample
from bluerov_slam.protocol.sensor_json import sensor_json
from bluerov_slam.records import CtdSample

VECTORS = json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())
SENSORS = {message["name"]: message["fields"] for message in VECTORS["messages"] if message["type"] == 1}

# The example of the original description: its keys, nesting and order are the contract.
EXAMPLE: dict[str, Any] = {
    "ts": 12345,
    "imu": {"r": 1.5, "p": -2.3, "y": 180.0, "ax": 1.0, "ay": 0.0, "az": 0.0, "alive": True},
    "gps": {"lat": 47.6123, "lon": -2.7456, "alt": 5.0, "sat": 8, "alive": True},
    "ec": {"conductivity": 42000.0, "salinity": 35.5, "alive": True},
    "depth": {"press": 1013.25, "temp": 15.2, "ok": True},
    "celsius": {"temp": 15.18, "ok": True},
    "ctd": {"sv": 1485.7, "d": 0.5, "s": 35.5, "t": 15.2},
    "ka": {"pkts": 420, "bytes": 28000, "alive": True},
    "kb": {"pkts": 380, "bytes": 32000, "alive": True},
}


def made(name: str, *, ctd: CtdSample | None = None, **changes: int) -> dict[str, Any]:
    sample = sensor_sample(SensorFields(**{**SENSORS[name], **changes}), 1.0, 2.0)
    return sensor_json(sample, True, True, ctd)


def shape(value: Any) -> Any:
    return {key: shape(inner) for key, inner in value.items()} if isinstance(value, dict) else None


@pytest.mark.parametrize("name", SENSORS)
def test_keys_nesting_and_order_are_the_original_ones(name: str) -> None:
    assert json.dumps(shape(made(name))) == json.dumps(shape(EXAMPLE))


def test_the_original_example_is_reproduced() -> None:
    ctd = CtdSample(1.0, 2.0, 15.2, 4.2, 101_325.0, 0.5, 35.5, 1507.9, 101_325.0)
    result = made(
        "sensors_full_range",
        ctd=ctd,
        acceleration_z_mg=0,
        full_pressure_pa=101_325,
        sound_speed_dmps=14857,
        temperature_cdegc=1518,
    )
    # The example shows the rounded temperature again under ctd; it is one sensor with one value.
    assert result == {**EXAMPLE, "ctd": {**EXAMPLE["ctd"], "t": 15.18}}


def test_nothing_known_is_null_everywhere() -> None:
    result = made("sensors_all_unavailable")
    flags = {"alive": False, "ok": False}
    for group, empty in [("imu", ["r", "p", "y", "ax", "ay", "az"]), ("ec", ["conductivity", "salinity"])]:
        assert {key: result[group][key] for key in empty} == dict.fromkeys(empty)
        assert result[group]["alive"] is flags["alive"]
    assert result["gps"] == {"lat": None, "lon": None, "alt": None, "sat": 8, "alive": False}
    assert result["depth"] == {"press": None, "temp": None, "ok": False}
    assert result["celsius"] == {"temp": None, "ok": False}
    assert result["ctd"] == {"sv": None, "d": None, "s": None, "t": None}


def test_no_fix_is_never_a_position_in_the_gulf_of_guinea() -> None:
    assert made("sensors_no_fix")["gps"] == {"lat": None, "lon": None, "alt": None, "sat": 3, "alive": True}


@pytest.mark.parametrize(
    ("name", "group", "flag"),
    [
        ("sensors_legacy_saturated", "depth", "ok"),
        ("sensors_legacy_saturated", "ec", "alive"),
        ("sensors_extension_absent", "depth", "ok"),
        ("sensors_extension_absent", "ec", "alive"),
        ("sensors_imu_all_zero", "imu", "alive"),
    ],
)
def test_what_is_unavailable_is_not_ok(name: str, group: str, flag: str) -> None:
    assert made(name)[group][flag] is False


def test_computed_values_stand_in_for_saturated_ones_only() -> None:
    ctd = CtdSample(1.0, 2.0, 15.0, 4.2, 1e6, 91.2345, 35.4321, 1509.87, 101_325.0)
    saturated = made("sensors_full_range", ctd=ctd, sound_speed_dmps=65535, depth_cm=65535)
    assert saturated["ctd"] == {"sv": 1509.9, "d": 91.23, "s": 35.4, "t": 15.18}
    assert made("sensors_full_range", ctd=ctd)["ctd"] == {"sv": 1507.9, "d": 0.5, "s": 35.4, "t": 15.18}


def test_alive_of_the_sonars_is_what_the_caller_found() -> None:
    sample = sensor_sample(SensorFields(**SENSORS["sensors_full_range"]), 1.0, 2.0)
    result = sensor_json(sample, True, False)
    assert result["ka"] == {"pkts": 420, "bytes": 28000, "alive": True}
    assert result["kb"] == {"pkts": 380, "bytes": 32000, "alive": False}


@pytest.mark.parametrize("name", SENSORS)
def test_it_is_valid_json(name: str) -> None:
    result = made(name)
    assert json.loads(json.dumps(result, allow_nan=False)) == result
