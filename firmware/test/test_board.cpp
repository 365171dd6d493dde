#include <doctest/doctest.h>

#include <algorithm>

#include "rig.h"

using namespace brov;

namespace {

// Both sonars at 10 Hz for `seconds`, out of step with the ticks and, unless told otherwise, with each other.
void send_pings(Rig& rig, std::size_t samples, int seconds, double rate_hz = 10.0, std::uint64_t b_behind_a_us = 31634) {
  for (int i = 0; i < static_cast<int>(rate_hz * seconds); ++i) {
    const auto at_us = rig.now_us + static_cast<std::uint64_t>(1e6 / rate_hz * i);
    rig.send(Port::kSonarA, ping(samples, static_cast<std::uint8_t>(i)), at_us + 137);
    rig.send(Port::kSonarB, ping(samples, static_cast<std::uint8_t>(3 * i)), at_us + 137 + b_behind_a_us);
  }
}

// When the k-th SENSORS is due.
std::uint64_t due_us(std::uint64_t boot_us, std::size_t k, std::uint64_t period_us) {
  return boot_us + 50000 + k * period_us;
}

std::uint64_t worst_wait_us(const Rig& rig, std::uint64_t boot_us, std::uint64_t period_us) {
  std::uint64_t worst = 0;
  const auto sensors = rig.sent(0x01);
  for (std::size_t k = 0; k < sensors.size(); ++k) {
    const std::uint64_t due = due_us(boot_us, k, period_us);
    REQUIRE(sensors[k].at_us >= due);
    REQUIRE(sensors[k].at_us < due + period_us);  // none was lost
    worst = std::max(worst, sensors[k].starts_us - due);
  }
  return worst;
}

std::size_t total_dropped(Rig& rig) {
  const StatusFields status = rig.ask_status();
  return status.pings_dropped[0] + status.pings_dropped[1];
}

}  // namespace

TEST_CASE("SENSORS and STATUS begin at their phases and keep their pace") {
  Rig rig;
  rig.run_until(10000000);
  const auto sensors = rig.sent(0x01);
  const auto statuses = rig.sent(0x06);
  REQUIRE(sensors.size() == 20);
  REQUIRE(statuses.size() == 10);
  for (std::size_t i = 0; i < 20; ++i) {
    CHECK(sensors[i].at_us == 50000 + 500000 * i);
    CHECK(get_u32(sensors[i].payload.data()) == 50 + 500 * i);
  }
  for (std::size_t i = 0; i < 10; ++i) CHECK(statuses[i].at_us == 200000 + 1000000 * i);
}

TEST_CASE("STATUS tells version, boot, uptime and traffic") {
  Rig rig;
  rig.run_until(1250000);
  const StatusFields status = rig.status();
  CHECK(status.version[0] == 0);
  CHECK(status.version[1] == 2);
  CHECK(status.version[2] == 0);
  CHECK(status.uptime_ms == 1200);
  CHECK(status.boot_count == 7);
  CHECK(status.reset_reason == 4);
  CHECK(status.tx_bytes == 3 * 82 + 68);  // what was handed over before this one
  // 314 bytes of 13 824 are 2.27 %.
  CHECK(status.link_load_percent == 2);
}

TEST_CASE("SENSORS carries the counters of both sonars and no reading that does not exist") {
  Rig rig;
  rig.send(Port::kSonarA, ping(1000));
  rig.send(Port::kSonarB, ping(400));
  rig.run_until(600000);
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 2);
  const std::uint8_t* last = sensors[1].payload.data();
  CHECK(get_u32(last + 60) == 5);
  CHECK(get_u32(last + 64) == 1070);
  CHECK(get_u32(last + 68) == 2);
  CHECK(get_u32(last + 72) == 428);
  CHECK(last[22] == 0);                      // IMU
  CHECK(last[34] == 0);                      // GPS
  CHECK(last[39] == 0);                      // EC
  CHECK(last[40] == 1);                      // the extension is always there
  CHECK((get_u32(last + 41) & 0xFFFFFF) == 0xFFFFFF);  // conductivity unknown
  CHECK(last[51] == 0);
  CHECK(last[54] == 0);
  CHECK(get_u16(last + 55) == 0xFFFF);
  CHECK(get_u16(last + 57) == 0xFFFF);
  CHECK(last[59] == 0xFF);
}

TEST_CASE("SENSORS starts within 20 ms at 115200 at any sonar load, none is lost") {
  for (const std::size_t samples : {500u, 1000u, 2000u, 5000u}) {
    for (const std::uint32_t rate_mhz : {2000u, 20000u}) {
      CAPTURE(samples);
      CAPTURE(rate_mhz);
      Settings settings;
      settings.sensors_rate_mhz = rate_mhz;
      Rig rig(settings, 0);
      send_pings(rig, samples, 10);
      rig.send(Port::kSonarA, kogger_frame(0x40, Buffer(255, 1)), 5000000);
      rig.run_until(10000000);
      CHECK(rig.sent(0x01).size() >= 10 * rate_mhz / 1000 - 1);
      CHECK(worst_wait_us(rig, 0, 1000000000 / rate_mhz) <= 20000);
    }
  }
}

TEST_CASE("SENSORS starts within 6 ms at 921600 at any sonar load, none is lost") {
  for (const std::size_t samples : {1000u, 3000u, 5000u}) {
    CAPTURE(samples);
    Rig rig(921600);
    send_pings(rig, samples, 10);
    rig.run_until(10000000);
    CHECK(rig.sent(0x01).size() == 20);
    CHECK(worst_wait_us(rig, 0, 500000) <= 6000);
  }
}

TEST_CASE("SENSORS comes first even while the host floods and both sonars send answers without end") {
  Rig rig;
  send_pings(rig, 3000, 4);
  for (int i = 0; i < 4000; ++i) {
    rig.send_at_once(Port::kHost, frame_of(0x30, {1}));
    rig.send_at_once(Port::kSonarB, kogger_frame(5, {1, 2}));
    rig.run_for(1000);
  }
  CHECK(rig.sent(0x01).size() == 8);
  CHECK(worst_wait_us(rig, 0, 500000) <= 20000);
  // The answers that found no room are counted, and pings of the other channel are none of them.
  const StatusFields status = rig.ask_status();
  CHECK(status.overflow_bytes[0] == 0);
  CHECK(status.overflow_bytes[1] > 0);
}

TEST_CASE("On a saturated line at 115200 sonar data fill at least 90 % of what the rest leaves") {
  for (const std::size_t samples : {2000u, 2800u, 3000u, 5000u}) {
    for (const std::uint64_t b_behind_a_us : {0u, 31634u}) {
      CAPTURE(samples);
      CAPTURE(b_behind_a_us);
      Rig rig;
      send_pings(rig, samples, 31, 10.0, b_behind_a_us);
      rig.run_until(1000000);
      const std::size_t sonar_before = rig.sent_bytes(true), rest_before = rig.sent_bytes(false);
      rig.run_until(31000000);
      const double left = 30.0 * 11520.0 - static_cast<double>(rig.sent_bytes(false) - rest_before);
      const double share = static_cast<double>(rig.sent_bytes(true) - sonar_before) / left;
      CHECK(share >= 0.90);
      CHECK(share <= 1.0 + 230.0 / left);
    }
  }
}

TEST_CASE("On a saturated line whole pings are dropped, both sonars alike, and the ones sent are complete") {
  Rig rig;
  send_pings(rig, 3000, 20);
  rig.run_until(25000000);
  const StatusFields status = rig.ask_status();
  CHECK(status.pings_dropped[0] > 20);
  const auto a = static_cast<int>(status.pings_dropped[0]), b = static_cast<int>(status.pings_dropped[1]);
  CHECK(std::abs(a - b) <= 2);
  // Every ping that was begun is whole: 3000 samples in 15 chunks, in order, the last payload flagged.
  int chunks[2] = {0, 0}, pings[2] = {0, 0}, open = -1;
  for (const SentFrame& frame : rig.sent(0x04)) {
    const int channel = frame.payload[0];
    if (open >= 0) CHECK(channel == open);
    chunks[channel] += frame.payload[3];
    open = channel;
    if ((frame.payload[1] & 0x40) != 0) {
      CHECK(chunks[channel] == 15);
      chunks[channel] = 0;
      ++pings[channel];
      open = -1;
    }
  }
  CHECK(open == -1);
  CHECK(pings[0] + a == 200);
  CHECK(pings[1] + b == 200);
  CHECK(std::abs(pings[0] - pings[1]) <= 2);
}

TEST_CASE("At 115200 the usual survey, 1000 samples at 10 Hz on both sonars, loses nothing") {
  Rig rig;
  send_pings(rig, 1000, 20);
  rig.run_until(21000000);
  CHECK(total_dropped(rig) == 0);
}

TEST_CASE("At 921600 nothing is dropped up to 3000 samples at 10 Hz on both sonars, and all of it is raw") {
  for (const std::size_t samples : {1000u, 3000u}) {
    CAPTURE(samples);
    Rig rig(921600);
    send_pings(rig, samples, 30);
    rig.run_until(31000000);
    CHECK(total_dropped(rig) == 0);
    const StatusFields status = rig.ask_status();
    CHECK(status.overflow_bytes[0] + status.overflow_bytes[1] == 0);
    std::size_t raw = 0;
    for (const std::uint8_t type : {std::uint8_t{2}, std::uint8_t{3}}) {
      for (const SentFrame& frame : rig.sent(type)) raw += frame.payload.size() - 4;
    }
    const std::size_t one_ping = ping(samples).size();
    CHECK(raw % one_ping == 0);
    CHECK(raw / one_ping >= 590);
  }
}

TEST_CASE("The microsecond and the millisecond counter wrap without a stumble") {
  for (const std::uint64_t wrap_us : {std::uint64_t{1} << 32, (std::uint64_t{1} << 32) * 1000}) {
    CAPTURE(wrap_us);
    const std::uint64_t boot_us = wrap_us / 1000 * 1000 - 3000000;
    Rig rig(115200, boot_us);
    Rig plain(115200, 0);
    for (Rig* one : {&rig, &plain}) {
      send_pings(*one, 1000, 6);
      one->run_for(1500000);
      one->command(0x22, config(1, {{4, 921600}}));  // a trial across the wrap
      one->run_for(7500000);
    }
    CHECK(worst_wait_us(rig, boot_us, 500000) <= 20000);
    // The same frames at the same times after boot.
    REQUIRE(rig.hal.link.size() == plain.hal.link.size());
    for (std::size_t i = 0; i < rig.hal.link.size(); ++i) {
      CHECK(rig.hal.link[i].at_us - boot_us == plain.hal.link[i].at_us);
      CHECK(rig.hal.link[i].type == plain.hal.link[i].type);
      CHECK(rig.hal.link[i].payload.size() == plain.hal.link[i].payload.size());
    }
    REQUIRE(rig.hal.baud_changes.size() == 2);
    CHECK(rig.hal.baud_changes[1].at_us == rig.hal.baud_changes[0].at_us + 5000000);
    const auto sensors = rig.sent(0x01);
    CHECK(get_u32(sensors.back().payload.data()) == static_cast<std::uint32_t>(sensors.back().at_us / 1000));
    const auto bundles = rig.sent(0x04);
    CHECK(get_u32(bundles.back().payload.data() + 5) - static_cast<std::uint32_t>(boot_us) ==
          get_u32(plain.sent(0x04).back().payload.data() + 5));
  }
}

TEST_CASE("SENSORS keeps its pace when a line with raw pings in it becomes a slow one") {
  Settings settings = Rig::settings_at(921600);
  settings.sensors_rate_mhz = 20000;
  Rig rig(settings, 0);
  send_pings(rig, 3000, 10);
  rig.run_until(3044000);  // a ping has just ended: 3210 bytes wait
  CHECK(rig.hal.link.back().bytes() > 400);
  rig.command(0x22, config(1, {{4, 115200}}));
  rig.run_until(10000000);  // nobody is heard: back to the fast line after 5 s
  REQUIRE(rig.hal.baud_changes.size() == 2);
  const std::uint64_t slow_us = rig.hal.baud_changes[0].at_us, fast_us = rig.hal.baud_changes[1].at_us;
  CHECK(slow_us < 3055000);
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 200);
  for (std::size_t k = 0; k < sensors.size(); ++k) {
    const bool slow = sensors[k].at_us >= slow_us && sensors[k].at_us < fast_us;
    CHECK(sensors[k].starts_us - due_us(0, k, 50000) <= (slow ? 20000u : 6000u));
  }
  CHECK(total_dropped(rig) >= 1);
}

TEST_CASE("A board that was held up does not catch up on what it missed") {
  Rig rig;
  rig.run_until(100000);
  rig.now_us = 3333000;  // no tick for three seconds
  rig.run_until(5000000);
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 1 + 1 + 3);
  CHECK(sensors[1].at_us == 3334000);
  CHECK(sensors[2].at_us == 3834000);
}

TEST_CASE("The same input gives the same bytes, however the ticks are asked for") {
  const auto run = [](std::uint64_t step_us) {
    Rig rig;
    send_pings(rig, 2000, 3);
    rig.send(Port::kSonarA, noise(3000, 5), 1000000);
    while (rig.now_us < 4000000) rig.run_for(step_us);
    Buffer all;
    for (const SentFrame& frame : rig.hal.link) append(all, frame_of(frame.type, frame.payload));
    return all;
  };
  CHECK(run(4000000) == run(1000));
}

TEST_CASE("A loop may sleep until the next millisecond, but not over bytes that wait") {
  Rig rig;
  rig.run_until(5000);
  CHECK(rig.board->next_wanted_us(5000) == 6000);
  const Buffer bytes(2000, 0);
  rig.board->receive(Port::kSonarA, view(bytes));
  CHECK(rig.board->next_wanted_us(5000) == 5000);
  rig.board->tick(6000);
  CHECK(rig.board->next_wanted_us(6000) == 6000);
  rig.board->tick(7000);
  CHECK(rig.board->next_wanted_us(7000) == 8000);
}

TEST_CASE("Noise on every input for ten seconds: the pace is kept and everything heals") {
  Rig rig;
  for (std::uint32_t port = 0; port < 6; ++port) {
    rig.send(static_cast<Port>(port), noise(port < 3 ? 200000 : 9600, 40 + port));
  }
  rig.run_until(12000000);
  CHECK(rig.sent(0x01).size() == 24);
  CHECK(worst_wait_us(rig, 0, 500000) <= 20000);
  const std::size_t before = rig.sent(0x04).size();
  rig.send(Port::kSonarA, ping(1000));
  rig.run_for(200000);
  CHECK(rig.sent(0x04).size() == before + 2);
}

TEST_CASE("A line that takes nothing for ten seconds: nothing grows, and afterwards the newest comes out first") {
  Rig rig;
  send_pings(rig, 1000, 12);
  rig.run_until(1000000);
  rig.hal.stuck = true;
  rig.run_until(11000000);
  const std::size_t before = rig.hal.link.size();
  rig.hal.stuck = false;
  rig.run_until(11300000);
  CHECK(rig.hal.link.size() > before + 4);
  // Four SENSORS were kept, the newest ones.
  for (std::size_t i = 0; i < 4; ++i) {
    const SentFrame& frame = rig.hal.link[before + i];
    REQUIRE(frame.type == 0x01);
    CHECK(get_u32(frame.payload.data()) == 9050 + 500 * i);
  }
  CHECK(total_dropped(rig) > 150);
  rig.run_until(13000000);
  const StatusFields status = rig.ask_status();
  rig.run_until(16000000);
  CHECK(rig.ask_status().pings_dropped[0] == status.pings_dropped[0]);
}
