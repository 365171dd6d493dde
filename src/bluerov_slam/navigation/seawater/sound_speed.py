"""Sound speed in water by the published formulas. Temperatures are ITS-90, pressures above the atmosphere's."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater.depth import depth_m
from bluerov_slam.navigation.seawater.validity import (
    PA_PER_BAR,
    Value,
    not_below_zero,
    polynomial,
    square_root,
    within,
)

_PA_PER_KG_PER_CM2 = 98_066.5


class SoundSpeedFormula(StrEnum):
    """Formulas that answer for temperature, salinity and pressure."""

    MACKENZIE = "mackenzie"
    UNESCO = "unesco"
    DEL_GROSSO = "del_grosso"


def mackenzie_sound_speed_mps(temperature_degc: Value, salinity_psu: Value, depth_m: Value) -> Value:
    """Sound speed in sea water by Mackenzie's nine terms, m/s.

    Valid for -2..30 degC, 30..40 PSU, 0..8000 m (so not for a fresh-water pool).
    Source: Mackenzie (1981), doi:10.1121/1.386920. Check: 25 degC, 35 PSU, 1000 m -> 1550.744 m/s.
    """
    t = within("temperature", temperature_degc, -2.0, 30.0, "degC")
    s = within("salinity", salinity_psu, 30.0, 40.0, "PSU") - 35.0
    d = within("depth", depth_m, 0.0, 8000.0, "m")
    return (
        polynomial(t, 1448.96, 4.591, -5.304e-2, 2.374e-4)
        + 1.340 * s
        + 1.630e-2 * d
        + 1.675e-7 * d * d
        - 1.025e-2 * t * s
        - 7.139e-13 * t * d * d * d
    )


def unesco_sound_speed_mps(temperature_degc: Value, salinity_psu: Value, sea_pressure_pa: Value) -> Value:
    """Sound speed by the UNESCO equation with the ITS-90 coefficients of Wong and Zhu, m/s; fresh water included.

    Valid for 0..40 degC, 0..40 PSU, 0..1000 bar.
    Source: Chen and Millero (1977), doi:10.1121/1.381646; Wong and Zhu (1995), doi:10.1121/1.413048.
    Check: 39.9904 degC (40 on IPTS-68), 40 PSU, 10000 dbar -> 1731.995 m/s.
    """
    t = within("temperature", temperature_degc, 0.0, 40.0, "degC")
    s = within("salinity", salinity_psu, 0.0, 40.0, "PSU")
    p = within("sea pressure", sea_pressure_pa / PA_PER_BAR, 0.0, 1000.0, "bar")
    pure_water = polynomial(
        p,
        polynomial(t, 1402.388, 5.03830, -5.81090e-2, 3.3432e-4, -1.47797e-6, 3.1419e-9),
        polynomial(t, 0.153563, 6.8999e-4, -8.1829e-6, 1.3632e-7, -6.1260e-10),
        polynomial(t, 3.1260e-5, -1.7111e-6, 2.5986e-8, -2.5353e-10, 1.0415e-12),
        polynomial(t, -9.7729e-9, 3.8513e-10, -2.3654e-12),
    )
    linear = polynomial(
        p,
        polynomial(t, 1.389, -1.262e-2, 7.166e-5, 2.008e-6, -3.21e-8),
        polynomial(t, 9.4742e-5, -1.2583e-5, -6.4928e-8, 1.0515e-8, -2.0142e-10),
        polynomial(t, -3.9064e-7, 9.1061e-9, -1.6009e-10, 7.994e-12),
        polynomial(t, 1.100e-10, 6.651e-12, -3.391e-13),
    )
    power_3_2 = -1.922e-2 - 4.42e-5 * t + (7.3637e-5 + 1.7950e-7 * t) * p
    square = 1.727e-3 - 7.9836e-6 * p
    return pure_water + linear * s + power_3_2 * s * square_root(s) + square * s * s


def del_grosso_sound_speed_mps(temperature_degc: Value, salinity_psu: Value, sea_pressure_pa: Value) -> Value:
    """Sound speed by Del Grosso's equation with the ITS-90 coefficients of Wong and Zhu, m/s.

    Nearer to the truth in the deep sea than the UNESCO equation: Meinen and Watts (1997).
    Valid for 0..30 degC, 30..40 PSU, 0..1000 kg/cm2; standard error 0.05 m/s.
    Source: Del Grosso (1974), doi:10.1121/1.1903388; Wong and Zhu (1995), doi:10.1121/1.413048.
    Check: 5 degC, 35 PSU, 100 kPa -> 1470.807 m/s.
    """
    t = within("temperature", temperature_degc, 0.0, 30.0, "degC")
    s = within("salinity", salinity_psu, 30.0, 40.0, "PSU")
    p = within("sea pressure", sea_pressure_pa / _PA_PER_KG_PER_CM2, 0.0, 1000.0, "kg/cm2")
    with_pressure = polynomial(
        p,
        6.353509e-3 - 3.406824e-4 * s + 4.857614e-6 * s * s - 4.383615e-7 * t * t,
        -1.593895e-6 + 2.656174e-8 * t,
        5.222483e-10 + 0.0 * t,
    )
    return (
        polynomial(t, 1402.392, 5.012285, -5.51184e-2, 2.21649e-4)
        + polynomial(s, 0.0, 1.329530, 1.288598e-4)
        + polynomial(p, 0.0, 1.560592e-1, 2.449993e-5, -8.833959e-9)
        + s * t * (-1.275936e-2 + 9.688441e-5 * t)
        + t * p * with_pressure
        - 1.616745e-9 * s * s * p * p
    )


def marczak_sound_speed_mps(temperature_degc: Value) -> Value:
    """Sound speed in fresh (pure) water at atmospheric pressure, m/s.

    A pool or a tank; each 10 m of depth add 0.16 m/s, and the UNESCO equation at 0 PSU knows them.
    Valid for 0..95 degC. Source: Marczak (1997), doi:10.1121/1.420332.
    Check: 20 degC -> 1482.380 m/s (Del Grosso and Mader, 1972: 1482.34).
    """
    t = within("temperature", temperature_degc, 0.0, 95.0, "degC")
    return polynomial(t, 1402.385, 5.038813, -5.799136e-2, 3.287156e-4, -1.398845e-6, 2.787860e-9)


def sound_speed_by_mps(
    formula: SoundSpeedFormula, temperature_degc: Value, salinity_psu: Value, sea_pressure_pa: Value
) -> Value:
    """Sound speed by a chosen formula, m/s; a sensor's noise above the surface counts as the surface."""
    pressure_pa = not_below_zero(sea_pressure_pa)
    if formula is SoundSpeedFormula.UNESCO:
        return unesco_sound_speed_mps(temperature_degc, salinity_psu, pressure_pa)
    if formula is SoundSpeedFormula.DEL_GROSSO:
        return del_grosso_sound_speed_mps(temperature_degc, salinity_psu, pressure_pa)
    return mackenzie_sound_speed_mps(temperature_degc, salinity_psu, depth_m(pressure_pa, 0.0))


def sound_speed_mps(temperature_degc: Value, salinity_psu: Value, sea_pressure_pa: Value) -> Value:
    """Mackenzie where it is valid (as the firmware computes it), else UNESCO; unavailable where neither is."""
    arguments = (temperature_degc, salinity_psu, sea_pressure_pa)
    try:
        first = sound_speed_by_mps(SoundSpeedFormula.MACKENZIE, *arguments)
    except OutOfValidityError:
        return sound_speed_by_mps(SoundSpeedFormula.UNESCO, *arguments)
    if isinstance(first, np.ndarray):
        return np.where(np.isnan(first), sound_speed_by_mps(SoundSpeedFormula.UNESCO, *arguments), first)
    return first
