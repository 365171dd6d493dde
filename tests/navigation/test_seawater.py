import itertools
import math

import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import (
    CONDUCTIVITY_35_15_0_S_PER_M,
    STANDARD_ATMOSPHERE_PA,
    depth_m,
    mackenzie_sound_speed_mps,
    practical_salinity_psu,
    sound_speed_mps,
    unesco_sound_speed_mps,
)

DBAR = 1e4


def salinity(conductivity_ms_per_cm: float, temperature_degc: float, pressure_dbar: float) -> float:
    return practical_salinity_psu(
        conductivity_ms_per_cm / 10, temperature_degc, STANDARD_ATMOSPHERE_PA + pressure_dbar * DBAR
    )


# Check values of gsw_SP_from_C (TEOS-10, https://www.teos-10.org/pubs/gsw/html/gsw_SP_from_C.html).
TEOS_10 = [
    (34.5487, 28.7856, 10, 20.009869599086951),
    (34.7275, 28.4329, 50, 20.265511864874270),
    (34.8605, 22.8103, 125, 22.981513062527689),
    (34.6810, 10.2600, 250, 31.204503263727982),
    (34.5680, 6.8863, 600, 34.032315787432829),
    (34.5600, 4.4036, 1000, 36.400308494388170),
]


@pytest.mark.parametrize(("conductivity", "temperature", "pressure", "expected"), TEOS_10)
def test_salinity_matches_teos_10(conductivity: float, temperature: float, pressure: float, expected: float) -> None:
    assert salinity(conductivity, temperature, pressure) == pytest.approx(expected, abs=1e-9)


# Fofonoff and Millard (1983): ratio to C(35,15,0), IPTS-68 temperature, dbar.
@pytest.mark.parametrize(
    ("ratio", "t68", "pressure", "expected"),
    [(1.0, 15.0, 0.0, 35.0), (1.2, 20.0, 2000.0, 37.245628), (0.65, 5.0, 1500.0, 27.995347)],
)
def test_salinity_matches_the_unesco_report(ratio: float, t68: float, pressure: float, expected: float) -> None:
    conductivity_ms_per_cm = ratio * CONDUCTIVITY_35_15_0_S_PER_M * 10
    assert salinity(conductivity_ms_per_cm, t68 / 1.00024, pressure) == pytest.approx(expected, abs=1e-6)


def test_fresh_water_has_a_salinity() -> None:
    assert salinity(0.0, 20.0, 0.0) == pytest.approx(0.0, abs=1e-12)
    assert 0.2 < salinity(0.5, 20.0, 0.0) < 0.35
    below, above = salinity(3.5, 20.0, 0.0), salinity(3.51, 20.0, 0.0)
    assert 0 < above - below < 0.01


def test_salinity_increases_with_conductivity() -> None:
    values = [salinity(c / 10, 15.0, 100.0) for c in range(1, 500)]
    assert all(b > a for a, b in itertools.pairwise(values))


@pytest.mark.parametrize(
    ("conductivity", "temperature", "pressure"),
    [(42.9, -2.5, 0.0), (42.9, 36.0, 0.0), (42.9, 15.0, 10_100.0), (90.0, 10.0, 0.0), (-1.0, 10.0, 0.0), (9e9, 1, 0)],
)
def test_salinity_refuses_what_is_not_sea_water(conductivity: float, temperature: float, pressure: float) -> None:
    with pytest.raises(OutOfValidityError, match="valid for"):
        salinity(conductivity, temperature, pressure)


def test_mackenzie_matches_its_published_value() -> None:
    assert mackenzie_sound_speed_mps(25.0, 35.0, 1000.0) == pytest.approx(1550.744, abs=5e-4)


def test_the_sea_of_the_original_example() -> None:
    assert mackenzie_sound_speed_mps(15.2, 35.5, 0.5) == pytest.approx(1507.9, abs=0.05)


def test_unesco_matches_its_published_value() -> None:
    assert unesco_sound_speed_mps(40 / 1.00024, 40.0, 1e8) == pytest.approx(1731.995, abs=0.01)


def test_unesco_matches_pure_water() -> None:
    # Del Grosso and Mader (1972): 1482.34 m/s at 20 degC.
    assert unesco_sound_speed_mps(20.0, 0.0, 0.0) == pytest.approx(1482.34, abs=0.05)


@pytest.mark.parametrize("arguments", [(-2.1, 35, 0), (30.1, 35, 0), (10, 29.9, 0), (10, 40.1, 0), (10, 35, 8001)])
def test_mackenzie_refuses_outside_its_range(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(OutOfValidityError):
        mackenzie_sound_speed_mps(*arguments)


@pytest.mark.parametrize("arguments", [(-0.1, 35, 0), (40.1, 35, 0), (10, -0.1, 0), (10, 40.1, 0), (10, 35, 1.01e8)])
def test_unesco_refuses_outside_its_range(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(OutOfValidityError):
        unesco_sound_speed_mps(*arguments)


def test_the_formula_in_use_changes_where_mackenzie_ends() -> None:
    assert sound_speed_mps(15.0, 35.0, 1e6) == mackenzie_sound_speed_mps(15.0, 35.0, depth_m(1e6, 0.0))
    assert sound_speed_mps(15.0, 5.0, 1e6) == unesco_sound_speed_mps(15.0, 5.0, 1e6)
    assert sound_speed_mps(15.0, 30.0, 1e6) == pytest.approx(unesco_sound_speed_mps(15.0, 30.0, 1e6), abs=0.5)
    with pytest.raises(OutOfValidityError):
        sound_speed_mps(-1.0, 5.0, 0.0)


def test_depth_is_the_definition_of_the_wire() -> None:
    assert depth_m(101_325 + 1025 * 9.80665 * 60, 101_325) == pytest.approx(60.0)
    assert depth_m(101_000, 101_325) < 0


@pytest.mark.parametrize("pressure_pa", [math.nan, 2e8, -1e6])
def test_depth_refuses_an_impossible_pressure(pressure_pa: float) -> None:
    with pytest.raises(OutOfValidityError):
        depth_m(pressure_pa, 101_325)
