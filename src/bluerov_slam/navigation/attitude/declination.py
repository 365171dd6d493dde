"""The Earth's magnetic field at a place and date, by the World Magnetic Model (WMM 2025, valid 2025.0 to 2030.0)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from pygeomag import GeoMag
from pygeomag.wmm.wmm_2025 import WMM_2025

from bluerov_slam.errors import OutOfValidityError

VALID_YEARS = (2025.0, 2030.0)
WEAK_HORIZONTAL_FIELD_NT = 2000.0
_GREGORIAN_YEAR_S = 365.2425 * 86_400.0


@dataclass(frozen=True, slots=True)
class MagneticField:
    """Field at one place: declination (east positive) and inclination (down positive), rad; strength in nT.

    `declination_std_rad` is the model's own one-sigma error, which grows where the horizontal field is weak.
    """

    declination_rad: float
    inclination_rad: float
    strength_nt: float
    declination_std_rad: float

    @property
    def unit_ned(self) -> tuple[float, float, float]:
        """Direction of the field in true NED, length 1."""
        horizontal = math.cos(self.inclination_rad)
        return (
            horizontal * math.cos(self.declination_rad),
            horizontal * math.sin(self.declination_rad),
            math.sin(self.inclination_rad),
        )


def decimal_year(unix_s: float) -> float:
    """Calendar year with its fraction; within a day, which moves the field by nothing."""
    return 1970.0 + unix_s / _GREGORIAN_YEAR_S


def magnetic_field(latitude_deg: float, longitude_deg: float, year: float, altitude_m: float = 0.0) -> MagneticField:
    """The model's field.

    Raises OutOfValidityError outside 2025.0..2030.0, for an impossible position, and where the horizontal field is
    under 2000 nT (near the magnetic poles, where a compass is of no use).
    Source: NOAA/BGS, The US/UK World Magnetic Model for 2025-2030. Check: 80 degN, 0 degE, 2025.0, sea level ->
    declination 1.28 deg, inclination 83.21 deg, 55,178.5 nT.
    """
    if not (-90.0 <= latitude_deg <= 90.0 and -180.0 <= longitude_deg <= 360.0):
        raise OutOfValidityError(f"position {latitude_deg}, {longitude_deg} deg is not on the Earth")
    if not VALID_YEARS[0] <= year <= VALID_YEARS[1]:
        raise OutOfValidityError(f"year {year:.1f}, the magnetic model is valid from 2025.0 to 2030.0")
    result = _model().calculate(glat=latitude_deg, glon=longitude_deg, alt=altitude_m / 1000.0, time=year)
    if result.h < WEAK_HORIZONTAL_FIELD_NT:
        raise OutOfValidityError(f"horizontal field {result.h:.0f} nT: too near a magnetic pole for a compass")
    return MagneticField(
        declination_rad=math.radians(result.d),
        inclination_rad=math.radians(result.i),
        strength_nt=float(result.f),
        declination_std_rad=math.radians(result.calculate_uncertainty().d),
    )


@lru_cache(maxsize=1)
def _model() -> GeoMag:
    return GeoMag(coefficients_data=WMM_2025)
