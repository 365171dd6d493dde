"""Practical salinity from what a CTD measures."""

from __future__ import annotations

import numpy as np

from bluerov_slam.navigation.seawater.depth import STANDARD_ATMOSPHERE_PA
from bluerov_slam.navigation.seawater.validity import (
    PA_PER_DBAR,
    T68_PER_T90,
    Value,
    not_below_zero,
    polynomial,
    square_root,
    within,
)

CONDUCTIVITY_35_15_0_S_PER_M = 4.2914
"""Of standard sea water at 35 PSU, 15 degC and atmospheric pressure: Culkin and Smith (1980)."""

_HILL_BELOW_PSU = 2.0


def practical_salinity_psu(
    conductivity_s_per_m: Value,
    temperature_degc: Value,
    pressure_pa: Value,
    surface_pressure_pa: float = STANDARD_ATMOSPHERE_PA,
) -> Value:
    """Practical salinity PSS-78 from conductivity, temperature (ITS-90) and absolute pressure.

    Below 2 PSU the extension of Hill et al. (1986) is used, so that a pool and a river have an answer too.
    Valid for -2..35 degC, 0..10000 dbar of sea pressure and 0..42 PSU.
    Source: UNESCO (1983) technical paper 44, Fofonoff and Millard; Hill et al., doi:10.1109/JOE.1986.1145154.
    Check: 3.45487 S/m, 28.7856 degC, 10 dbar -> 20.00987 PSU.
    """
    pressure_dbar = not_below_zero(pressure_pa - surface_pressure_pa) / PA_PER_DBAR
    p = within("sea pressure", pressure_dbar, 0.0, 10_000.0, "dbar")
    t = within("temperature", temperature_degc, -2.0, 35.0, "degC") * T68_PER_T90
    ratio = within("conductivity", conductivity_s_per_m, 0.0, 10.0, "S/m") / CONDUCTIVITY_35_15_0_S_PER_M
    pressure_factor = 1 + p * (2.070e-5 + p * (-6.370e-10 + p * 3.989e-15)) / (
        1 + t * (3.426e-2 + t * 4.464e-4) + ratio * (4.215e-1 - 3.107e-3 * t)
    )
    temperature_factor = polynomial(t, 6.766097e-1, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9)
    salinity_psu = _salinity_of_ratio(ratio / (pressure_factor * temperature_factor), t)
    return within("salinity", salinity_psu, 0.0, 42.0, "PSU")


def _salinity_of_ratio(ratio_t: Value, t68_degc: Value) -> Value:
    """PSS-78 from the conductivity ratio at the same temperature, with Hill's correction below 2 PSU."""
    root = square_root(ratio_t)
    temperature_term = (t68_degc - 15) / (1 + 0.0162 * (t68_degc - 15))
    salinity_psu = polynomial(root, 0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081) + temperature_term * (
        polynomial(root, 0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144)
    )
    x, y = 400 * ratio_t, 100 * ratio_t
    correction = 0.0080 / (1 + 1.5 * x + x * x) + 0.0005 * temperature_term / (1 + square_root(y) * (1 + y))
    corrected = not_below_zero(salinity_psu - correction)
    if isinstance(salinity_psu, np.ndarray):
        return np.where(salinity_psu >= _HILL_BELOW_PSU, salinity_psu, corrected)
    return salinity_psu if salinity_psu >= _HILL_BELOW_PSU else corrected
