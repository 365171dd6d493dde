"""Calibrations: applied, saved and read back."""

from __future__ import annotations

import json
import math

import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.attitude.calibration import (
    IDENTITY,
    AccelerometerCalibration,
    Calibration,
    CalibrationError,
    CompassCalibration,
    GyroCalibration,
    MagnetometerCalibration,
    Provenance,
    ThrusterFieldCalibration,
)

MADE = Provenance(residual=0.01, unit="deg/s", source="10 s at rest", samples=200, made_unix_s=1.79e9)
SQUEEZE = ((0.002, 0.0001, 0.0), (0.0001, 0.0025, -0.0002), (0.0, -0.0002, 0.003))
FULL = Calibration(
    gyro=GyroCalibration((0.01, -0.02, 0.003), (1e-4, 1e-4, 1e-4), MADE),
    accelerometer=AccelerometerCalibration(
        (0.1, 0.2, -0.3), ((1.01, 0.0, 0.0), (0.0, 0.99, 0.0), (0.0, 0.0, 1.0)), MADE
    ),
    magnetometer=MagnetometerCalibration((120.0, -80.0, 300.0), SQUEEZE, 410.0, MADE),
    thruster_field=ThrusterFieldCalibration(((0.1, 0.0, 0.02), (0.0, -0.05, 0.0)), (0.01, 0.01), MADE),
    compass=CompassCalibration(0.02, 0.05, -0.03, (0.05, 0.01, 0.01), MADE),
)
headings = st.floats(-math.pi, math.pi)


@pytest.mark.parametrize("calibration", [Calibration(), FULL, FULL.without("magnetometer")])
def test_comes_back_from_json_as_it_was(calibration: Calibration) -> None:
    assert Calibration.from_json(json.loads(json.dumps(calibration.to_json()))) == calibration
    assert Calibration.from_json(orjson.loads(orjson.dumps(calibration.to_json()))) == calibration


@pytest.mark.parametrize("damage", ["version", "part", "number", "shape", "missing", "list", "made"])
def test_refuses_what_is_no_calibration(damage: str) -> None:
    saved = json.loads(json.dumps(FULL.to_json()))
    if damage == "version":
        saved["version"] = 99
    elif damage == "part":
        saved["gyro"] = 3
    elif damage == "number":
        saved["compass"]["b_rad"] = math.nan
    elif damage == "shape":
        saved["magnetometer"]["matrix"] = [[1.0, 0.0], [0.0, 1.0]]
    elif damage == "missing":
        del saved["accelerometer"]["offset_frd_mps2"]
    elif damage == "made":
        saved["gyro"]["made"] = {"residual": 1.0}
    with pytest.raises(CalibrationError, match="calibrate anew"):
        Calibration.from_json([] if damage == "list" else saved)  # type: ignore[arg-type]


def test_is_applied_to_one_sample_and_to_many_alike() -> None:
    samples = np.random.default_rng(1).normal(size=(5, 3))
    for apply in (FULL.angular_rate, FULL.specific_force, FULL.magnetic_field):
        together = apply(samples)
        assert together == pytest.approx(np.array([apply(row) for row in samples]))
    assert FULL.angular_rate(np.array([0.01, -0.02, 0.003])) == pytest.approx(np.zeros(3))
    assert FULL.specific_force(np.array([0.1, 0.2, 0.7])) == pytest.approx([0.0, 0.0, 1.0])
    field = FULL.magnetic_field(np.array([620, -80, 300], dtype=np.int16))
    assert field == pytest.approx(500.0 * np.array(SQUEEZE)[:, 0])


def test_what_was_never_calibrated_stays_as_it_is() -> None:
    raw = np.array([1.0, 2.0, 3.0])
    for apply in (Calibration().angular_rate, Calibration().specific_force, Calibration().magnetic_field):
        assert apply(raw) == pytest.approx(raw)


def test_takes_the_thrusters_out_of_a_calibrated_field_only() -> None:
    raw = np.array([500.0, 100.0, 300.0])
    still, running = FULL.magnetic_field(raw), FULL.magnetic_field(raw, [0.5, 1.0])
    assert still - running == pytest.approx([0.05, -0.05, 0.01])
    assert FULL.without("magnetometer").magnetic_field(raw, [0.5, 1.0]) == pytest.approx(raw)
    many = FULL.magnetic_field(np.tile(raw, (3, 1)), np.array([[0.5, 1.0], [0.0, 0.0], [1.0, 0.0]]))
    assert many[0] == pytest.approx(running)
    assert many[1] == pytest.approx(still)


@given(headings, st.floats(-0.1, 0.1), st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))
def test_a_compass_reading_gives_the_true_heading(heading: float, a: float, b: float, c: float) -> None:
    compass = CompassCalibration(a, b, c, (0.0, 0.0, 0.0), MADE)
    reading = heading + compass.deviation_rad(heading)
    assert math.remainder(compass.apply(reading) - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=2e-3)


def test_takes_new_parts_and_forgets_old_ones() -> None:
    calibration = Calibration().with_part(FULL.gyro).with_part(FULL.compass)  # type: ignore[arg-type]
    assert calibration == Calibration(gyro=FULL.gyro, compass=FULL.compass)
    assert calibration.without("gyro") == Calibration(compass=FULL.compass)
    assert np.array(IDENTITY) == pytest.approx(np.eye(3))
