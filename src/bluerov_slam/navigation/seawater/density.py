"""Density of sea and fresh water under pressure."""

from __future__ import annotations

from bluerov_slam.navigation.seawater.validity import (
    PA_PER_BAR,
    T68_PER_T90,
    Value,
    not_below_zero,
    polynomial,
    square_root,
    within,
)


def density_kg_per_m3(temperature_degc: Value, salinity_psu: Value, sea_pressure_pa: Value) -> Value:
    """Density by the International Equation of State of Seawater 1980, kg/m3; fresh water included.

    `temperature_degc` is ITS-90, `sea_pressure_pa` above the atmosphere's. Valid for -2..40 degC, 0..42 PSU and
    0..1000 bar. A sensor's noise above the surface counts as the surface.
    Source: UNESCO (1981) technical paper 38; Fofonoff and Millard (1983), UNESCO technical paper 44.
    Check: 25 degC (IPTS-68), 35 PSU, 1000 bar -> 1062.53817 kg/m3.
    """
    t = within("temperature", temperature_degc, -2.0, 40.0, "degC") * T68_PER_T90
    s = within("salinity", salinity_psu, 0.0, 42.0, "PSU")
    p = within("sea pressure", not_below_zero(sea_pressure_pa) / PA_PER_BAR, 0.0, 1000.0, "bar")
    root = square_root(s)
    return _surface_density(t, s, root) / (1 - p / _bulk_modulus_bar(t, s, root, p))


def _surface_density(t: Value, s: Value, root: Value) -> Value:
    """Density at atmospheric pressure, kg/m3."""
    pure_water = polynomial(t, 999.842594, 6.793952e-2, -9.095290e-3, 1.001685e-4, -1.120083e-6, 6.536332e-9)
    linear = polynomial(t, 8.24493e-1, -4.0899e-3, 7.6438e-5, -8.2467e-7, 5.3875e-9)
    power_3_2 = polynomial(t, -5.72466e-3, 1.0227e-4, -1.6546e-6)
    return pure_water + s * (linear + power_3_2 * root + 4.8314e-4 * s)


def _bulk_modulus_bar(t: Value, s: Value, root: Value, p: Value) -> Value:
    """Secant bulk modulus, bar."""
    constant = polynomial(t, 19652.21, 148.4206, -2.327105, 1.360477e-2, -5.155288e-5) + s * (
        polynomial(t, 54.6746, -0.603459, 1.09987e-2, -6.1670e-5)
        + polynomial(t, 7.944e-2, 1.6483e-2, -5.3009e-4) * root
    )
    linear = polynomial(t, 3.239908, 1.43713e-3, 1.16092e-4, -5.77905e-7) + s * (
        polynomial(t, 2.2838e-3, -1.0981e-5, -1.6078e-6) + 1.91075e-4 * root
    )
    square = polynomial(t, 8.50935e-5, -6.12293e-6, 5.2787e-8) + s * polynomial(t, -9.9348e-7, 2.0816e-8, 9.1697e-10)
    return polynomial(p, constant, linear, square)
