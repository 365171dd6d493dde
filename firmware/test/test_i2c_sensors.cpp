#include <cmath>

#include <doctest/doctest.h>

#include "reader_rig.h"

using namespace brov;

namespace {

constexpr std::uint8_t kDepth = 0x76, kCelsius = 0x77;
constexpr std::uint64_t kMs = 1000;
// C1..C6 and the two conversions of the MS5837-30BA datasheet's example; word 0 with the CRC that belongs to them.
constexpr std::uint16_t kDepthProm[7] = {0x3A2D, 34982, 36352, 20328, 22354, 26646, 26146};
constexpr std::uint32_t kD1 = 4958179, kD2 = 6815414;
// k4..k0 of the TSYS01 datasheet's example, then a serial number and the checksum that belongs to them.
constexpr std::uint16_t kCelsiusProm[8] = {0, 28446, 24926, 36016, 32791, 40781, 0x1A2B, 0x3C74};
constexpr std::uint32_t kAdc = 9378708;

// Both sensors on one bus, ticked every millisecond. The MS5837 answers D1 or D2, whichever was converted last.
struct Rig {
  Rig() {
    for (std::size_t i = 0; i < 7; ++i) {
      bus.set_word(kDepth, i, kDepthProm[i]);
    }
    for (std::size_t i = 0; i < 8; ++i) {
      bus.set_word(kCelsius, i, kCelsiusProm[i]);
    }
    bus.set_adc(kCelsius, kAdc);
    depth.start(0);
    celsius.start(0);
  }
  void run(std::uint64_t until_us, bool with_depth = true, bool with_celsius = true) {
    for (; now_us <= until_us; now_us += kMs) {
      if (with_depth) {
        depth.tick(now_us, counted);
        for (; seen < bus.commands.size(); ++seen) {
          if (bus.commands[seen] == 0x4A || bus.commands[seen] == 0x5A) {
            bus.set_adc(kDepth, bus.commands[seen] == 0x4A ? d1 : d2);
          }
        }
      }
      if (with_celsius) {
        celsius.tick(now_us, counted);
      }
    }
  }
  SensorFields fields() const {
    SensorFields fields;
    depth.fill(fields, now_us);
    celsius.fill(fields, now_us);
    return fields;
  }

  std::uint64_t now_us = kMs;
  std::uint32_t d1 = kD1, d2 = kD2;
  std::size_t seen = 0;
  FakeBus bus;
  CountedBus counted{bus};
  Ms5837 depth;
  Tsys01 celsius;
};

}  // namespace

TEST_CASE("the MS5837-30BA datasheet's example") {
  const Ms5837Result result = ms5837_compute(kDepthProm, kD1, kD2);
  CHECK(result.pressure_pa / 10 == 39998);  // 3999.8 mbar
  CHECK(result.temperature_cdegc == 1981);
}

// The datasheet's formulas in floating point, with its whole hundredths of a degree; the integers may differ by their
// rounding only.
TEST_CASE("the second order of the MS5837 against its formulas, from the coldest to the hottest") {
  const std::uint16_t(&c)[7] = kDepthProm;
  for (std::uint32_t d2 = 4200000; d2 < 9200000; d2 += 9973) {
    for (const std::uint32_t d1 : {4000000u, 5000000u, 9000000u}) {
      const double dt = d2 - c[5] * 256.0;
      const double temp = std::floor(2000.0 + dt * c[6] / 8388608.0);
      double off = c[2] * 65536.0 + c[4] * dt / 128.0, sens = c[1] * 32768.0 + c[3] * dt / 256.0;
      double ti = 0.0;
      const double a = (temp - 2000.0) * (temp - 2000.0), b = (temp + 1500.0) * (temp + 1500.0);
      if (temp < 2000.0) {
        ti = 3.0 * dt * dt / 8589934592.0;
        off -= 3.0 * a / 2.0 + (temp < -1500.0 ? 7.0 * b : 0.0);
        sens -= 5.0 * a / 8.0 + (temp < -1500.0 ? 4.0 * b : 0.0);
      } else {
        ti = 2.0 * dt * dt / 137438953472.0;
        off -= a / 16.0;
      }
      const double pressure_pa = (d1 * sens / 2097152.0 - off) / 8192.0 * 10.0;
      const Ms5837Result result = ms5837_compute(c, d1, d2);
      CAPTURE(d1);
      CAPTURE(d2);
      CHECK(std::abs(static_cast<double>(result.pressure_pa) - pressure_pa) <= 1.1);
      CHECK(std::abs(result.temperature_cdegc - (temp - ti)) <= 1.0);
    }
  }
}

TEST_CASE("no conversion result overflows") {
  for (const std::uint16_t word : {std::uint16_t{0}, std::uint16_t{0xFFFF}}) {
    const std::uint16_t prom[7] = {word, word, word, word, word, word, word};
    for (const std::uint32_t d1 : {0u, 1u, 0xFFFFFFu}) {
      for (const std::uint32_t d2 : {0u, 1u, 0xFFFFFFu}) {
        CHECK(ms5837_compute(prom, d1, d2).pressure_pa < std::int64_t{1} << 40);
      }
    }
  }
}

TEST_CASE("CRC-4 at the example of application note AN520") {
  CHECK(ms58xx_crc4({0x3132, 0x3334, 0x3536, 0x3738, 0x3940, 0x4142, 0x4344, 0x4500}) == 0xB);
}

TEST_CASE("the MS5837's PROM is refused with any bit wrong, and when the bus gives only zeros") {
  CHECK(ms5837_prom_ok(kDepthProm));
  for (std::size_t word = 0; word < 7; ++word) {
    for (int bit = 0; bit < 16; ++bit) {
      std::uint16_t prom[7];
      std::copy(std::begin(kDepthProm), std::end(kDepthProm), prom);
      prom[word] = static_cast<std::uint16_t>(prom[word] ^ 1 << bit);
      CHECK_FALSE(ms5837_prom_ok(prom));
    }
  }
  CHECK_FALSE(ms5837_prom_ok({0, 0, 0, 0, 0, 0, 0}));
}

TEST_CASE("the TSYS01 datasheet's example") {
  // The datasheet rounds the reading to 16 bits first (36636) and gives 10.59 degC.
  CHECK(std::round(tsys01_temperature_degc(kCelsiusProm, 36636u * 256u) * 100.0) == 1059.0);
  CHECK(tsys01_temperature_degc(kCelsiusProm, kAdc) == doctest::Approx(10.582458).epsilon(1e-7));
}

TEST_CASE("the TSYS01's PROM is refused with any bit wrong, and when the bus gives only zeros") {
  CHECK(tsys01_prom_ok(kCelsiusProm));
  for (std::size_t word = 0; word < 8; ++word) {
    for (int bit = 0; bit < 16; ++bit) {
      std::uint16_t prom[8];
      std::copy(std::begin(kCelsiusProm), std::end(kCelsiusProm), prom);
      prom[word] = static_cast<std::uint16_t>(prom[word] ^ 1 << bit);
      CHECK_FALSE(tsys01_prom_ok(prom));
    }
  }
  CHECK_FALSE(tsys01_prom_ok({0, 0, 0, 0, 0, 0, 0, 0}));
}

TEST_CASE("the MS5837 step by step") {
  Rig rig;
  rig.run(9 * kMs, true, false);
  CHECK(rig.bus.commands.empty());
  rig.run(10 * kMs, true, false);
  CHECK(rig.bus.commands == Buffer{0x1E});
  rig.run(19 * kMs, true, false);
  CHECK(rig.bus.commands.size() == 1);
  rig.run(26 * kMs, true, false);
  CHECK(rig.bus.commands == Buffer{0x1E, 0xA0, 0xA2, 0xA4, 0xA6, 0xA8, 0xAA, 0xAC});
  rig.run(27 * kMs, true, false);
  CHECK(rig.bus.commands.back() == 0x4A);
  rig.run(46 * kMs, true, false);
  CHECK(rig.bus.commands.size() == 9);
  rig.run(47 * kMs, true, false);
  CHECK(rig.bus.commands.back() == 0x00);
  rig.run(48 * kMs, true, false);
  CHECK(rig.bus.commands.back() == 0x5A);
  CHECK_FALSE(rig.depth.ok(rig.now_us));
  rig.run(68 * kMs, true, false);
  CHECK(rig.bus.commands.back() == 0x00);
  CHECK(rig.depth.ok(rig.now_us));
  CHECK(rig.depth.pressure_pa() == 399984);
  rig.run(76 * kMs, true, false);
  CHECK(rig.bus.commands.back() == 0x00);
  rig.run(77 * kMs, true, false);
  CHECK(rig.bus.commands.back() == 0x4A);  // 50 ms after the pair before began
  CHECK(rig.fields().depth_ok == 1);
  CHECK(rig.fields().full_pressure_pa == 399984);
  CHECK(rig.fields().pressure_dmbar == 39998);
  CHECK(rig.fields().depth_temperature_cdegc == 1981);
  CHECK(rig.counted.errors() == 0);
}

TEST_CASE("the TSYS01 step by step") {
  Rig rig;
  rig.run(27 * kMs, false, true);
  CHECK(rig.bus.commands == Buffer{0x1E, 0xA0, 0xA2, 0xA4, 0xA6, 0xA8, 0xAA, 0xAC, 0xAE});
  rig.run(28 * kMs, false, true);
  CHECK(rig.bus.commands.back() == 0x48);
  rig.run(37 * kMs, false, true);
  CHECK_FALSE(rig.celsius.ok(rig.now_us));
  rig.run(38 * kMs, false, true);
  CHECK(rig.celsius.ok(rig.now_us));
  CHECK(rig.fields().temperature_cdegc == 1058);
  CHECK(rig.fields().temperature_ok == 1);
  rig.run(127 * kMs, false, true);
  CHECK(rig.bus.commands.size() == 11);
  rig.run(128 * kMs, false, true);
  CHECK(rig.bus.commands.back() == 0x48);
  CHECK(rig.counted.errors() == 0);
}

TEST_CASE("a slow loop takes one step a tick and starts the next pair at once") {
  Rig rig;
  FakeBus& bus = rig.bus;
  for (std::uint64_t now_us = 200 * kMs; now_us <= 200 * kMs * 20; now_us += 200 * kMs) {
    const std::size_t before = bus.commands.size();
    rig.depth.tick(now_us, rig.counted);
    bus.set_adc(kDepth, bus.commands.back() == 0x4A ? kD1 : bus.commands.back() == 0x5A ? kD2 : 0);
    CHECK(bus.commands.size() == before + 1);
  }
  // 1 reset, 7 words, then 12 steps of four a pair
  CHECK(bus.commands.back() == 0x00);
  CHECK(rig.counted.errors() == 0);
}

TEST_CASE("not acknowledged at any step: one error, and half a second later it heals") {
  for (int failing = 0; failing < 30; ++failing) {
    CAPTURE(failing);
    Rig rig;
    rig.bus.fail_transaction = failing;
    rig.run(400 * kMs, true, false);
    CHECK(rig.counted.errors() == 1);
    CHECK(rig.bus.recoveries == 0);
    rig.run(1100 * kMs, true, false);
    CHECK(rig.counted.errors() == 1);
    CHECK(rig.depth.ok(rig.now_us));
    CHECK(rig.depth.pressure_pa() == 399984);
  }
  for (int failing = 0; failing < 20; ++failing) {
    CAPTURE(failing);
    Rig rig;
    rig.bus.fail_transaction = failing;
    rig.run(1100 * kMs, false, true);
    CHECK(rig.counted.errors() == 1);
    CHECK(rig.celsius.ok(rig.now_us));
  }
}

TEST_CASE("after a failure the device is left alone for half a second and then reset") {
  Rig rig;
  rig.bus.fail_transaction = 0;
  rig.run(509 * kMs, true, false);
  CHECK(rig.bus.commands.size() == 1);
  rig.run(510 * kMs, true, false);
  CHECK(rig.bus.commands == Buffer{0x1E, 0x1E});
}

TEST_CASE("a wrong PROM is asked for again until it is right") {
  Rig rig;
  rig.bus.set_word(kDepth, 3, 20329);
  rig.bus.set_word(kCelsius, 3, 36017);
  rig.run(2000 * kMs);
  CHECK_FALSE(rig.depth.ok(rig.now_us));
  CHECK_FALSE(rig.celsius.ok(rig.now_us));
  CHECK(rig.counted.errors() == 8);  // four times each
  CHECK(rig.bus.recoveries == 0);    // the bus is fine
  rig.bus.set_word(kDepth, 3, kDepthProm[3]);
  rig.bus.set_word(kCelsius, 3, kCelsiusProm[3]);
  rig.run(3000 * kMs);
  CHECK(rig.depth.ok(rig.now_us));
  CHECK(rig.celsius.ok(rig.now_us));
}

TEST_CASE("a bus held low is recovered once a second and heals") {
  Rig rig;
  rig.run(1000 * kMs);
  CHECK(rig.depth.ok(rig.now_us));
  rig.bus.held_low = true;
  rig.run(11000 * kMs);
  CHECK_FALSE(rig.depth.ok(rig.now_us));
  CHECK_FALSE(rig.celsius.ok(rig.now_us));
  CHECK(rig.counted.errors() == 40);  // each device every half second
  CHECK(rig.bus.recoveries == 8);     // five failures in a row take 1.25 s
  CHECK(rig.fields().depth_ok == 0);
  CHECK(rig.fields().full_pressure_pa == 0xFFFFFF);
  CHECK(rig.fields().pressure_dmbar == 0xFFFF);
  CHECK(rig.fields().temperature_cdegc == 0);
  rig.bus.held_low = false;
  rig.run(12000 * kMs);
  CHECK(rig.depth.ok(rig.now_us));
  CHECK(rig.celsius.ok(rig.now_us));
}

TEST_CASE("recovery comes no more than once a second, however fast transactions fail") {
  FakeBus bus;
  bus.held_low = true;
  CountedBus counted(bus);
  for (std::uint64_t now_us = 0; now_us < 3000 * kMs; now_us += kMs) {
    counted.command(kDepth, 0x1E, now_us);
  }
  CHECK(bus.recoveries == 3);
  CHECK(counted.errors() == 3000);
}

TEST_CASE("a bus that answers nothing but zeros gives no reading") {
  Rig rig;
  rig.bus.answers.clear();
  rig.d1 = rig.d2 = 0;
  rig.run(3000 * kMs);
  CHECK_FALSE(rig.depth.ok(rig.now_us));
  CHECK_FALSE(rig.celsius.ok(rig.now_us));
}

TEST_CASE("a conversion of zero and implausible readings are errors, the last good reading stays for a second") {
  struct Case {
    std::uint32_t d1, d2;
  };
  for (const Case& c : {Case{0, kD2}, Case{kD1, 0}, Case{1, kD2}, Case{0xFFFFFF, kD2}, Case{kD1, 1}, Case{kD1, 0xFFFFFF}}) {
    Rig rig;
    rig.run(300 * kMs, true, false);
    const std::uint16_t errors = rig.counted.errors();
    CHECK(errors == 0);
    rig.d1 = c.d1;
    rig.d2 = c.d2;
    rig.run(1200 * kMs, true, false);
    CHECK(rig.counted.errors() == 2);
    CHECK(rig.depth.ok(rig.now_us));
    CHECK(rig.depth.pressure_pa() == 399984);
    rig.run(1500 * kMs, true, false);
    CHECK_FALSE(rig.depth.ok(rig.now_us));
  }
  for (const std::uint32_t adc : {0u, 1u, 0xFFFFFFu}) {
    Rig rig;
    rig.run(300 * kMs, false, true);
    rig.bus.set_adc(kCelsius, adc);
    rig.run(700 * kMs, false, true);
    CHECK(rig.counted.errors() == 1);
    CHECK(rig.celsius.ok(rig.now_us));
    rig.run(1500 * kMs, false, true);
    CHECK_FALSE(rig.celsius.ok(rig.now_us));
  }
}

TEST_CASE("one dead sensor does not hold up the other") {
  Rig rig;
  rig.bus.answers.erase(kCelsius);
  rig.run(5000 * kMs);
  CHECK(rig.depth.ok(rig.now_us));
  CHECK_FALSE(rig.celsius.ok(rig.now_us));
}
