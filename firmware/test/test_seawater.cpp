#include <doctest/doctest.h>

#include "brov/seawater.h"

using namespace brov;

namespace {

constexpr double kT90PerT68 = 1.0 / 1.00024;

double salinity_of_ratio(double ratio, double t68_degc, double sea_pressure_dbar) {
  return practical_salinity_psu(ratio * 4.2914, t68_degc * kT90PerT68, sea_pressure_dbar);
}

}  // namespace

TEST_CASE("practical salinity at the check values of Unesco technical paper 44") {
  CHECK(salinity_of_ratio(1.0, 15.0, 0.0) == doctest::Approx(35.0).epsilon(1e-7));
  CHECK(salinity_of_ratio(1.2, 20.0, 2000.0) == doctest::Approx(37.245628).epsilon(2e-8));
  CHECK(salinity_of_ratio(0.65, 5.0, 1500.0) == doctest::Approx(27.995347).epsilon(2e-8));
  CHECK(salinity_of_ratio(1.888091, 40.0, 10000.0) == doctest::Approx(40.0).epsilon(2e-6));
}

TEST_CASE("no conductivity is no salinity") { CHECK(practical_salinity_psu(0.0, 15.0, 0.0) <= 0.01); }

TEST_CASE("sound speed at the check values of Mackenzie 1981") {
  double speed_mps = 0.0;
  REQUIRE(mackenzie_sound_speed_mps(25.0, 35.0, 1000.0, speed_mps));
  CHECK(speed_mps == doctest::Approx(1550.744).epsilon(1e-7));
  REQUIRE(mackenzie_sound_speed_mps(10.0, 35.0, 1000.0, speed_mps));
  CHECK(speed_mps == doctest::Approx(1506.26).epsilon(1e-5));
}

TEST_CASE("no sound speed outside the range of the formula") {
  double speed_mps = -1.0;
  CHECK_FALSE(mackenzie_sound_speed_mps(-2.1, 35.0, 10.0, speed_mps));
  CHECK_FALSE(mackenzie_sound_speed_mps(30.1, 35.0, 10.0, speed_mps));
  CHECK_FALSE(mackenzie_sound_speed_mps(10.0, 29.9, 10.0, speed_mps));
  CHECK_FALSE(mackenzie_sound_speed_mps(10.0, 40.1, 10.0, speed_mps));
  CHECK_FALSE(mackenzie_sound_speed_mps(10.0, 35.0, -0.1, speed_mps));
  CHECK_FALSE(mackenzie_sound_speed_mps(10.0, 35.0, 8000.1, speed_mps));
  CHECK(speed_mps == -1.0);
}
