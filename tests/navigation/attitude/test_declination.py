"""The Earth's field against published values, and where the model refuses."""

from __future__ import annotations

import math

import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.attitude.declination import decimal_year, magnetic_field

# NOAA/BGS, WMM2025_TEST_VALUES (the model's report, table 6): year, height km, latitude, longitude; D, I deg, F nT.
PUBLISHED = [
    (2025.0, 0.0, 80.0, 0.0, 1.28, 83.21, 55178.5),
    (2025.0, 0.0, 0.0, 120.0, -0.16, -14.93, 41064.3),
    (2025.0, 0.0, -80.0, 240.0, 68.78, -72.00, 54698.2),
    (2025.0, 100.0, 80.0, 0.0, 0.85, 83.26, 52964.9),
    (2025.0, 100.0, 0.0, 120.0, -0.15, -15.08, 39032.1),
    (2025.0, 100.0, -80.0, 240.0, 68.21, -72.19, 52035.0),
    (2027.5, 0.0, 80.0, 0.0, 2.59, 83.24, 55253.9),
    (2027.5, 0.0, 0.0, 120.0, -0.24, -14.65, 41036.9),
    (2027.5, 0.0, -80.0, 240.0, 68.49, -71.92, 54474.2),
    (2027.5, 100.0, 80.0, 0.0, 2.16, 83.29, 53034.3),
    (2027.5, 100.0, 0.0, 120.0, -0.23, -14.81, 39007.4),
    (2027.5, 100.0, -80.0, 240.0, 67.93, -72.10, 51825.7),
]


@pytest.mark.parametrize("row", PUBLISHED)
def test_gives_the_published_values(row: tuple[float, ...]) -> None:
    year, height_km, latitude_deg, longitude_deg, declination_deg, inclination_deg, strength_nt = row
    field = magnetic_field(latitude_deg, longitude_deg, year, 1000.0 * height_km)
    assert math.degrees(field.declination_rad) == pytest.approx(declination_deg, abs=0.0051)
    assert math.degrees(field.inclination_rad) == pytest.approx(inclination_deg, abs=0.0051)
    assert field.strength_nt == pytest.approx(strength_nt, abs=0.06)


def test_unit_vector_has_the_direction_and_length_one() -> None:
    field = magnetic_field(47.1, 9.2, 2026.9)
    north, east, down = field.unit_ned
    assert math.hypot(north, east, down) == pytest.approx(1.0)
    assert math.atan2(east, north) == pytest.approx(field.declination_rad)
    assert down == pytest.approx(math.sin(field.inclination_rad))
    assert 47_000.0 < field.strength_nt < 50_000.0  # Switzerland, 2026


def test_its_error_grows_where_the_horizontal_field_is_weak() -> None:
    assert magnetic_field(80.0, 0.0, 2026.0).declination_std_rad > 2.0 * magnetic_field(45, 9, 2026).declination_std_rad


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "year"),
    [(45.0, 9.0, 2024.9), (45.0, 9.0, 2030.1), (91.0, 9.0, 2026.0), (math.nan, 9.0, 2026.0), (85.8, 139.3, 2025.5)],
)
def test_refuses_what_the_model_does_not_cover(latitude_deg: float, longitude_deg: float, year: float) -> None:
    with pytest.raises(OutOfValidityError):
        magnetic_field(latitude_deg, longitude_deg, year)


def test_decimal_year_is_right_within_two_days() -> None:
    assert decimal_year(1_735_689_600.0) == pytest.approx(2025.0, abs=2.0 / 365.0)  # 2025-01-01 UTC
