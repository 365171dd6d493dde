"""Sea water from what a CTD measures: practical salinity, sound speed, depth.

Temperatures are ITS-90. Every formula refuses to answer outside the range it was published for.
"""

from __future__ import annotations

import math

from bluerov_slam.errors import OutOfValidityError

STANDARD_ATMOSPHERE_PA = 101_325.0
STANDARD_GRAVITY_MPS2 = 9.80665
SEA_WATER_DENSITY_KG_PER_M3 = 1025.0
CONDUCTIVITY_35_15_0_S_PER_M = 4.2914

_PA_PER_DBAR = 1e4
_PA_PER_BAR = 1e5
# PSS-78 is defined on IPTS-68.
_T68_PER_T90 = 1.00024


def practical_salinity_psu(
    conductivity_s_per_m: float,
    temperature_degc: float,
    pressure_pa: float,
    surface_pressure_pa: float = STANDARD_ATMOSPHERE_PA,
) -> float:
    """Practical salinity PSS-78 from conductivity, temperature and absolute pressure.

    Below 2 PSU the extension of Hill et al. (1986) is used, so that a pool and a river have an answer too.
    Raises OutOfValidityError outside -2..35 degC, 0..10000 dbar of sea pressure and 0..42 PSU.
    Source: UNESCO (1983) technical paper 44, Fofonoff and Millard; Hill et al., doi:10.1109/JOE.1986.1145154.
    Check: 3.45487 S/m, 28.7856 degC, 10 dbar -> 20.00987 PSU.
    """
    pressure_dbar = max(0.0, pressure_pa - surface_pressure_pa) / _PA_PER_DBAR
    _require("temperature", temperature_degc, -2.0, 35.0, "degC")
    _require("sea pressure", pressure_dbar, 0.0, 10_000.0, "dbar")
    _require("conductivity", conductivity_s_per_m, 0.0, 10.0, "S/m")
    t = temperature_degc * _T68_PER_T90
    ratio = conductivity_s_per_m / CONDUCTIVITY_35_15_0_S_PER_M
    pressure_factor = 1 + pressure_dbar * (2.070e-5 + pressure_dbar * (-6.370e-10 + pressure_dbar * 3.989e-15)) / (
        1 + t * (3.426e-2 + t * 4.464e-4) + ratio * (4.215e-1 - 3.107e-3 * t)
    )
    temperature_factor = _horner(t, 6.766097e-1, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9)
    salinity_psu = _salinity_of_ratio(ratio / (pressure_factor * temperature_factor), t)
    _require("salinity", salinity_psu, 0.0, 42.0, "PSU")
    return salinity_psu


def mackenzie_sound_speed_mps(temperature_degc: float, salinity_psu: float, depth_m: float) -> float:
    """Sound speed in sea water by Mackenzie's nine terms, m/s.

    Raises OutOfValidityError outside -2..30 degC, 30..40 PSU, 0..8000 m (so not for a fresh-water pool).
    Source: Mackenzie (1981), doi:10.1121/1.386920. Check: 25 degC, 35 PSU, 1000 m -> 1550.744 m/s.
    """
    _require("temperature", temperature_degc, -2.0, 30.0, "degC")
    _require("salinity", salinity_psu, 30.0, 40.0, "PSU")
    _require("depth", depth_m, 0.0, 8000.0, "m")
    t, s, d = temperature_degc, salinity_psu - 35.0, depth_m
    return (
        _horner(t, 1448.96, 4.591, -5.304e-2, 2.374e-4)
        + 1.340 * s
        + 1.630e-2 * d
        + 1.675e-7 * d * d
        - 1.025e-2 * t * s
        - 7.139e-13 * t * d**3
    )


def unesco_sound_speed_mps(temperature_degc: float, salinity_psu: float, sea_pressure_pa: float) -> float:
    """Sound speed by the UNESCO equation with the ITS-90 coefficients of Wong and Zhu, m/s; fresh water included.

    `sea_pressure_pa` is above atmospheric. Raises OutOfValidityError outside 0..40 degC, 0..40 PSU, 0..1000 bar.
    Source: Chen and Millero (1977), Wong and Zhu (1995), doi:10.1121/1.413048.
    Check: 39.9904 degC (40 on IPTS-68), 40 PSU, 10000 dbar -> 1731.995 m/s.
    """
    _require("temperature", temperature_degc, 0.0, 40.0, "degC")
    _require("salinity", salinity_psu, 0.0, 40.0, "PSU")
    t, s, p = temperature_degc, salinity_psu, sea_pressure_pa / _PA_PER_BAR
    _require("sea pressure", p, 0.0, 1000.0, "bar")
    pure_water = _horner(
        p,
        _horner(t, 1402.388, 5.03830, -5.81090e-2, 3.3432e-4, -1.47797e-6, 3.1419e-9),
        _horner(t, 0.153563, 6.8999e-4, -8.1829e-6, 1.3632e-7, -6.1260e-10),
        _horner(t, 3.1260e-5, -1.7111e-6, 2.5986e-8, -2.5353e-10, 1.0415e-12),
        _horner(t, -9.7729e-9, 3.8513e-10, -2.3654e-12),
    )
    linear = _horner(
        p,
        _horner(t, 1.389, -1.262e-2, 7.166e-5, 2.008e-6, -3.21e-8),
        _horner(t, 9.4742e-5, -1.2583e-5, -6.4928e-8, 1.0515e-8, -2.0142e-10),
        _horner(t, -3.9064e-7, 9.1061e-9, -1.6009e-10, 7.994e-12),
        _horner(t, 1.100e-10, 6.651e-12, -3.391e-13),
    )
    power_3_2 = -1.922e-2 - 4.42e-5 * t + (7.3637e-5 + 1.7950e-7 * t) * p
    square = 1.727e-3 - 7.9836e-6 * p
    return pure_water + linear * s + power_3_2 * s * math.sqrt(s) + square * s * s


def sound_speed_mps(temperature_degc: float, salinity_psu: float, sea_pressure_pa: float) -> float:
    """Mackenzie where it is valid (as the firmware computes it), else UNESCO.

    Raises OutOfValidityError where neither is valid.
    """
    sea_pressure_pa = max(0.0, sea_pressure_pa)
    try:
        return mackenzie_sound_speed_mps(temperature_degc, salinity_psu, depth_m(sea_pressure_pa, 0.0))
    except OutOfValidityError:
        return unesco_sound_speed_mps(temperature_degc, salinity_psu, sea_pressure_pa)


def depth_m(
    pressure_pa: float, surface_pressure_pa: float, density_kg_per_m3: float = SEA_WATER_DENSITY_KG_PER_M3
) -> float:
    """Depth below the surface from absolute pressure, as the wire defines it: constant density and gravity.

    Negative above the surface. The error against the full equation of state is below 0.3 % down to 300 m.
    Raises OutOfValidityError more than one atmosphere above or 1100 bar below the surface pressure.
    """
    _require("pressure", pressure_pa - surface_pressure_pa, -STANDARD_ATMOSPHERE_PA, 1.1e8, "Pa")
    return (pressure_pa - surface_pressure_pa) / (density_kg_per_m3 * STANDARD_GRAVITY_MPS2)


def _salinity_of_ratio(ratio_t: float, t68_degc: float) -> float:
    """PSS-78 from the conductivity ratio at the same temperature, with Hill's correction below 2 PSU."""
    root = math.sqrt(ratio_t)
    temperature_term = (t68_degc - 15) / (1 + 0.0162 * (t68_degc - 15))
    salinity_psu = _horner(root, 0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081) + temperature_term * _horner(
        root, 0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144
    )
    if salinity_psu >= 2.0:
        return salinity_psu
    x, y = 400 * ratio_t, 100 * ratio_t
    correction = 0.0080 / (1 + 1.5 * x + x * x) + 0.0005 * temperature_term / (1 + math.sqrt(y) * (1 + y))
    return max(0.0, salinity_psu - correction)


def _horner(x: float, *coefficients: float) -> float:
    """Polynomial with the constant term first."""
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value


def _require(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise OutOfValidityError(f"{name} {value:.6g} {unit}, the formula is valid for {low:g}..{high:g}")
