"""What depends on where on the Earth the simulated dive is: gravity, the magnetic field, metres and degrees."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from pygeomag import GeoMag
from pygeomag.wmm.wmm_2025 import WMM_2025

_YEAR_S = 365.2425 * 86_400.0


@lru_cache(maxsize=16)
def _field(latitude_deg: float, longitude_deg: float, year: float) -> tuple[float, float, float]:
    result = GeoMag(coefficients_data=WMM_2025).calculate(
        glat=latitude_deg, glon=longitude_deg, alt=0.0, time=year, allow_date_outside_lifespan=True
    )
    return float(result.x), float(result.y), float(result.z)


def magnetic_field_ned_nt(latitude_deg: float, longitude_deg: float, unix_s: float) -> NDArray[np.float64]:
    """The Earth's field by the World Magnetic Model of 2025; beyond its years it is carried on."""
    # By the quarter: a tenth of a second of arc matters nothing, and the same place is asked for again and again.
    year = round(4.0 * (1970.0 + unix_s / _YEAR_S)) / 4.0
    return np.array(_field(latitude_deg, longitude_deg, year))


def gravity_mps2(latitude_deg: float) -> float:
    """Normal gravity at sea level, WGS 84 (Somigliana)."""
    square = math.sin(math.radians(latitude_deg)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * square) / math.sqrt(1.0 - 0.00669437999013 * square)


def metres_per_degree(latitude_deg: float) -> tuple[float, float]:
    """Of latitude and of longitude, on the ellipsoid WGS 84."""
    sine = math.sin(math.radians(latitude_deg))
    root = 1.0 - 0.00669437999013 * sine * sine
    across_m = 6_378_137.0 / math.sqrt(root)
    along_m = across_m * (1.0 - 0.00669437999013) / root
    per_degree = math.pi / 180.0
    return along_m * per_degree, across_m * math.cos(math.radians(latitude_deg)) * per_degree
