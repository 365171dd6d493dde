"""Between latitude and longitude (WGS-84) and metres north, east, down about an origin.

The plane touches the ellipsoid at the origin at sea level. `down` is measured along the origin's vertical: 1 km away
the sea surface lies 0.08 m below the plane, so depth below the surface and `down` agree to that over a dive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

EQUATOR_RADIUS_M = 6_378_137.0
"""Semi-major axis of WGS-84 (NIMA TR8350.2)."""
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """North, east, down about an origin."""

    latitude_deg: float
    longitude_deg: float

    def __post_init__(self) -> None:
        if not (-90.0 <= self.latitude_deg <= 90.0 and -180.0 <= self.longitude_deg <= 180.0):
            raise ValueError(f"no position on earth: {self.latitude_deg} deg, {self.longitude_deg} deg")

    def to_ned_m(self, latitude_deg: float, longitude_deg: float, height_m: float = 0.0) -> tuple[float, float, float]:
        """Metres north, east and down of the origin."""
        x, y, z = _earth_fixed(latitude_deg, longitude_deg, height_m)
        x0, y0, z0 = _earth_fixed(self.latitude_deg, self.longitude_deg, 0.0)
        dx, dy, dz = x - x0, y - y0, z - z0
        sin_lat, cos_lat, sin_lon, cos_lon = self._trigonometry()
        outward = cos_lon * dx + sin_lon * dy
        return (
            cos_lat * dz - sin_lat * outward,
            cos_lon * dy - sin_lon * dx,
            -(cos_lat * outward + sin_lat * dz),
        )

    def to_geodetic(self, north_m: float, east_m: float, down_m: float = 0.0) -> tuple[float, float, float]:
        """Latitude and longitude in degrees, height above the ellipsoid in metres."""
        sin_lat, cos_lat, sin_lon, cos_lon = self._trigonometry()
        x0, y0, z0 = _earth_fixed(self.latitude_deg, self.longitude_deg, 0.0)
        outward = -sin_lat * north_m - cos_lat * down_m
        return _geodetic(
            x0 + cos_lon * outward - sin_lon * east_m,
            y0 + sin_lon * outward + cos_lon * east_m,
            z0 + cos_lat * north_m - sin_lat * down_m,
        )

    def _trigonometry(self) -> tuple[float, float, float, float]:
        latitude, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        return math.sin(latitude), math.cos(latitude), math.sin(longitude), math.cos(longitude)


def _earth_fixed(latitude_deg: float, longitude_deg: float, height_m: float) -> tuple[float, float, float]:
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
    normal = EQUATOR_RADIUS_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat)
    return (
        (normal + height_m) * cos_lat * math.cos(longitude),
        (normal + height_m) * cos_lat * math.sin(longitude),
        (normal * (1.0 - ECCENTRICITY_SQUARED) + height_m) * sin_lat,
    )


def _geodetic(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Bowring's formula, iterated once more: below 1e-9 m near the surface."""
    from_axis = math.hypot(x, y)
    polar_radius = EQUATOR_RADIUS_M * (1.0 - FLATTENING)
    second = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED)
    reduced = math.atan2(z * EQUATOR_RADIUS_M, from_axis * polar_radius)
    latitude = reduced
    for _ in range(2):
        latitude = math.atan2(
            z + second * polar_radius * math.sin(reduced) ** 3,
            from_axis - ECCENTRICITY_SQUARED * EQUATOR_RADIUS_M * math.cos(reduced) ** 3,
        )
        reduced = math.atan2((1.0 - FLATTENING) * math.sin(latitude), math.cos(latitude))
    sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
    normal = EQUATOR_RADIUS_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat)
    height = from_axis / cos_lat - normal if abs(cos_lat) > 0.5 else z / sin_lat - normal * (1.0 - ECCENTRICITY_SQUARED)
    return math.degrees(latitude), math.degrees(math.atan2(y, x)), height
