import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import density_kg_per_m3

# UNESCO technical paper 44 (1983), page 19: PSU, degC on IPTS-68, bar, kg/m3.
UNESCO_44 = [
    (0.0, 5.0, 0.0, 999.96675),
    (0.0, 5.0, 1000.0, 1044.12802),
    (0.0, 25.0, 0.0, 997.04796),
    (0.0, 25.0, 1000.0, 1037.90204),
    (35.0, 5.0, 0.0, 1027.67547),
    (35.0, 5.0, 1000.0, 1069.48914),
    (35.0, 25.0, 0.0, 1023.34306),
    (35.0, 25.0, 1000.0, 1062.53817),
]


@pytest.mark.parametrize(("salinity", "t68", "bar", "expected"), UNESCO_44)
def test_density_matches_the_unesco_report(salinity: float, t68: float, bar: float, expected: float) -> None:
    assert density_kg_per_m3(t68 / 1.00024, salinity, bar * 1e5) == pytest.approx(expected, abs=1e-5)


def test_density_matches_the_anomaly_of_the_unesco_report() -> None:
    # Paper 44, check value of SVAN: 40 PSU, 40 degC (IPTS-68), 10000 dbar -> anomaly 59.82037 kg/m3.
    assert density_kg_per_m3(40 / 1.00024, 40.0, 1e8) == pytest.approx(1059.82037, abs=1e-5)


@pytest.mark.parametrize("arguments", [(-2.1, 35, 0), (40.1, 35, 0), (10, -0.1, 0), (10, 42.1, 0), (10, 35, 1.01e8)])
def test_density_refuses_outside_its_range(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(OutOfValidityError):
        density_kg_per_m3(*arguments)


def test_arrays_give_the_same_numbers_and_nan_outside() -> None:
    answers = density_kg_per_m3(np.array([10.0, 99.0]), np.full(2, 35.0), np.full(2, 1e6))
    assert answers[0] == pytest.approx(density_kg_per_m3(10.0, 35.0, 1e6), abs=1e-9)
    assert np.isnan(answers[1])
