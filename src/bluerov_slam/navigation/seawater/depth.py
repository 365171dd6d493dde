"""Depth below the surface from absolute pressure.

Three answers, from crude to fine:

- `depth_m`: the wire's definition, one density and one gravity for the whole world. It is what the firmware sends.
- `measured_water_depth_m`: hydrostatic, with the density of the water that the vehicle itself measured and the local
  gravity. For shallow water: there the vehicle's water is the whole column's, be it sea, lake or pool, and fresh water
  differs from the sea by 2.8 %.
- `standard_ocean_depth_m`: the formula of Fofonoff and Millard, an ocean of 35 PSU and 0 degC that is compressed by its
  own weight. For deep water: what the vehicle measures far down says little of the warm water above it, and the real
  ocean's anomaly is 1 to 2 m in thousands.

`vehicle_depth` chooses, and says how far its answer may be off. A measured water column (`profile.py`) beats all three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater.density import density_kg_per_m3
from bluerov_slam.navigation.seawater.validity import PA_PER_DBAR, Value, within

if TYPE_CHECKING:
    from numpy.typing import NDArray

STANDARD_ATMOSPHERE_PA = 101_325.0
STANDARD_GRAVITY_MPS2 = 9.80665
SEA_WATER_DENSITY_KG_PER_M3 = 1025.0

SHALLOW_PA = 5e6
"""Some 500 m: down to here the water at the vehicle stands for the whole column."""
OCEAN_FROM_PSU = 30.0
"""Fresher water at depth is a lake or the Black Sea, which no ocean stands for."""
# Half of what salinity and temperature change from the surface to 500 m in most seas; in deep water the share of the
# ocean's anomaly; for water that nobody measured half of what lies between a lake and a salty sea.
_MEASURED_RELATIVE_STD = 1e-3
_OCEAN_RELATIVE_STD = 1e-3
_UNKNOWN_RELATIVE_STD = 1.6e-2

# Air pressure at the highest lakes and above it, with a margin; a sensor a few metres down is refused by `SURFACE_MAX`.
SURFACE_MIN_PA = 50_000.0
SURFACE_MAX_PA = 115_000.0
SURFACE_SAMPLES = 5
SURFACE_SPREAD_PA = 1_000.0
"""10 cm of water, 1 sigma: more is not a vehicle that waits at the surface."""
_STD_PER_MAD = 1.4826

# A sensor at the surface may read up to 1 m of water too little.
_ABOVE_SURFACE_DBAR = -1.0


class DepthFormula(StrEnum):
    """Where a depth comes from."""

    MEASURED_WATER = "measured_water"
    STANDARD_OCEAN = "standard_ocean"


@dataclass(frozen=True, slots=True)
class VehicleDepth:
    """Depth below the surface and what it was computed with. `relative_std` is 1 sigma as a share of the depth."""

    depth_m: float
    formula: DepthFormula
    relative_std: float


@dataclass(frozen=True, slots=True)
class SurfacePressure:
    """Absolute pressure at the water surface as the vehicle's own sensor reads it, Pa; `std_pa` is that of the mean."""

    pressure_pa: float
    std_pa: float
    samples: int


def depth_m(
    pressure_pa: Value, surface_pressure_pa: float, density_kg_per_m3: float = SEA_WATER_DENSITY_KG_PER_M3
) -> Value:
    """Depth below the surface from absolute pressure, as the wire defines it: constant density and gravity.

    Negative above the surface. The error against the full equation of state is below 0.3 % down to 300 m.
    Valid from one atmosphere above to 1100 bar below the surface pressure.
    """
    sea_pressure_pa = within("pressure", pressure_pa - surface_pressure_pa, -STANDARD_ATMOSPHERE_PA, 1.1e8, "Pa")
    return sea_pressure_pa / (density_kg_per_m3 * STANDARD_GRAVITY_MPS2)


def gravity_mps2(latitude_deg: float, sea_pressure_pa: Value) -> Value:
    """Gravity at a latitude and a sea pressure, m/s2.

    Valid for -90..90 deg. Source: Fofonoff and Millard (1983), UNESCO technical paper 44: the formula of 1967 and twice
    the growth that its depth formula has, which wants the mean from the surface down. Check: 30 deg, 0 dbar -> 9.79324.
    """
    square = math.sin(math.radians(within("latitude", latitude_deg, -90.0, 90.0, "deg"))) ** 2
    surface = 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * square) * square)
    return surface + 2 * 1.092e-6 * (sea_pressure_pa / PA_PER_DBAR)


def standard_ocean_depth_m(sea_pressure_pa: Value, latitude_deg: float) -> Value:
    """Depth from sea pressure in the standard ocean (35 PSU, 0 degC), m; the real one's anomaly is left out.

    Valid for 0..10000 dbar (1 dbar of sensor noise above the surface is taken) and -90..90 deg.
    Source: Saunders and Fofonoff (1976), refitted in UNESCO technical paper 44 (1983). Check: 10000 dbar, 30 deg ->
    9712.653 m.
    """
    p = within("sea pressure", sea_pressure_pa / PA_PER_DBAR, _ABOVE_SURFACE_DBAR, 10_000.0, "dbar")
    specific_work = p * (9.72659 + p * (-2.2512e-5 + p * (2.279e-10 - 1.82e-15 * p)))
    return specific_work / gravity_mps2(latitude_deg, 0.5 * sea_pressure_pa)


def standard_ocean_pressure_pa(depth_m: Value, latitude_deg: float) -> Value:
    """Sea pressure at a depth of the standard ocean: the inverse of `standard_ocean_depth_m`, to 1 Pa.

    Valid for 0..9674 m, which every latitude reaches within 10000 dbar.
    """
    wanted_m = within("depth", depth_m, 0.0, 9674.0, "m")
    pressure_pa = wanted_m * 1e4
    for _ in range(4):
        # A dbar is a metre within 3 %: the error shrinks by that with each round, and Newton's slope makes it far less.
        step_m = wanted_m - standard_ocean_depth_m(pressure_pa, latitude_deg)
        pressure_pa = pressure_pa + step_m * _pa_per_m(pressure_pa, latitude_deg)
    return pressure_pa


def measured_water_depth_m(
    pressure_pa: Value,
    surface_pressure_pa: float,
    latitude_deg: float,
    temperature_degc: Value,
    salinity_psu: Value,
) -> Value:
    """Hydrostatic depth in water of one temperature and salinity, m; negative above the surface.

    Density and gravity are taken at half the pressure: for even water that is the integral, to 0.2 mm in 300 m
    and 7 mm in 1000 m. Valid where `density_kg_per_m3` is.
    """
    sea_pressure_pa = within("sea pressure", pressure_pa - surface_pressure_pa, -STANDARD_ATMOSPHERE_PA, 1e8, "Pa")
    density = density_kg_per_m3(temperature_degc, salinity_psu, 0.5 * sea_pressure_pa)
    return sea_pressure_pa / (density * gravity_mps2(latitude_deg, 0.5 * sea_pressure_pa))


def vehicle_depth(
    pressure_pa: float,
    surface_pressure_pa: float,
    latitude_deg: float,
    temperature_degc: float | None = None,
    salinity_psu: float | None = None,
) -> VehicleDepth:
    """The best depth without a measured column: see the head of this module for which formula and why.

    Raises OutOfValidityError where no formula is valid.
    """
    sea_pressure_pa = pressure_pa - surface_pressure_pa
    if temperature_degc is None or salinity_psu is None:
        depth = standard_ocean_depth_m(sea_pressure_pa, latitude_deg)
        return VehicleDepth(depth, DepthFormula.STANDARD_OCEAN, _UNKNOWN_RELATIVE_STD)
    if sea_pressure_pa > SHALLOW_PA and salinity_psu >= OCEAN_FROM_PSU:
        depth = standard_ocean_depth_m(sea_pressure_pa, latitude_deg)
        return VehicleDepth(depth, DepthFormula.STANDARD_OCEAN, _OCEAN_RELATIVE_STD)
    depth = measured_water_depth_m(pressure_pa, surface_pressure_pa, latitude_deg, temperature_degc, salinity_psu)
    return VehicleDepth(depth, DepthFormula.MEASURED_WATER, _MEASURED_RELATIVE_STD)


def surface_pressure(
    pressure_pa: NDArray[np.float64],
    sensor_depth_m: float = 0.0,
    density_kg_per_m3: float = SEA_WATER_DENSITY_KG_PER_M3,
) -> SurfacePressure:
    """Zero the depth: the surface pressure from samples (n,) of a vehicle that waits at the surface.

    The median, so that single waves and damaged samples do not count. NaN is left out.

    Args:
        pressure_pa: absolute, of some seconds before the dive.
        sensor_depth_m: how far below the surface the sensor hangs meanwhile.
        density_kg_per_m3: of the water over it.

    Raises:
        OutOfValidityError: fewer than 5 samples, a pressure that no surface has, or a vehicle that moves up and down.
    """
    finite = pressure_pa[np.isfinite(pressure_pa)]
    if len(finite) < SURFACE_SAMPLES:
        raise OutOfValidityError(f"{len(finite)} pressure samples, at least {SURFACE_SAMPLES} are needed")
    median = float(np.median(finite))
    spread = _STD_PER_MAD * float(np.median(np.abs(finite - median)))
    surface = median - density_kg_per_m3 * STANDARD_GRAVITY_MPS2 * sensor_depth_m
    within("surface pressure", surface, SURFACE_MIN_PA, SURFACE_MAX_PA, "Pa")
    if spread > SURFACE_SPREAD_PA:
        raise OutOfValidityError(
            f"the pressure moves by {spread:.0f} Pa, at most {SURFACE_SPREAD_PA:.0f} at the surface"
        )
    return SurfacePressure(surface, spread / math.sqrt(len(finite)), len(finite))


def _pa_per_m(sea_pressure_pa: Value, latitude_deg: float) -> Value:
    """Slope of pressure over depth in the standard ocean."""
    p = sea_pressure_pa / PA_PER_DBAR
    specific_volume = 9.72659 + p * (2 * -2.2512e-5 + p * (3 * 2.279e-10 - 4 * 1.82e-15 * p))
    return gravity_mps2(latitude_deg, sea_pressure_pa) / specific_volume * PA_PER_DBAR
