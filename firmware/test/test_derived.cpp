#include <doctest/doctest.h>

#include "reader_rig.h"

using namespace brov;

namespace {

constexpr std::uint16_t kDepthProm[7] = {0x3A2D, 34982, 36352, 20328, 22354, 26646, 26146};
constexpr std::uint16_t kCelsiusProm[8] = {0, 28446, 24926, 36016, 32791, 40781, 0x1A2B, 0x3C74};

// A CTD that has been running for half a second in water of these converter readings.
struct Ctd {
  Ctd(std::uint32_t d1, std::uint32_t d2, std::uint32_t adc, const std::string& probe) {
    for (std::size_t i = 0; i < 7; ++i) {
      bus.set_word(0x76, i, kDepthProm[i]);
    }
    for (std::size_t i = 0; i < 8; ++i) {
      bus.set_word(0x77, i, kCelsiusProm[i]);
    }
    bus.set_adc(0x77, adc);
    for (now_us = 1000; now_us < 500000; now_us += 1000) {
      depth.tick(now_us, counted);
      if (!bus.commands.empty() && (bus.commands.back() == 0x4A || bus.commands.back() == 0x5A)) {
        bus.set_adc(0x76, bus.commands.back() == 0x4A ? d1 : d2);
      }
      celsius.tick(now_us, counted);
    }
    ec.feed(bytes_of("*OK\r" + probe), now_us);
  }
  SensorFields fields(std::uint64_t at_us) const {
    SensorFields fields;
    fill_derived(fields, ec, depth, celsius, at_us);
    return fields;
  }

  std::uint64_t now_us = 0;
  FakeBus bus;
  CountedBus counted{bus};
  Ms5837 depth;
  Tsys01 celsius;
  EzoEcReader ec;
};

// 399 984 Pa, 10.58 degC, 42.914 mS/cm
Ctd at_thirty_metres() { return {4958179, 6815414, 9378708, "42914,31.00\r"}; }

}  // namespace

TEST_CASE("depth, salinity and sound speed of sea water at thirty metres") {
  const Ctd ctd = at_thirty_metres();
  const SensorFields fields = ctd.fields(ctd.now_us);
  // (399984 - 101325) / (1025 * 9.80665) = 29.712 m
  CHECK(fields.depth_cm == 2971);
  // The host's own formulas (navigation/seawater.py) give 39.340 PSU, too much for the byte, and 1497.714 m/s.
  CHECK(fields.salinity_dpsu == 0xFF);
  CHECK(fields.sound_speed_dmps == 14977);
}

TEST_CASE("no depth without pressure, no sound speed without all three") {
  const Ctd ctd = at_thirty_metres();
  const SensorFields later = ctd.fields(ctd.now_us + 1100000);
  CHECK(later.depth_cm == 0xFFFF);
  CHECK(later.salinity_dpsu == 0xFF);
  CHECK(later.sound_speed_dmps == 0xFFFF);
  const Ctd mute{4958179, 6815414, 9378708, ""};
  CHECK(mute.fields(mute.now_us).depth_cm == 2971);
  CHECK(mute.fields(mute.now_us).salinity_dpsu == 0xFF);
  CHECK(mute.fields(mute.now_us).sound_speed_dmps == 0xFFFF);
  const Ctd cold{4958179, 6815414, 0, "42914,31.00\r"};
  CHECK(cold.fields(cold.now_us).sound_speed_dmps == 0xFFFF);
}

TEST_CASE("fresh water has a salinity and no Mackenzie") {
  const Ctd ctd{4958179, 6815414, 9378708, "300.0,0.14\r"};
  CHECK(ctd.fields(ctd.now_us).salinity_dpsu == 2);
  CHECK(ctd.fields(ctd.now_us).sound_speed_dmps == 0xFFFF);
}

TEST_CASE("above the surface the depth is zero") {
  const Ctd ctd{4500000, 6745017, 9378708, "42914,31.00\r"};
  CHECK(ctd.depth.pressure_pa() < 101325);
  CHECK(ctd.fields(ctd.now_us).depth_cm == 0);
}
