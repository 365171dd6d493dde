import math

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.process import normal_gravity_mps2
from bluerov_slam.navigation.seawater import (
    DepthFormula,
    density_kg_per_m3,
    depth_m,
    gravity_mps2,
    measured_water_depth_m,
    standard_ocean_depth_m,
    standard_ocean_pressure_pa,
    surface_pressure,
    vehicle_depth,
)

AIR_PA = 101_325.0


def test_depth_is_the_definition_of_the_wire() -> None:
    assert depth_m(101_325 + 1025 * 9.80665 * 60, 101_325) == pytest.approx(60.0)
    assert depth_m(101_000, 101_325) < 0


@pytest.mark.parametrize("pressure_pa", [math.nan, 2e8, -1e6])
def test_depth_refuses_an_impossible_pressure(pressure_pa: float) -> None:
    with pytest.raises(OutOfValidityError):
        depth_m(pressure_pa, 101_325)


# UNESCO technical paper 44 (1983), page 30: metres by dbar (rows) at 0, 30, 45 and 90 degrees of latitude.
@pytest.mark.parametrize(
    ("dbar", "expected_m"),
    [
        (500.0, (496.65, 496.00, 495.34, 494.03)),
        (5000.0, (4915.04, 4908.56, 4902.08, 4889.13)),
        (10_000.0, (9725.47, 9712.65, 9699.84, 9674.23)),
    ],
)
def test_standard_ocean_matches_the_unesco_report(dbar: float, expected_m: tuple[float, ...]) -> None:
    for latitude_deg, expected in zip((0.0, 30.0, 45.0, 90.0), expected_m, strict=True):
        assert standard_ocean_depth_m(dbar * 1e4, latitude_deg) == pytest.approx(expected, abs=0.006)
        assert standard_ocean_depth_m(dbar * 1e4, -latitude_deg) == pytest.approx(expected, abs=0.006)


def test_standard_ocean_matches_the_check_value() -> None:
    assert standard_ocean_depth_m(1e8, 30.0) == pytest.approx(9712.653, abs=5e-4)


@pytest.mark.parametrize(("pressure_pa", "latitude_deg"), [(1.01e8, 0.0), (-2e4, 0.0), (1e6, 91.0), (math.nan, 0.0)])
def test_standard_ocean_refuses_outside_its_range(pressure_pa: float, latitude_deg: float) -> None:
    with pytest.raises(OutOfValidityError):
        standard_ocean_depth_m(pressure_pa, latitude_deg)


def test_pressure_is_the_inverse_of_depth() -> None:
    depths = np.linspace(0.0, 9674.0, 101)
    for latitude_deg in (0.0, 45.0, 90.0):
        pressures = standard_ocean_pressure_pa(depths, latitude_deg)
        assert standard_ocean_depth_m(np.minimum(pressures, 1e8), latitude_deg) == pytest.approx(depths, abs=1e-4)


@pytest.mark.parametrize("latitude_deg", [0.0, 30.0, 45.0, 60.0, 90.0])
def test_gravity_is_that_of_the_ellipsoid(latitude_deg: float) -> None:
    assert gravity_mps2(latitude_deg, 0.0) == pytest.approx(normal_gravity_mps2(latitude_deg), rel=2e-6)


def integrated_depth_m(temperature: float, salinity: float, sea_pressure_pa: float, latitude_deg: float) -> float:
    """dp / (density * gravity) in 20 000 steps."""
    p = np.linspace(0.0, sea_pressure_pa, 20_001)
    middle = 0.5 * (p[1:] + p[:-1])
    density = density_kg_per_m3(np.full_like(middle, temperature), np.full_like(middle, salinity), middle)
    return float(np.sum(np.diff(p) / (density * gravity_mps2(latitude_deg, middle))))


@pytest.mark.parametrize(("temperature", "salinity"), [(4.0, 0.0), (12.0, 35.0), (25.0, 39.0)])
@pytest.mark.parametrize("dbar", [10.0, 300.0, 1000.0])
def test_measured_water_is_the_integral_of_its_density(temperature: float, salinity: float, dbar: float) -> None:
    expected = integrated_depth_m(temperature, salinity, dbar * 1e4, 50.0)
    found = measured_water_depth_m(AIR_PA + dbar * 1e4, AIR_PA, 50.0, temperature, salinity)
    assert found == pytest.approx(expected, abs=3e-4 if dbar <= 300.0 else 8e-3)


def test_measured_water_of_the_standard_ocean_is_the_standard_ocean() -> None:
    for dbar in (50.0, 500.0):
        measured = measured_water_depth_m(AIR_PA + dbar * 1e4, AIR_PA, 45.0, 0.0, 35.0)
        assert measured == pytest.approx(standard_ocean_depth_m(dbar * 1e4, 45.0), abs=0.02)


def test_a_lake_is_deeper_than_the_sea_at_the_same_pressure() -> None:
    lake = vehicle_depth(AIR_PA + 1e6, AIR_PA, 47.0, 10.0, 0.1)
    sea = vehicle_depth(AIR_PA + 1e6, AIR_PA, 47.0, 10.0, 38.0)
    assert lake.depth_m / sea.depth_m == pytest.approx(1.029, abs=0.001)
    assert lake.formula is sea.formula is DepthFormula.MEASURED_WATER


def test_the_formula_fits_the_depth_and_the_water() -> None:
    deep = vehicle_depth(AIR_PA + 2e7, AIR_PA, 30.0, 4.0, 35.0)
    assert deep.formula is DepthFormula.STANDARD_OCEAN
    assert deep.depth_m == standard_ocean_depth_m(2e7, 30.0)
    lake = vehicle_depth(AIR_PA + 1e7, AIR_PA, 53.0, 4.0, 0.1)
    assert lake.formula is DepthFormula.MEASURED_WATER
    unknown = vehicle_depth(AIR_PA + 1e6, AIR_PA, 45.0)
    assert unknown.formula is DepthFormula.STANDARD_OCEAN
    assert unknown.relative_std > 10 * deep.relative_std
    # Whatever the water was, it lies within two of the stated standard deviations.
    for salinity in (0.0, 20.0, 40.0):
        truth = measured_water_depth_m(AIR_PA + 1e6, AIR_PA, 45.0, 20.0, salinity)
        assert abs(truth - unknown.depth_m) < 2 * unknown.relative_std * truth


def test_the_surface_is_zeroed_by_the_median_of_what_the_vehicle_reads() -> None:
    generator = np.random.default_rng(5)
    samples = 98_000.0 + generator.normal(0.0, 20.0, 200)
    samples[::50] = 160_000.0
    samples[1::50] = np.nan
    found = surface_pressure(samples)
    assert found.pressure_pa == pytest.approx(98_000.0, abs=6.0)
    assert found.std_pa < 3.0
    assert found.samples == 196
    hanging = surface_pressure(samples, sensor_depth_m=0.2)
    assert found.pressure_pa - hanging.pressure_pa == pytest.approx(0.2 * 1025 * 9.80665)


@pytest.mark.parametrize(
    ("samples", "reason"),
    [
        (np.full(4, 101_325.0), "4 pressure samples"),
        (np.full(50, np.nan), "0 pressure samples"),
        (np.full(50, 250_000.0), "surface pressure"),
        (np.full(50, 0.0), "surface pressure"),
        (101_325.0 + np.linspace(0, 10_000, 50), "moves by"),
    ],
)
def test_what_is_no_surface_is_refused(samples: np.ndarray, reason: str) -> None:
    with pytest.raises(OutOfValidityError, match=reason):
        surface_pressure(samples)
