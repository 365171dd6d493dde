"""Columns whose truth is known: even water, a thermocline, water with a hole in the middle."""

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import (
    ColumnOptions,
    Extension,
    SoundSpeedFormula,
    WaterColumn,
    density_kg_per_m3,
    gravity_mps2,
    mackenzie_sound_speed_mps,
    measured_water_depth_m,
    sound_speed_by_mps,
    standard_ocean_depth_m,
)
from bluerov_slam.navigation.seawater.profile import ColumnNodes

LATITUDE_DEG = 48.0


def column(
    pressures_pa: np.ndarray, temperature: np.ndarray, salinity: np.ndarray, options: ColumnOptions | None = None
) -> WaterColumn:
    count = len(pressures_pa)
    nodes = ColumnNodes(
        sea_pressure_pa=pressures_pa,
        temperature_degc=temperature,
        salinity_psu=salinity,
        temperature_std_degc=np.full(count, 0.01),
        salinity_std_psu=np.full(count, 0.02),
        samples=np.full(count, 5),
        descending=np.ones(count, dtype=np.bool_),
        shallowest_pa=float(pressures_pa[0]),
        deepest_pa=float(pressures_pa[-1]),
    )
    return WaterColumn(nodes, LATITUDE_DEG, options)


def even(temperature: float = 12.0, salinity: float = 35.0, deepest_dbar: float = 100.0) -> WaterColumn:
    pressures = np.arange(1.0, deepest_dbar + 1) * 1e4
    return column(pressures, np.full_like(pressures, temperature), np.full_like(pressures, salinity))


def thermocline_degc(depth: np.ndarray) -> np.ndarray:
    return 8.0 + 10.0 / (1.0 + np.exp((depth - 25.0) / 3.0))


def thermocline() -> WaterColumn:
    pressures = np.arange(1.0, 81.0) * 1e4
    return column(pressures, thermocline_degc(pressures / 1e4), np.full_like(pressures, 35.0))


def test_depth_of_even_water_is_the_hydrostatic_depth() -> None:
    water = even()
    for dbar in (0.3, 5.0, 50.5, 100.0):
        expected = measured_water_depth_m(dbar * 1e4, 0.0, LATITUDE_DEG, 12.0, 35.0)
        assert water.depth_of_pressure_m(dbar * 1e4) == pytest.approx(expected, abs=1e-4)


def test_depth_of_the_standard_ocean_is_the_standard_ocean() -> None:
    pressures = np.arange(1.0, 1001.0) * 1e4
    water = column(pressures, np.zeros_like(pressures), np.full_like(pressures, 35.0))
    assert water.depth_m == pytest.approx(standard_ocean_depth_m(pressures, LATITUDE_DEG), abs=0.02)


def test_depth_of_a_lake_over_salt_is_the_integral_of_both() -> None:
    pressures = np.arange(1.0, 41.0) * 1e4
    salinity = np.where(pressures < 2e5, 2.0, 30.0)
    water = column(pressures, np.full_like(pressures, 10.0), salinity)
    fine = np.linspace(0.0, 4e5, 40_001)
    middle = 0.5 * (fine[1:] + fine[:-1])
    salt = np.interp(middle, pressures, salinity)
    density = density_kg_per_m3(np.full_like(middle, 10.0), salt, middle)
    expected = np.sum(np.diff(fine) / (density * gravity_mps2(LATITUDE_DEG, middle)))
    assert water.depth_of_pressure_m(4e5) == pytest.approx(expected, abs=1e-4)
    assert abs(water.depth_of_pressure_m(4e5) - standard_ocean_depth_m(4e5, LATITUDE_DEG)) > 0.4


def test_sound_speed_and_density_are_those_of_the_formulas() -> None:
    water = even()
    assert water.formula is SoundSpeedFormula.MACKENZIE
    assert water.sound_speed_at_mps(50.0) == pytest.approx(mackenzie_sound_speed_mps(12.0, 35.0, 50.0), abs=0.02)
    pressure = 50.0 * 1027.0 * 9.81
    assert water.density_at_kg_per_m3(50.0) == pytest.approx(density_kg_per_m3(12.0, 35.0, pressure), abs=0.01)
    assert water.temperature_at_degc(50.0) == pytest.approx(12.0)
    assert water.salinity_at_psu(50.0) == pytest.approx(35.0)
    speeds = water.sound_speed_at_mps(np.array([10.0, 50.0, 150.0, -1.0, np.nan]))
    assert speeds[1] == pytest.approx(water.sound_speed_at_mps(50.0))
    assert np.isnan(speeds[2:]).all()


def test_one_formula_serves_the_whole_column() -> None:
    pressures = np.arange(1.0, 41.0) * 1e4
    water = column(pressures, np.full_like(pressures, 10.0), np.linspace(25.0, 35.0, 40))
    assert water.formula is SoundSpeedFormula.UNESCO
    assert np.all(np.abs(np.diff(water.sound_speed_mps)) < 0.5)
    with_choice = column(
        pressures,
        np.full_like(pressures, 10.0),
        np.full_like(pressures, 35.0),
        ColumnOptions(formula=SoundSpeedFormula.DEL_GROSSO),
    )
    expected = sound_speed_by_mps(SoundSpeedFormula.DEL_GROSSO, 10.0, 35.0, 2e5)
    assert with_choice.sound_speed_mps[19] == pytest.approx(expected, abs=1e-9)


def test_the_mean_is_path_over_travel_time() -> None:
    water = thermocline()
    fine = np.linspace(3.0, 70.0, 200_001)
    middle = 0.5 * (fine[1:] + fine[:-1])
    expected = 67.0 / np.sum(np.diff(fine) / water.sound_speed_at_mps(middle))
    # The layers' sound speed is straight, that of their temperature is bent a little.
    assert water.mean_sound_speed_mps(3.0, 70.0) == pytest.approx(expected, abs=1e-3)
    assert water.mean_sound_speed_mps(70.0, 3.0) == water.mean_sound_speed_mps(3.0, 70.0)
    assert water.mean_sound_speed_mps(25.0, 25.0) == water.sound_speed_at_mps(25.0)
    # Harmonic, so below the arithmetic mean.
    assert water.mean_sound_speed_mps(3.0, 70.0) < np.mean(water.sound_speed_at_mps(middle))


def test_what_was_not_sampled_is_unknown_unless_asked() -> None:
    water = thermocline()
    beyond = water.deepest_m + 10.0
    for ask in (water.sound_speed_at_mps, water.density_at_kg_per_m3, water.sound_speed_std_at_mps):
        with pytest.raises(OutOfValidityError, match="sampled"):
            ask(beyond)
        assert np.isfinite(ask(beyond, Extension.NEAREST))
        with pytest.raises(OutOfValidityError):
            ask(-1.0, Extension.NEAREST)
    with pytest.raises(OutOfValidityError):
        water.mean_sound_speed_mps(10.0, beyond)
    assert np.isfinite(water.mean_sound_speed_mps(10.0, beyond, Extension.NEAREST))
    # By the rule: the last temperature and salinity under the pressure there.
    expected = mackenzie_sound_speed_mps(float(water.nodes.temperature_degc[-1]), 35.0, beyond)
    assert water.sound_speed_at_mps(beyond, Extension.NEAREST) == pytest.approx(expected, abs=0.02)
    with pytest.raises(OutOfValidityError):
        water.depth_of_pressure_m(2e6)
    answers = water.depth_of_pressure_m(np.array([1e5, 2e6, -2e4]))
    assert np.isfinite(answers[0])
    assert np.isnan(answers[1:]).all()
    extended = water.depth_of_pressure_m(2e6, Extension.NEAREST)
    assert extended == pytest.approx(standard_ocean_depth_m(2e6, LATITUDE_DEG), rel=2e-3)


def test_noise_above_the_surface_is_a_depth_just_above_it() -> None:
    assert even().depth_of_pressure_m(-300.0) == pytest.approx(-0.03, abs=1e-3)


def test_a_hole_is_unknown_and_a_short_one_is_bridged() -> None:
    pressures = np.concatenate((np.arange(1.0, 11.0), [14.0, 15.0], np.arange(30.0, 41.0))) * 1e4
    water = column(pressures, np.full_like(pressures, 10.0), np.full_like(pressures, 35.0))
    assert np.isfinite(water.sound_speed_at_mps(12.0))
    with pytest.raises(OutOfValidityError, match="holes"):
        water.sound_speed_at_mps(22.0)
    with pytest.raises(OutOfValidityError, match="holes"):
        water.mean_sound_speed_mps(12.0, 35.0)
    on_the_nodes = water.sound_speed_at_mps(water.depth_m)
    assert np.isfinite(on_the_nodes).all()
    # 7 m from the nearer end, 0.1 m/s for each.
    expected = np.hypot(water.sound_speed_std_at_mps(12.0), 0.7)
    assert water.sound_speed_std_at_mps(22.0, Extension.NEAREST) == pytest.approx(expected, abs=0.01)
    # The density of a hole is known well enough for depth.
    assert water.depth_of_pressure_m(2.2e5) == pytest.approx(
        measured_water_depth_m(2.2e5, 0.0, LATITUDE_DEG, 10.0, 35.0), abs=1e-3
    )


def test_a_first_sample_far_down_leaves_what_is_above_it_unknown() -> None:
    pressures = np.arange(20.0, 41.0) * 1e4
    water = column(pressures, np.full_like(pressures, 10.0), np.full_like(pressures, 35.0))
    assert water.shallowest_m == pytest.approx(19.8, abs=0.1)
    for unknown in (water.sound_speed_at_mps, water.density_at_kg_per_m3):
        with pytest.raises(OutOfValidityError):
            unknown(5.0)
    with pytest.raises(OutOfValidityError):
        water.depth_of_pressure_m(3e5)
    assert water.depth_of_pressure_m(3e5, Extension.NEAREST) == pytest.approx(29.7, abs=0.1)


def test_uncertainty_comes_from_the_sensors_and_grows_with_distance() -> None:
    water = even()
    step = 1e-4
    by_temperature = (
        mackenzie_sound_speed_mps(12 + step, 35.0, 50.0) - mackenzie_sound_speed_mps(12.0, 35.0, 50.0)
    ) / step
    by_salinity = 1.340 - 1.025e-2 * 12
    expected = np.hypot(by_temperature * np.hypot(0.05, 0.01), by_salinity * np.hypot(0.02 * 35, 0.02))
    assert water.sound_speed_std_at_mps(50.0) == pytest.approx(expected, rel=1e-3)
    assert water.mean_sound_speed_std_mps(10.0, 60.0) == pytest.approx(expected, rel=0.01)
    deepest = water.deepest_m
    near, far = (water.sound_speed_std_at_mps(deepest + more, Extension.NEAREST) for more in (1.0, 50.0))
    assert expected < near < far
    assert far == pytest.approx(np.hypot(expected, 5.0), rel=0.01)
    # 2 % of 35 PSU are 0.54 kg/m3, so 5 cm in 100 m.
    assert water.depth_std_m(100.0) == pytest.approx(0.053, abs=0.003)


def test_the_stated_uncertainty_is_what_wrong_sensors_cause() -> None:
    generator = np.random.default_rng(11)
    truth = even()
    stated = truth.mean_sound_speed_std_mps(0.5, 90.0)
    pressures = truth.nodes.sea_pressure_pa
    errors = []
    for _ in range(300):
        temperature = 12.0 + generator.normal(0, 0.05) + generator.normal(0, 0.01, len(pressures))
        salinity = 35.0 * (1 + generator.normal(0, 0.02)) + generator.normal(0, 0.02, len(pressures))
        found = column(pressures, temperature, salinity).mean_sound_speed_mps(0.5, 90.0)
        errors.append(found - truth.mean_sound_speed_mps(0.5, 90.0))
    assert np.std(errors) == pytest.approx(stated, rel=0.15)


def test_nodes_without_a_valid_formula_are_left_out() -> None:
    pressures = np.arange(1.0, 21.0) * 1e4
    temperature = np.full_like(pressures, 10.0)
    temperature[-3:] = 90.0
    water = column(pressures, temperature, np.full_like(pressures, 35.0))
    assert len(water.depth_m) == 17
    assert water.deepest_m == pytest.approx(16.8, abs=0.1)
    with pytest.raises(OutOfValidityError):
        column(pressures, np.full_like(pressures, 90.0), np.full_like(pressures, 35.0))
