#include <doctest/doctest.h>

#include <algorithm>

#include "rig.h"

using namespace brov;

namespace {

constexpr KoggerMode kSetting{2, 0, false, true}, kGetting{3, 0, false, true};

struct Ack {
  int type, sequence, result;
  bool operator==(const Ack& other) const {
    return type == other.type && sequence == other.sequence && result == other.result;
  }
};

doctest::String toString(const Ack& ack) {
  return doctest::toString(ack.type) + " " + doctest::toString(ack.sequence) + " " + doctest::toString(ack.result);
}

std::vector<Ack> acks(const Rig& rig) {
  std::vector<Ack> all;
  for (const SentFrame& frame : rig.sent(0x07)) all.push_back({frame.payload[0], frame.payload[1], frame.payload[2]});
  return all;
}

using Acks = std::vector<Ack>;

}  // namespace

TEST_CASE("A whole command is written to its sonar in the same tick, unchanged") {
  Rig rig;
  const Buffer question = kogger_frame(0x20, {}, kGetting);
  const Buffer setting = kogger_frame(0x15, {0x60, 0xE3, 0x16, 0x00}, kSetting);
  rig.command(0x20, kogger_command(1, question));
  rig.command(0x21, kogger_command(2, setting));
  rig.run_for(1000);
  CHECK(acks(rig) == Acks{{0x20, 1, 0}, {0x21, 2, 0}});
  REQUIRE(rig.hal.writes.size() == 2);
  CHECK(rig.hal.writes[0].port == Port::kSonarA);
  CHECK(rig.hal.writes[0].bytes == question);
  CHECK(rig.hal.writes[0].at_us == 1000);
  CHECK(rig.hal.writes[1].port == Port::kSonarB);
  CHECK(rig.hal.writes[1].bytes == setting);
  CHECK(rig.ask_status().bad_commands == 0);
}

TEST_CASE("A command that is not exactly one intact BB55 frame is refused") {
  const Buffer good = kogger_frame(0x20, {}, kGetting);
  Buffer bad_check = good;
  bad_check.back() ^= 1;
  const Buffer mod255 = kogger_frame(0x15, {0xFF, 0xFF, 0xFF, 0xFF}, kSetting, true);
  Buffer two = good;
  append(two, good);
  Buffer wrong_sync = good;
  wrong_sync[0] = 0xCC;
  Buffer longer = good;
  longer.push_back(0);
  std::uint8_t sequence = 10;
  for (const Buffer& inner : {bad_check, mod255, two, wrong_sync, longer}) {
    Rig rig;
    CAPTURE(to_hex(inner));
    rig.command(0x20, kogger_command(++sequence, inner));
    rig.run_for(1000);
    CHECK(acks(rig) == Acks{{0x20, sequence, 1}});
    CHECK(rig.hal.writes.empty());
    CHECK(rig.ask_status().bad_commands == 1);
  }
}

TEST_CASE("What would change a sonar's own baud rate or address is rejected, a question about it is not") {
  Rig rig;
  rig.command(0x20, kogger_command(1, kogger_frame(0x18, Buffer(9, 1), kSetting)));
  rig.command(0x20, kogger_command(2, kogger_frame(0x18, Buffer(6, 1), {2, 1, false, true})));
  rig.command(0x20, kogger_command(3, kogger_frame(0x18, Buffer(5, 1), kGetting)));
  rig.run_for(1000);
  CHECK(acks(rig) == Acks{{0x20, 1, 3}, {0x20, 2, 3}, {0x20, 3, 0}});
  CHECK(rig.hal.writes.size() == 1);
  CHECK(rig.ask_status().bad_commands == 2);
}

TEST_CASE("Eight commands may wait for an answer, for 300 ms, each sonar by itself") {
  Rig rig;
  const Buffer inner = kogger_frame(0x20, {}, kGetting);
  for (std::uint8_t i = 1; i <= 9; ++i) rig.command(0x20, kogger_command(i, inner));
  rig.command(0x21, kogger_command(10, inner));
  rig.run_for(1000);
  REQUIRE(acks(rig).size() == 10);
  CHECK(acks(rig)[7] == Ack{0x20, 8, 0});
  CHECK(acks(rig)[8] == Ack{0x20, 9, 4});
  CHECK(acks(rig)[9] == Ack{0x21, 10, 0});
  CHECK(rig.hal.writes.size() == 9);
  rig.run_for(298000);
  rig.command(0x20, kogger_command(11, inner));
  rig.run_for(1000);
  CHECK(acks(rig).back() == Ack{0x20, 11, 4});  // 299 ms later
  rig.command(0x20, kogger_command(12, inner));
  rig.run_for(1000);
  CHECK(acks(rig).back() == Ack{0x20, 12, 0});
}

TEST_CASE("An answer of the sonar makes room for commands, a chart does not") {
  Rig rig;
  const Buffer inner = kogger_frame(0x20, {}, kGetting);
  for (std::uint8_t i = 1; i <= 8; ++i) rig.command(0x20, kogger_command(i, inner));
  rig.run_for(1000);
  rig.send(Port::kSonarA, chart(0, Buffer(100, 9)));
  rig.run_for(3000);
  rig.command(0x20, kogger_command(9, inner));
  rig.run_for(1000);
  CHECK(acks(rig).back() == Ack{0x20, 9, 4});
  rig.send(Port::kSonarA, kogger_frame(0x20, Buffer(34, 2)));
  rig.run_for(2000);
  rig.command(0x20, kogger_command(10, inner));
  rig.run_for(1000);
  CHECK(acks(rig).back() == Ack{0x20, 10, 0});
}

TEST_CASE("CONFIG is obeyed as a whole and saved once") {
  Rig rig;
  rig.run_for(100000);
  rig.command(0x22, config(5, {{1, 20000}, {2, 5000}, {3, 2}}));
  rig.run_for(1000);
  CHECK(acks(rig) == Acks{{0x22, 5, 0}});
  REQUIRE(rig.hal.saved.size() == 1);
  CHECK(rig.hal.saved[0].sensors_rate_mhz == 20000);
  CHECK(rig.hal.saved[0].imu_rate_mhz == 5000);
  CHECK(rig.hal.saved[0].decimation == 2);
  CHECK(rig.hal.saved[0].baud == 115200);
  const std::size_t before = rig.sent(0x01).size();
  rig.run_for(1000000);
  const auto sensors = rig.sent(0x01);
  CHECK(sensors.size() == before + 20);
  CHECK(sensors[before].at_us == 151000);  // one new period after the command
}

TEST_CASE("CONFIG with any pair that is not allowed changes nothing") {
  const std::initializer_list<std::pair<std::uint8_t, std::uint32_t>> bad[] = {
      {{3, 2}, {9, 1}},     {{9, 1}, {3, 2}},    {{3, 2}, {1, 499}},  {{3, 2}, {1, 20001}}, {{3, 2}, {2, 999}},
      {{3, 2}, {2, 20001}}, {{3, 0}},            {{3, 9}},             {{3, 2}, {4, 57600}},
      {{3, 2}, {0, 2}},     {{4, 921600}, {3, 9}}};
  std::uint8_t sequence = 0;
  for (const auto& pairs : bad) {
    Rig rig;
    rig.command(0x22, config(++sequence, pairs));
    rig.run_for(10000);
    CHECK(acks(rig) == Acks{{0x22, sequence, 3}});
    CHECK(rig.hal.saved.empty());
    CHECK(rig.hal.baud_changes.empty());
    CHECK(rig.ask_status().bad_commands == 1);
  }
}

TEST_CASE("CONFIG that changes nothing is acknowledged, not saved, and leaves the pace of SENSORS alone") {
  Rig rig;
  rig.run_for(300000);
  rig.command(0x22, config(1, {{1, 2000}, {2, 20000}, {3, 4}, {4, 115200}}));
  rig.run_for(700000);
  CHECK(acks(rig) == Acks{{0x22, 1, 0}});
  CHECK(rig.hal.saved.empty());
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 2);
  CHECK(sensors[1].at_us == 550000);
}

TEST_CASE("A new baud rate is tried, kept when the host is heard at it, and never saved") {
  Rig rig;
  rig.command(0x22, config(1, {{4, 921600}, {3, 3}}));
  rig.run_for(10000);
  REQUIRE(rig.hal.baud_changes.size() == 1);
  REQUIRE(rig.hal.saved.size() == 1);
  CHECK(rig.hal.saved[0].baud == 115200);
  CHECK(rig.sent(0x07).size() == 1);
  CHECK(rig.sent(0x07)[0].at_us < rig.hal.baud_changes[0].at_us);
  rig.run_for(4900000);
  rig.command(0x24, {1});  // unknown: no proof that this is our host
  rig.run_for(10000);
  rig.command(0x23, time_sync(2, 1));
  rig.run_for(10000000);
  CHECK(rig.hal.baud_changes.size() == 1);
  rig.command(0x22, config(3, {{3, 4}}));
  rig.run_for(1000);
  CHECK(rig.hal.saved.back().baud == 115200);
}

TEST_CASE("A new baud rate at which only noise is heard is given up after 5 s") {
  Rig rig;
  rig.command(0x22, config(1, {{4, 921600}}));
  rig.run_for(10000);
  REQUIRE(rig.hal.baud_changes.size() == 1);
  const std::uint64_t tried_us = rig.hal.baud_changes[0].at_us;
  for (std::uint32_t i = 0; i < 60; ++i) {
    Buffer garbled = noise(40, i);
    append(garbled, frame_of(0x24, {1}));
    rig.send_at_once(Port::kHost, garbled);
    rig.run_for(100000);
  }
  REQUIRE(rig.hal.baud_changes.size() == 2);
  CHECK(rig.hal.baud_changes[1].baud == 115200);
  CHECK(rig.hal.baud_changes[1].at_us == tried_us + 5000000);
}

TEST_CASE("TIME_SYNC is answered by a STATUS at once that tells when it came") {
  Rig rig;
  rig.run_for(300000);
  CHECK(rig.status().echoed_host_us == 0);
  CHECK(rig.status().echo_device_us == 0);
  rig.command(0x23, time_sync(9, 0x0123456789ABCDEFu));
  rig.run_for(1000);
  const auto statuses = rig.sent(0x06);
  REQUIRE(statuses.size() == 2);
  CHECK(statuses[1].at_us == 301000);
  CHECK(rig.status().echoed_host_us == 0x0123456789ABCDEFu);
  CHECK(rig.status().echo_device_us == 301000);
  CHECK(acks(rig).empty());
  rig.run_for(1000000);
  CHECK(rig.status().echoed_host_us == 0);
}

TEST_CASE("Unknown types are counted, and acknowledged only where they may be meant for us") {
  Rig rig;
  rig.command(0x24, {77, 1, 2});
  rig.command(0x30, {});
  rig.command(0x01, Buffer(76, 0));
  rig.command(0x10, {1, 2, 3});
  rig.run_for(1000);
  CHECK(acks(rig) == Acks{{0x24, 77, 2}, {0x30, 0, 2}});
  CHECK(rig.ask_status().bad_commands == 4);
}

TEST_CASE("Bad frames are counted and not acknowledged") {
  SUBCASE("bad check") {
    Rig rig;
    Buffer frame = frame_of(0x23, time_sync(1, 5));
    frame.back() ^= 0x10;
    rig.send_at_once(Port::kHost, frame);
    rig.run_for(1000);
    CHECK(rig.hal.link.empty());
    CHECK(rig.ask_status().bad_commands == 1);
  }
  SUBCASE("a length that the type cannot have") {
    Rig rig;
    rig.command(0x22, {1, 2, 3});
    rig.run_for(1000);
    CHECK(rig.hal.link.empty());
    CHECK(rig.ask_status().bad_commands == 1);
  }
  SUBCASE("bytes that are no frame count once for a batch") {
    Rig rig;
    rig.send_at_once(Port::kHost, Buffer(100, 0x31));
    rig.run_for(1000);
    rig.send_at_once(Port::kHost, Buffer(50, 0x32));
    rig.run_for(1000);
    CHECK(rig.ask_status().bad_commands == 2);
  }
}

TEST_CASE("Every command split between two ticks in every place is understood") {
  const Buffer frame = frame_of(0x22, config(3, {{3, 2}}));
  for (std::size_t cut = 1; cut < frame.size(); ++cut) {
    Rig rig;
    rig.send_at_once(Port::kHost, Buffer(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(cut)));
    rig.run_for(5000);
    rig.send_at_once(Port::kHost, Buffer(frame.begin() + static_cast<std::ptrdiff_t>(cut), frame.end()));
    rig.run_for(5000);
    CHECK(acks(rig) == Acks{{0x22, 3, 0}});
  }
}

TEST_CASE("A host that floods commands: the board keeps its pace, answers the newest, recovers") {
  Rig rig;
  const Buffer flood = frame_of(0x20, kogger_command(1, kogger_frame(0x20, {}, kGetting)));
  std::uint64_t until_us = 3000000;
  while (rig.now_us < until_us) {
    for (int i = 0; i < 20; ++i) rig.send_at_once(Port::kHost, flood);  // 300 bytes a millisecond
    rig.run_for(1000);
  }
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 6);
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    CHECK(sensors[i].starts_us - (50000 + 500000 * i) <= 20000);
  }
  const auto to_sonar = [](const PortWrite& write) { return write.port == Port::kSonarA; };
  CHECK(std::count_if(rig.hal.writes.begin(), rig.hal.writes.end(), to_sonar) == 8 * 10);  // eight each 300 ms
  rig.run_for(1000000);
  rig.command(0x22, config(200, {{3, 2}}));
  rig.run_for(100000);
  CHECK(acks(rig).back() == Ack{0x22, 200, 0});
  CHECK(rig.hal.saved.size() == 1);
}
