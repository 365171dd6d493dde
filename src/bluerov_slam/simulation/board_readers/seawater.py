"""Salinity and sound speed as the board computes them: operation by operation those of `seawater.cpp`."""

from __future__ import annotations

import math

SURFACE_PRESSURE_PA = 101_325.0
DENSITY_KG_PER_M3 = 1025.0
GRAVITY_MPS2 = 9.80665

_STANDARD_CONDUCTIVITY_S_PER_M = 4.2914
_T68_PER_T90 = 1.00024


def practical_salinity_psu(conductivity_s_per_m: float, temperature_degc: float, sea_pressure_dbar: float) -> float:
    """PSS-78 for ITS-90 temperatures, without range check.

    Source: Fofonoff and Millard (1983), Unesco technical papers in marine science 44.
    """
    t = temperature_degc * _T68_PER_T90
    p = sea_pressure_dbar
    ratio = conductivity_s_per_m / _STANDARD_CONDUCTIVITY_S_PER_M

    pressure_part = 3.989e-15
    pressure_part = pressure_part * p + -6.370e-10
    pressure_part = pressure_part * p + 2.070e-5
    pressure_part = pressure_part * p
    temperature_part = 4.464e-4
    temperature_part = temperature_part * t + 3.426e-2
    temperature_part = temperature_part * t + 1.0
    slope = -3.107e-3 * t + 4.215e-1
    pressure_ratio = 1.0 + pressure_part / (temperature_part + slope * ratio)

    temperature_ratio = 1.0031e-9
    temperature_ratio = temperature_ratio * t + -6.9698e-7
    temperature_ratio = temperature_ratio * t + 1.104259e-4
    temperature_ratio = temperature_ratio * t + 2.00564e-2
    temperature_ratio = temperature_ratio * t + 6.766097e-1

    x = math.sqrt(ratio / (pressure_ratio * temperature_ratio))
    at_15 = 2.7081
    at_15 = at_15 * x + -7.0261
    at_15 = at_15 * x + 14.0941
    at_15 = at_15 * x + 25.3851
    at_15 = at_15 * x + -0.1692
    at_15 = at_15 * x + 0.0080
    off_15 = -0.0144
    off_15 = off_15 * x + 0.0636
    off_15 = off_15 * x + -0.0375
    off_15 = off_15 * x + -0.0066
    off_15 = off_15 * x + -0.0056
    off_15 = off_15 * x + 0.0005
    from_15 = t - 15.0
    return at_15 + from_15 / (1.0 + 0.0162 * from_15) * off_15


def mackenzie_sound_speed_mps(temperature_degc: float, salinity_psu: float, depth_m: float) -> float | None:
    """Mackenzie (1981); None outside -2..30 degC, 30..40 PSU, 0..8000 m. Check: 25 degC, 35 PSU, 1000 m -> 1550.744."""
    if not (-2.0 <= temperature_degc <= 30.0 and 30.0 <= salinity_psu <= 40.0 and 0.0 <= depth_m <= 8000.0):
        return None
    t = temperature_degc
    s = salinity_psu - 35.0
    d = depth_m
    speed = 2.374e-4
    speed = speed * t + -5.304e-2
    speed = speed * t + 4.591
    speed = speed * t + 1448.96
    speed = speed + 1.340 * s
    speed = speed + 1.630e-2 * d
    speed = speed + 1.675e-7 * d * d
    speed = speed - 1.025e-2 * t * s
    return speed - 7.139e-13 * t * d * d * d
