import math

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.declination import magnetic_field
from bluerov_slam.simulation.conditions import CONDITIONS, RECORDED
from bluerov_slam.simulation.instrument_errors import InstrumentErrors
from bluerov_slam.simulation.place import gravity_mps2, magnetic_field_ned_nt, metres_per_degree

PLACE = (47.6, -2.7, 1_780_300_800.0)
FIELD = magnetic_field_ned_nt(*PLACE)


def level(headings_rad: np.ndarray) -> np.ndarray:
    cos, sin, zero = np.cos(headings_rad), np.sin(headings_rad), np.zeros_like(headings_rad)
    one = np.ones_like(headings_rad)
    return np.moveaxis(np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]), 2, 0)


def test_a_level_turn_shows_the_stated_deviation() -> None:
    headings = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)
    for seed in range(5):
        errors = InstrumentErrors(CONDITIONS["hard"], seed, FIELD)
        at_once = np.zeros(360)
        shown = errors.compass_error_rad(at_once, level(headings), at_once) - errors.compass_wander_rad(at_once)
        a = shown.mean()
        b, c = 2.0 * (shown * np.cos(headings)).mean(), 2.0 * (shown * np.sin(headings)).mean()
        assert (a, b, c) == pytest.approx(
            (errors.deviation.a_rad, errors.deviation.b_rad, errors.deviation.c_rad), abs=math.radians(0.15)
        )
        stated = np.array([errors.deviation.at(heading) for heading in headings])
        assert np.abs(shown - stated).max() < math.radians(0.4)


def test_deviations_spread_as_the_conditions_say() -> None:
    drawn = []
    for seed in range(400):
        deviation = InstrumentErrors(CONDITIONS["hard"], seed, FIELD).deviation
        drawn.append((deviation.a_rad, deviation.b_rad, deviation.c_rad))
    total = np.degrees(np.sqrt((np.array(drawn) ** 2).mean(axis=0).sum()))
    assert total == pytest.approx(3.0, rel=0.1)


def test_thruster_current_disturbs_the_compass_and_the_wander_has_its_size() -> None:
    errors = InstrumentErrors(CONDITIONS["hard"], 2, FIELD)
    times = np.arange(0.0, 60_000.0, 5.0)
    assert errors.compass_wander_rad(times).std() == pytest.approx(math.radians(1.0), rel=0.15)
    here, facing = np.zeros(1), level(np.array((0.7,)))
    idle, working = (errors.compass_error_rad(here, facing, np.array((amperes,))) for amperes in (0.0, 20.0))
    assert 0.05 < abs(np.degrees(working - idle)[0]) < 3.0


def test_uncalibrated_iron_is_large_and_a_recording_brings_none() -> None:
    raw = InstrumentErrors(CONDITIONS["hard"], 3, FIELD, raw=True)
    assert np.linalg.norm(raw.hard_iron_nt) > 2_000.0
    headings = np.linspace(0.0, 2.0 * math.pi, 60, endpoint=False)
    nothing = InstrumentErrors(RECORDED, 3, FIELD)
    zero = np.zeros(60)
    assert nothing.compass_error_rad(zero, level(headings), zero) == pytest.approx(zero, abs=1e-9)
    assert nothing.pressure_error_pa(100.0) == 0.0
    assert np.all(nothing.gyro_bias_radps(zero) == 0.0)
    assert np.array_equal(nothing.acceleration_matrix, np.eye(3))


def test_biases_turn_on_anywhere_and_wander_little() -> None:
    times = np.arange(0.0, 1_800.0, 10.0)
    turned_on, wandered = [], []
    for seed in range(100):
        bias = np.degrees(InstrumentErrors(CONDITIONS["calm"], seed, FIELD).gyro_bias_radps(times))
        turned_on.append(bias[0])
        wandered.append(bias.std(axis=0))
    assert np.std(turned_on) == pytest.approx(0.15, rel=0.15)
    assert np.mean(wandered) * 3600.0 == pytest.approx(14.0, rel=0.2)  # deg/h


def test_the_place_is_the_earths() -> None:
    # NOAA/BGS WMM 2025 through the estimator's reader of the same model.
    model = magnetic_field(47.6, -2.7, 2026.5)
    assert pytest.approx(model.strength_nt * np.array(model.unit_ned), abs=25.0) == FIELD
    assert gravity_mps2(0.0) == pytest.approx(9.7803253, abs=1e-6)
    assert gravity_mps2(90.0) == pytest.approx(9.8321849, abs=1e-6)
    north_m, east_m = metres_per_degree(45.0)
    assert (north_m, east_m) == pytest.approx((111_131.8, 78_846.8), abs=0.5)
