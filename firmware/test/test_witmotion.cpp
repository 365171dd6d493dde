#include <doctest/doctest.h>

#include "reader_rig.h"

using namespace brov;

namespace {

constexpr std::uint32_t kRate = 20000;
constexpr std::uint64_t kByteUs = 10000000 / 9600;

Buffer packet(std::uint8_t type, std::int16_t x, std::int16_t y, std::int16_t z) {
  Buffer bytes = {0x55, type};
  for (const int value : {static_cast<int>(x), static_cast<int>(y), static_cast<int>(z), 2500}) {
    bytes.push_back(static_cast<std::uint8_t>(value & 0xFF));
    bytes.push_back(static_cast<std::uint8_t>(value >> 8 & 0xFF));
  }
  std::uint8_t sum = 0;
  for (const std::uint8_t byte : bytes) {
    sum = static_cast<std::uint8_t>(sum + byte);
  }
  bytes.push_back(sum);
  return bytes;
}

Buffer set_of_packets(std::int16_t x = 1) {
  Buffer bytes = packet(0x51, x, 2, 3);
  append(bytes, packet(0x52, 4, 5, 6));
  append(bytes, packet(0x53, 7, 8, 9));
  append(bytes, packet(0x54, 10, 11, 12));
  return bytes;
}

struct Imu {
  void feed(const Buffer& bytes, std::uint64_t now_us, std::uint32_t rate_mhz = kRate) {
    reader.feed(view(bytes), now_us, rate_mhz, reports);
  }
  SensorFields fields(std::uint64_t now_us) const {
    SensorFields fields;
    reader.fill(fields, now_us);
    return fields;
  }

  WitMotionReader reader;
  KeptReports reports;
};

// The commands sent while the IMU delivers (or not) every `period_us`, with one tick a millisecond.
std::vector<KeptWrites::Write> commands_of(std::uint64_t period_us, std::uint64_t until_us,
                                           std::uint32_t rate_mhz = kRate) {
  Imu imu;
  KeptWrites hal;
  imu.reader.start(0);
  for (std::uint64_t now_us = 1000; now_us <= until_us; now_us += 1000) {
    if (period_us > 0 && now_us % period_us == 0) {
      imu.feed(set_of_packets(), now_us, rate_mhz);
    }
    imu.reader.configure(now_us, rate_mhz, hal);
  }
  return hal.writes;
}

}  // namespace

TEST_CASE("a packet of the maker's layout is read at its scale") {
  Imu imu;
  imu.feed(packet(0x51, 2048, -2048, 32767), 1000000);
  imu.feed(packet(0x53, 16384, -16384, -32768), 1000000);
  const SensorFields fields = imu.fields(1000000);
  CHECK(fields.acceleration_mg[0] == 1000);
  CHECK(fields.acceleration_mg[1] == -1000);
  CHECK(fields.acceleration_mg[2] == 16000);
  CHECK(fields.roll_cdeg == 9000);
  CHECK(fields.pitch_cdeg == -9000);
  CHECK(fields.yaw_cdeg == -18000);
  CHECK(fields.imu_packets == 2);
  CHECK(fields.imu_alive == 1);
}

TEST_CASE("counts are rounded half away from zero") {
  Imu imu;
  imu.feed(packet(0x51, 32, -32, 31), 1000000);  // 15.625, 15.137 mg
  CHECK(imu.fields(1000000).acceleration_mg[0] == 16);
  CHECK(imu.fields(1000000).acceleration_mg[1] == -16);
  CHECK(imu.fields(1000000).acceleration_mg[2] == 15);
  imu.feed(packet(0x51, 1, -1, 1024), 1000000);  // 0.488, 500 mg
  CHECK(imu.fields(1000000).acceleration_mg[0] == 0);
  CHECK(imu.fields(1000000).acceleration_mg[1] == 0);
  CHECK(imu.fields(1000000).acceleration_mg[2] == 500);
}

TEST_CASE("old angles and accelerations are zero, one by one") {
  Imu imu;
  imu.feed(packet(0x51, 2048, 0, 0), 1000000);
  imu.feed(packet(0x53, 16384, 0, 0), 1500000);
  CHECK(imu.fields(2200000).acceleration_mg[0] == 1000);
  CHECK(imu.fields(2200001).acceleration_mg[0] == 0);
  CHECK(imu.fields(2200001).roll_cdeg == 9000);
  CHECK(imu.fields(2200001).imu_alive == 1);
  CHECK(imu.fields(2700001).roll_cdeg == 0);
  CHECK(imu.fields(2700001).imu_alive == 0);
}

TEST_CASE("other types count as packets, unknown ones do not") {
  Imu imu;
  imu.feed(packet(0x50, 1, 2, 3), 1000000);
  imu.feed(packet(0x5F, 1, 2, 3), 1000000);
  CHECK(imu.fields(1000000).imu_packets == 2);
  imu.feed(packet(0x61, 1, 2, 3), 1000000);
  CHECK(imu.fields(1000000).imu_packets == 2);
  CHECK(imu.reader.errors() >= 1);
}

TEST_CASE("a broken byte costs one packet, wherever it is") {
  for (std::size_t at = 0; at < 11; ++at) {
    CAPTURE(at);
    Imu imu;
    Buffer stream = packet(0x51, 0x0101, 0x0202, 0x0303);
    stream[at] = static_cast<std::uint8_t>(stream[at] ^ 0x08);
    append(stream, packet(0x53, 16384, 0, 0));
    append(stream, packet(0x50, 0, 0, 0));  // a false candidate may need more bytes to fail
    imu.feed(stream, 1000000);
    CHECK(imu.fields(1000000).imu_packets == 2);
    CHECK(imu.fields(1000000).roll_cdeg == 9000);
    CHECK(imu.reader.errors() == (at == 0 ? 0 : 1));
  }
}

TEST_CASE("a packet hidden behind false starts is found") {
  Imu imu;
  Buffer stream = {0x55, 0x55, 0x51, 0x55, 0x55, 0x55};
  append(stream, packet(0x53, 16384, 0, 0));
  append(stream, packet(0x50, 0, 0, 0));
  imu.feed(stream, 1000000);
  CHECK(imu.fields(1000000).roll_cdeg == 9000);
  CHECK(imu.fields(1000000).imu_packets == 2);
}

TEST_CASE("every split point gives the same samples") {
  Buffer stream = set_of_packets(1);
  append(stream, set_of_packets(2));
  for (std::size_t split = 0; split <= stream.size(); ++split) {
    Imu imu;
    const Buffer head(stream.begin(), stream.begin() + static_cast<std::ptrdiff_t>(split));
    const Buffer tail(stream.begin() + static_cast<std::ptrdiff_t>(split), stream.end());
    imu.feed(head, 1000000 - kByteUs * tail.size());
    imu.feed(tail, 1000000);
    REQUIRE(imu.reports.bursts.size() == 1);
    CHECK(imu.reports.bursts[0].samples.size() == 2);
    CHECK(imu.reports.bursts[0].samples[1].acceleration[0] == 2);
    CHECK(imu.fields(1000000).imu_packets == 8);
  }
}

TEST_CASE("a sample's time is that of its first byte, across batches") {
  Imu imu;
  const Buffer stream = set_of_packets();
  imu.feed(Buffer(stream.begin(), stream.begin() + 5), 1000000);   // its first byte came 4 bytes earlier
  imu.feed(Buffer(stream.begin() + 5, stream.end()), 1045000);
  imu.feed(set_of_packets(), 1100000);
  REQUIRE(imu.reports.bursts.size() == 1);
  CHECK(imu.reports.bursts[0].t0_us == 1000000 - 4166);
  CHECK(imu.reports.bursts[0].dt_us == 1100000 - 44791 - (1000000 - 4166));
}

TEST_CASE("a sample holds acceleration, rate and field of one set, raw") {
  Imu imu;
  imu.feed(set_of_packets(-5), 1000000);
  imu.feed(set_of_packets(-6), 1050000);
  REQUIRE(imu.reports.bursts.size() == 1);
  const ImuSample& sample = imu.reports.bursts[0].samples[0];
  CHECK(sample.acceleration[0] == -5);
  CHECK(sample.angular_rate[2] == 6);
  CHECK(sample.magnetic_field[1] == 11);
}

TEST_CASE("a new acceleration discards an incomplete sample") {
  Imu imu;
  Buffer stream = packet(0x51, 100, 0, 0);
  append(stream, packet(0x52, 0, 0, 0));
  append(stream, set_of_packets(200));
  imu.feed(stream, 1000000);
  imu.feed(set_of_packets(201), 1050000);
  REQUIRE(imu.reports.bursts.size() == 1);
  CHECK(imu.reports.bursts[0].samples[0].acceleration[0] == 200);
}

TEST_CASE("parts from before and behind a gap make no sample") {
  Imu imu;
  imu.feed(packet(0x51, 100, 0, 0), 1000000);  // unplugged here
  Buffer rest = packet(0x52, 0, 0, 0);
  append(rest, packet(0x54, 0, 0, 0));
  imu.feed(rest, 9000000);
  imu.feed(set_of_packets(1), 9050000);
  imu.feed(set_of_packets(2), 9100000);
  REQUIRE(imu.reports.bursts.size() == 1);
  CHECK(imu.reports.bursts[0].samples[0].acceleration[0] == 1);
}

TEST_CASE("20 Hz goes out in bursts of two, 1 Hz alone") {
  Imu fast, slow;
  for (std::uint64_t i = 1; i <= 20; ++i) {
    fast.feed(set_of_packets(), 1000000 + 50000 * i);
    slow.feed(set_of_packets(), 1000000 + 1000000 * i, 1000);
  }
  REQUIRE(fast.reports.bursts.size() == 10);
  CHECK(fast.reports.bursts[3].samples.size() == 2);
  CHECK(fast.reports.bursts[3].dt_us == 50000);
  REQUIRE(slow.reports.bursts.size() == 20);
  CHECK(slow.reports.bursts[3].samples.size() == 1);
  CHECK(slow.reports.bursts[3].dt_us == 1000000);
}

TEST_CASE("a sensor that is too fast is thinned to the set rate") {
  Imu imu;
  for (std::uint64_t i = 1; i <= 200; ++i) {
    imu.feed(set_of_packets(static_cast<std::int16_t>(i)), 1000000 + 50000 * i, 5000);
  }
  CHECK(imu.reports.bursts.size() == 50);  // every 200 ms of 10 s
  CHECK(imu.reports.bursts[1].samples[0].acceleration[0] - imu.reports.bursts[0].samples[0].acceleration[0] == 4);
}

TEST_CASE("a sensor that jitters by less than 5 ms loses no sample") {
  Imu imu;
  for (std::uint64_t i = 1; i <= 100; ++i) {
    imu.feed(set_of_packets(), 1000000 + 50000 * i + (i % 2 == 0 ? 4000 : 0));
  }
  CHECK(imu.reports.bursts.size() == 50);
}

TEST_CASE("samples in front of a pause go alone") {
  Imu imu;
  imu.feed(set_of_packets(1), 1000000);
  imu.feed(set_of_packets(2), 1000000 + 151000);
  REQUIRE(imu.reports.bursts.size() == 1);
  CHECK(imu.reports.bursts[0].samples.size() == 1);
  CHECK(imu.reports.bursts[0].dt_us == 50000);
  imu.feed(set_of_packets(3), 1000000 + 200000);
  REQUIRE(imu.reports.bursts.size() == 2);
  CHECK(imu.reports.bursts[1].samples[0].acceleration[0] == 2);
  CHECK(imu.reports.bursts[1].dt_us == 49000);
}

TEST_CASE("the time on the wire wraps with 32 bits") {
  Imu imu;
  const std::uint64_t wrap = std::uint64_t{1} << 32;
  imu.feed(set_of_packets(1), wrap + 10000);
  imu.feed(set_of_packets(2), wrap + 60000);
  REQUIRE(imu.reports.bursts.size() == 1);
  CHECK(imu.reports.bursts[0].t0_us == static_cast<std::uint32_t>(wrap + 10000 - 44791));
  CHECK(imu.reports.bursts[0].dt_us == 50000);
}

TEST_CASE("a silent IMU is configured at boot and every ten seconds, saved once") {
  const auto writes = commands_of(0, 22000000);
  std::vector<std::string> sent;
  for (const auto& write : writes) {
    CHECK(write.port == Port::kImu);
    sent.push_back(write.hex);
  }
  const std::vector<std::string> volatile_set = {"ffaa6988b5", "ffaa021e00", "ffaa030700"};
  REQUIRE(sent.size() == 10);
  CHECK(std::vector<std::string>(sent.begin(), sent.begin() + 3) == volatile_set);
  CHECK(sent[3] == "ffaa000000");
  CHECK(std::vector<std::string>(sent.begin() + 4, sent.begin() + 7) == volatile_set);
  CHECK(std::vector<std::string>(sent.begin() + 7, sent.end()) == volatile_set);
  CHECK(writes[0].at_us == 500000);
  CHECK(writes[1].at_us == 600000);
  CHECK(writes[3].at_us == 800000);
  CHECK(writes[4].at_us == 10500000);
  CHECK(writes[7].at_us == 20500000);
}

TEST_CASE("an IMU that delivers as it should is left alone") {
  CHECK(commands_of(50000, 30000000).empty());
  CHECK(commands_of(100000, 30000000, 10000).empty());
}

TEST_CASE("an IMU at another rate is set once, and saved") {
  const auto writes = commands_of(100000, 30000000);
  REQUIRE(writes.size() == 4);
  CHECK(writes[2].hex == "ffaa030700");
  CHECK(writes[3].hex == "ffaa000000");
}

TEST_CASE("the output rate is the next one that suffices") {
  const std::pair<std::uint32_t, const char*> expected[] = {{1000, "ffaa030300"},  {1001, "ffaa030400"},
                                                            {2000, "ffaa030400"},  {5000, "ffaa030500"},
                                                            {5001, "ffaa030600"},  {10000, "ffaa030600"},
                                                            {10001, "ffaa030700"}, {20000, "ffaa030700"}};
  for (const auto& rate : expected) {
    CAPTURE(rate.first);
    const auto writes = commands_of(0, 800000, rate.first);
    REQUIRE(writes.size() == 4);
    CHECK(writes[2].hex == rate.second);
  }
}

TEST_CASE("a changed rate sends unlock and rate, without wearing the memory") {
  WitMotionReader reader;
  KeptWrites hal;
  reader.start(0);
  for (std::uint64_t now_us = 1000; now_us < 3000000; now_us += 1000) {
    if (now_us == 2000000) {
      hal.writes.clear();
      reader.rate_changed();
    }
    reader.configure(now_us, now_us < 2000000 ? 20000 : 5000, hal);
  }
  REQUIRE(hal.writes.size() == 2);
  CHECK(hal.writes[0].hex == "ffaa6988b5");
  CHECK(hal.writes[0].at_us == 2000000);
  CHECK(hal.writes[1].hex == "ffaa030500");
  CHECK(hal.writes[1].at_us == 2100000);
}

TEST_CASE("boot need not be at time zero") {
  WitMotionReader reader;
  KeptWrites hal;
  const std::uint64_t boot_us = 5000000000;
  reader.start(boot_us);
  reader.configure(boot_us + 499999, kRate, hal);
  CHECK(hal.writes.empty());
  reader.configure(boot_us + 500000, kRate, hal);
  CHECK(hal.writes.size() == 1);
}

TEST_CASE("an IMU at the wrong baud rate is not alive, and comes back") {
  Imu imu;
  Buffer noise;
  std::uint32_t state = 12345;
  for (int i = 0; i < 256; ++i) {
    state = state * 1664525u + 1013904223u;
    noise.push_back(static_cast<std::uint8_t>(state >> 24));
  }
  for (std::uint64_t i = 0; i < 40; ++i) {
    imu.feed(noise, 1000000 + 300000 * i);
  }
  CHECK(imu.fields(13000000).imu_alive == 0);
  CHECK(imu.reports.bursts.empty());
  imu.feed(set_of_packets(1), 14000000);
  imu.feed(set_of_packets(2), 14050000);
  imu.feed(set_of_packets(3), 14100000);
  CHECK(imu.fields(14100000).imu_alive == 1);
  CHECK(imu.reports.bursts.size() >= 1);
}
