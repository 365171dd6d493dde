#include "brov/seawater.h"

#include <math.h>

namespace brov {

namespace {

constexpr double kStandardConductivitySPerM = 4.2914;  // C(35, 15 degC, 0 dbar), Culkin and Smith (1980)
constexpr double kT68PerT90 = 1.00024;                 // PSS-78 is defined on IPTS-68

}  // namespace

double practical_salinity_psu(double conductivity_s_per_m, double temperature_degc, double sea_pressure_dbar) {
  const double t = temperature_degc * kT68PerT90;
  const double p = sea_pressure_dbar;
  const double ratio = conductivity_s_per_m / kStandardConductivitySPerM;

  double pressure_part = 3.989e-15;
  pressure_part = pressure_part * p + -6.370e-10;
  pressure_part = pressure_part * p + 2.070e-5;
  pressure_part = pressure_part * p;
  double temperature_part = 4.464e-4;
  temperature_part = temperature_part * t + 3.426e-2;
  temperature_part = temperature_part * t + 1.0;
  const double slope = -3.107e-3 * t + 4.215e-1;
  const double pressure_ratio = 1.0 + pressure_part / (temperature_part + slope * ratio);

  double temperature_ratio = 1.0031e-9;
  temperature_ratio = temperature_ratio * t + -6.9698e-7;
  temperature_ratio = temperature_ratio * t + 1.104259e-4;
  temperature_ratio = temperature_ratio * t + 2.00564e-2;
  temperature_ratio = temperature_ratio * t + 6.766097e-1;

  const double x = sqrt(ratio / (pressure_ratio * temperature_ratio));
  double at_15 = 2.7081;
  at_15 = at_15 * x + -7.0261;
  at_15 = at_15 * x + 14.0941;
  at_15 = at_15 * x + 25.3851;
  at_15 = at_15 * x + -0.1692;
  at_15 = at_15 * x + 0.0080;
  double off_15 = -0.0144;
  off_15 = off_15 * x + 0.0636;
  off_15 = off_15 * x + -0.0375;
  off_15 = off_15 * x + -0.0066;
  off_15 = off_15 * x + -0.0056;
  off_15 = off_15 * x + 0.0005;
  const double from_15 = t - 15.0;
  return at_15 + from_15 / (1.0 + 0.0162 * from_15) * off_15;
}

bool mackenzie_sound_speed_mps(double temperature_degc, double salinity_psu, double depth_m, double& speed_mps) {
  if (!(temperature_degc >= -2.0 && temperature_degc <= 30.0 && salinity_psu >= 30.0 && salinity_psu <= 40.0 &&
        depth_m >= 0.0 && depth_m <= 8000.0)) {
    return false;
  }
  const double t = temperature_degc;
  const double s = salinity_psu - 35.0;
  const double d = depth_m;
  double speed = 2.374e-4;
  speed = speed * t + -5.304e-2;
  speed = speed * t + 4.591;
  speed = speed * t + 1448.96;
  speed = speed + 1.340 * s;
  speed = speed + 1.630e-2 * d;
  speed = speed + 1.675e-7 * d * d;
  speed = speed - 1.025e-2 * t * s;
  speed_mps = speed - 7.139e-13 * t * d * d * d;
  return true;
}

}  // namespace brov
