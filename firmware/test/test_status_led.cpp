// What the lamp says.
#include <doctest/doctest.h>

#include "esp32_rig.h"
#include "native/fixed_readings.h"
#include "src/pins.h"
#include "src/status_led.h"

namespace {

// Flashes of a whole period.
int flashes(brov::LedPattern pattern) {
  int count = 0;
  bool lit = false;
  for (std::uint32_t at_us = 0; at_us < brov::kLedPeriodUs;) {
    const brov::LedMoment moment = brov::led_moment(pattern, at_us);
    REQUIRE(moment.until_us > at_us);
    if (moment.lit && !lit) ++count;
    lit = moment.lit;
    at_us = moment.until_us;
  }
  return count;
}

int flashes(fake::Machine& machine, std::uint64_t from_us, std::uint64_t until_us) {
  int count = 0;
  for (const auto& edge : machine.edges(brov::pins::kLed)) {
    if (edge.high && edge.at_us >= from_us && edge.at_us < until_us) ++count;
  }
  return count;
}

}  // namespace

TEST_CASE("As many flashes as the pattern's number") {
  using brov::LedPattern;
  CHECK(flashes(LedPattern::kAllWell) == 1);
  CHECK(flashes(LedPattern::kSonarSilent) == 2);
  CHECK(flashes(LedPattern::kI2cSilent) == 3);
  CHECK(flashes(LedPattern::kSerialSilent) == 4);
  CHECK(flashes(LedPattern::kRestarted) == 10);
  CHECK(brov::led_moment(LedPattern::kSteady, 700000).lit);
}

TEST_CASE("The lamp names the first thing that is missing") {
  fake::Flash flash;
  Esp32 esp32(flash);
  fake::Machine& machine = esp32.machine;
  int wanted = 0;
  SUBCASE("a sonar") { wanted = 2; }
  SUBCASE("the I2C sensors") { wanted = 3; }
  SUBCASE("the serial ones") { wanted = 4; }
  feed_pings(machine.uart(1), 200, 2, 300000, 13);
  if (wanted > 2) feed_pings(machine.uart(2), 200, 2, 300000, 13);
  if (wanted > 3) brov::set_fixed_readings(machine.i2c(), 101325.0, 10.0);
  esp32.boot();
  esp32.run_until(12300000);
  CHECK(flashes(machine, 0, 4000000) == 1);  // steady at first
  CHECK(flashes(machine, 8250000, 12250000) == 2 * wanted);
}

TEST_CASE("A restart that nobody asked for blinks fast, and then no more") {
  fake::Flash flash;
  Esp32 esp32(flash, 6);
  esp32.boot();
  esp32.run_until(16300000);
  CHECK(flashes(esp32.machine, 300000, 8300000) == doctest::Approx(40).epsilon(0.03));
  CHECK(flashes(esp32.machine, 12250000, 16250000) == 4);
}
