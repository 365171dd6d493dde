#include <doctest/doctest.h>

#include "brov/sensors.h"
#include "native/fixed_readings.h"
#include "rig.h"

using namespace brov;

namespace {

struct Bus final : private I2cModels::Listener {
  Bus() {
    for (std::size_t i = 0; i < 8; ++i) {
      models.ms5837().set_prom_word(i, static_cast<std::uint16_t>(0x1200 + i));
      models.tsys01().set_prom_word(i, static_cast<std::uint16_t>(0x3400 + i));
    }
    models.ms5837().set_value(0, 4958179);
    models.ms5837().set_value(1, 6815414);
    models.tsys01().set_value(0, 9378708);
  }

  bool command(std::uint8_t address, std::uint8_t code, std::uint64_t now_us) {
    models.set_time(now_us);
    return models.write(address, Bytes(&code, 1));
  }
  std::uint32_t number(std::uint8_t address, std::size_t bytes) {
    std::uint8_t raw[4] = {};
    REQUIRE(models.read(address, raw, bytes));
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < bytes; ++i) value = value << 8 | raw[i];
    return value;
  }
  std::uint32_t adc(std::uint8_t address, std::uint64_t now_us) {
    REQUIRE(command(address, 0x00, now_us));
    return number(address, 3);
  }

  I2cModels models{*this};
  int recoveries = 0;

 private:
  void i2c_recovered() override { ++recoveries; }
};

constexpr std::uint8_t kDepth = kMs5837Address, kCelsius = kTsys01Address;

}  // namespace

TEST_CASE("PROM words come one by one, and 0 where there is none") {
  Bus bus;
  for (std::uint8_t i = 0; i < 8; ++i) {
    REQUIRE(bus.command(kDepth, static_cast<std::uint8_t>(0xA0 + 2 * i), 0));
    CHECK(bus.number(kDepth, 2) == (i < 7 ? 0x1200u + i : 0u));
    REQUIRE(bus.command(kCelsius, static_cast<std::uint8_t>(0xA0 + 2 * i), 0));
    CHECK(bus.number(kCelsius, 2) == 0x3400u + i);
  }
}

TEST_CASE("A conversion gives its result when its time has passed, once") {
  Bus bus;
  CHECK(bus.adc(kDepth, 0) == 0);
  bus.command(kDepth, 0x4A, 1000);
  CHECK(bus.adc(kDepth, 1000 + 18080) == 4958179);
  CHECK(bus.adc(kDepth, 30000) == 0);
  bus.command(kDepth, 0x5A, 40000);
  CHECK(bus.adc(kDepth, 60000) == 6815414);
  bus.command(kCelsius, 0x48, 70000);
  CHECK(bus.adc(kCelsius, 70000 + 9040) == 9378708);
}

TEST_CASE("Asked too early a device answers 0, and the conversion is spoilt") {
  Bus bus;
  bus.command(kDepth, 0x4A, 0);
  CHECK(bus.adc(kDepth, 18079) == 0);
  CHECK(bus.adc(kDepth, 40000) == 0);
  bus.command(kCelsius, 0x48, 0);
  CHECK(bus.adc(kCelsius, 9039) == 0);
}

TEST_CASE("A reset forgets the conversion, an unknown command selects nothing") {
  Bus bus;
  bus.command(kDepth, 0x4A, 0);
  bus.command(kDepth, 0x1E, 1000);
  CHECK(bus.adc(kDepth, 30000) == 0);
  bus.command(kDepth, 0xA2, 30000);
  bus.command(kDepth, 0x77, 30000);
  CHECK(bus.number(kDepth, 2) == 0);
}

TEST_CASE("Who is silent or on a bus held low acknowledges nothing and keeps its state") {
  struct Case {
    BusState state;
    bool depth, celsius;
  };
  const Case cases[] = {{BusState::kFine, true, true},
                        {BusState::kMs5837Silent, false, true},
                        {BusState::kTsys01Silent, true, false},
                        {BusState::kBothSilent, false, false},
                        {BusState::kHeldLow, false, false}};
  for (const Case& c : cases) {
    Bus bus;
    bus.command(kDepth, 0x4A, 0);
    bus.models.set_state(c.state);
    CHECK(bus.command(kDepth, 0x1E, 1000) == c.depth);
    CHECK(bus.command(kCelsius, 0x1E, 1000) == c.celsius);
    std::uint8_t byte;
    CHECK(bus.models.read(kDepth, &byte, 1) == c.depth);
    CHECK(!bus.command(0x50, 0x00, 1000));
    bus.models.set_state(BusState::kFine);
    CHECK(bus.adc(kDepth, 30000) == (c.depth ? 0u : 4958179u));  // the reset reached it or not
  }
}

TEST_CASE("The board reads both devices: what they hold stands in SENSORS") {
  Rig rig;
  set_fixed_readings(rig.hal.models, 300000.0, 12.34);
  rig.run_until(1200000);
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 3);
  const std::uint8_t* last = sensors.back().payload.data();
  CHECK(last[51] == 1);
  CHECK(last[54] == 1);
  const auto full_pressure_pa = static_cast<int>(get_u32(last + 44) & 0xFFFFFF);
  CHECK(std::abs(full_pressure_pa - 300000) <= 2);
  CHECK(get_u16(last + 47) == 30000);
  CHECK(std::abs(static_cast<std::int16_t>(get_u16(last + 49)) - 1234) <= 1);
  CHECK(std::abs(static_cast<std::int16_t>(get_u16(last + 52)) - 1234) <= 1);
  CHECK(get_u16(last + 57) == 1977);  // (300000 - 101325) / (1025 * 9.80665) = 19.7651 m
  CHECK(rig.ask_status().i2c_errors == 0);
}

TEST_CASE("A bus held low is recovered once a second, counted, and the readings come back by themselves") {
  Rig rig;
  set_fixed_readings(rig.hal.models, 200000.0, 8.0);
  rig.run_until(2000000);
  CHECK(rig.hal.i2c_recoveries == 0);
  rig.hal.models.set_state(BusState::kHeldLow);
  rig.run_until(12000000);
  CHECK(rig.hal.i2c_recoveries >= 5);
  CHECK(rig.hal.i2c_recoveries <= 10);
  CHECK(rig.ask_status().i2c_errors > 10);
  CHECK(rig.sent(0x01).back().payload[51] == 0);
  CHECK(rig.sent(0x01).back().payload[54] == 0);
  rig.hal.models.set_state(BusState::kFine);
  const auto errors = rig.ask_status().i2c_errors;
  rig.run_until(15000000);
  CHECK(rig.sent(0x01).back().payload[51] == 1);
  CHECK(rig.sent(0x01).back().payload[54] == 1);
  CHECK(rig.ask_status().i2c_errors == errors);
}

TEST_CASE("Fixed readings need no more than what is measured: temperature alone leaves the depth sensor silent") {
  Rig rig;
  set_fixed_readings(rig.hal.models, std::nullopt, 20.0);
  rig.run_until(1200000);
  CHECK(rig.sent(0x01).back().payload[51] == 0);
  CHECK(rig.sent(0x01).back().payload[54] == 1);
}
