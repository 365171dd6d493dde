import itertools

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import (
    CONDUCTIVITY_35_15_0_S_PER_M,
    STANDARD_ATMOSPHERE_PA,
    practical_salinity_psu,
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


def test_arrays_give_the_same_numbers_and_nan_outside() -> None:
    conductivity = np.array([0.0, 0.05, 0.5, 4.2914, 9.0, np.nan])
    answers = practical_salinity_psu(conductivity, np.full(6, 15.0), np.full(6, STANDARD_ATMOSPHERE_PA))
    for found, alone in zip(answers[:4], conductivity[:4], strict=True):
        assert found == pytest.approx(practical_salinity_psu(float(alone), 15.0, STANDARD_ATMOSPHERE_PA), abs=1e-12)
    # 15 degC here is 15.0036 on the scale that defines 35 PSU.
    assert answers[3] == pytest.approx(35.0, abs=4e-3)
    assert np.isnan(answers[4:]).all()
