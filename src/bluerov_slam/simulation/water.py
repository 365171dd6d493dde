"""Sea water of the simulated world: a profile of temperature and salinity, and what a sensor would read in it.

The conductivity needed for a wanted salinity comes from inverting PSS-78 numerically, so the simulator does not
share a formula's mistakes with the code that turns conductivity back into salinity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STANDARD_CONDUCTIVITY_S_PER_M = 4.2914  # C(35, 15 degC, 0 dbar), Culkin & Smith (1980)
GRAVITY_MPS2 = 9.80665
SURFACE_PRESSURE_PA = 101325.0
_PA_PER_DBAR = 1.0e4

_SALINITY_A = (0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081)
_SALINITY_B = (0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144)
_RATIO_C = (0.6766097, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9)
_PRESSURE_E = (2.070e-5, -6.370e-10, 3.989e-15)
_PRESSURE_D = (3.426e-2, 4.464e-4, 4.215e-1, -3.107e-3)


@dataclass(frozen=True, slots=True)
class WaterProfile:
    """Two layers joined by a thermocline; the defaults are a temperate coast in summer.

    `density_kg_per_m3` is that of the upper layer, `density_step_kg_per_m3` how much more the lower one has.
    """

    surface_temperature_degc: float = 17.6
    bottom_temperature_degc: float = 12.4
    surface_salinity_psu: float = 34.6
    bottom_salinity_psu: float = 35.3
    thermocline_depth_m: float = 5.0
    thermocline_thickness_m: float = 1.2
    density_kg_per_m3: float = 1025.0
    density_step_kg_per_m3: float = 1.4

    def temperature_degc(self, depth_m: float) -> float:
        """Temperature at a depth."""
        return self._mix(self.surface_temperature_degc, self.bottom_temperature_degc, depth_m)

    def salinity_psu(self, depth_m: float) -> float:
        """Practical salinity at a depth."""
        return self._mix(self.surface_salinity_psu, self.bottom_salinity_psu, depth_m)

    def pressure_pa(self, depth_m: float, gravity_mps2: float = GRAVITY_MPS2) -> float:
        """Absolute pressure at a depth: the weight of both layers above it, and of the air."""
        depth_m = max(0.0, depth_m)
        middle_m, width_m = self.thermocline_depth_m, self.thermocline_thickness_m
        # The integral of (1 + tanh((z - middle) / width)) / 2 from the surface down.
        lower_m = 0.5 * depth_m + 0.5 * width_m * (
            _log_cosh((depth_m - middle_m) / width_m) - _log_cosh(middle_m / width_m)
        )
        mass_per_m2 = self.density_kg_per_m3 * depth_m + self.density_step_kg_per_m3 * lower_m
        return SURFACE_PRESSURE_PA + mass_per_m2 * gravity_mps2

    def conductivity_s_per_m(self, depth_m: float) -> float:
        """Conductivity at a depth."""
        sea_pressure_dbar = (self.pressure_pa(depth_m) - SURFACE_PRESSURE_PA) / _PA_PER_DBAR
        return conductivity_s_per_m(self.salinity_psu(depth_m), self.temperature_degc(depth_m), sea_pressure_dbar)

    def _mix(self, above: float, below: float, depth_m: float) -> float:
        share = 0.5 * (1.0 + math.tanh((depth_m - self.thermocline_depth_m) / self.thermocline_thickness_m))
        return above + (below - above) * share


def practical_salinity_psu(conductivity_s_per_m: float, temperature_degc: float, sea_pressure_dbar: float) -> float:
    """Practical salinity PSS-78. Source: Fofonoff & Millard (1983), Unesco technical papers in marine science 44.

    Check: ratio 1.2 at 20 degC and 2000 dbar gives 37.245628.
    """
    t = temperature_degc
    p = sea_pressure_dbar
    ratio = conductivity_s_per_m / STANDARD_CONDUCTIVITY_S_PER_M
    d1, d2, d3, d4 = _PRESSURE_D
    pressure_term = _polynomial(_PRESSURE_E, p) * p / (1.0 + d1 * t + d2 * t * t + (d3 + d4 * t) * ratio)
    root = math.sqrt(max(0.0, ratio / ((1.0 + pressure_term) * _polynomial(_RATIO_C, t))))
    correction = (t - 15.0) / (1.0 + 0.0162 * (t - 15.0))
    return _polynomial(_SALINITY_A, root) + correction * _polynomial(_SALINITY_B, root)


def conductivity_s_per_m(salinity_psu: float, temperature_degc: float, sea_pressure_dbar: float) -> float:
    """The conductivity that PSS-78 turns into this salinity, by bisection to better than 1e-7 S/m."""
    low, high = 0.0, 12.0
    while high - low > 1.0e-7:
        middle = 0.5 * (low + high)
        if practical_salinity_psu(middle, temperature_degc, sea_pressure_dbar) < salinity_psu:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def sound_speed_mps(temperature_degc: float, salinity_psu: float, depth_m: float) -> float:
    """Sound speed as the firmware computes it. Source: Mackenzie (1981), doi:10.1121/1.386920.

    Check: 10 degC, 35 PSU, 1000 m gives 1506.26 m/s.
    """
    t, s, d = temperature_degc, salinity_psu - 35.0, depth_m
    temperature_part = 1448.96 + 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3
    return temperature_part + 1.340 * s + 1.630e-2 * d + 1.675e-7 * d**2 - 1.025e-2 * t * s - 7.139e-13 * t * d**3


def _log_cosh(x: float) -> float:
    """Without overflow far from zero."""
    return abs(x) + math.log1p(math.exp(-2.0 * abs(x))) - math.log(2.0)


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value
