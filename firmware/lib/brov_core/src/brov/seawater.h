// Salinity and sound speed on board, in double. The order of operations is part of the contract: Python does the same.
// Build with -ffp-contract=off.
#pragma once

namespace brov {

constexpr double kSurfacePressurePa = 101325.0;
constexpr double kDensityKgPerM3 = 1025.0;  // svp_depth of the wire is defined with this one
constexpr double kGravityMps2 = 9.80665;

// PSS-78, for conductivity in S/m (of sea water, not a ratio), ITS-90 temperature, sea pressure in dbar. No range check.
// Source: Fofonoff and Millard (1983), Unesco technical papers in marine science 44.
// Check: ratio 1.2 at 20 degC (IPTS-68) and 2000 dbar -> 37.245628.
double practical_salinity_psu(double conductivity_s_per_m, double temperature_degc, double sea_pressure_dbar);

// Mackenzie (1981). Check: 25 degC, 35 PSU, 1000 m -> 1550.744 m/s. False outside -2..30 degC, 30..40 PSU, 0..8000 m.
bool mackenzie_sound_speed_mps(double temperature_degc, double salinity_psu, double depth_m, double& speed_mps);

}  // namespace brov
