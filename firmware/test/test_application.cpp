// The ESP32's own setup() and loop(), on a pretended machine in virtual time.
#include <doctest/doctest.h>

#include "brov/bytes.h"
#include "esp32_rig.h"
#include "native/fixed_readings.h"
#include "src/boot.h"
#include "src/pins.h"

using brov::MessageType;

namespace {

constexpr int kSonarA = 1, kSonarB = 2;

// Offsets of docs/protocol.md, section 1 and 2.
std::uint32_t a_bytes(const LinkFrame& sensors) { return brov::get_u32(sensors.payload.data() + 64); }
std::uint32_t b_packets(const LinkFrame& sensors) { return brov::get_u32(sensors.payload.data() + 68); }
bool depth_ok(const LinkFrame& sensors) { return sensors.payload[51] != 0; }
bool temperature_ok(const LinkFrame& sensors) { return sensors.payload[54] != 0; }

std::size_t bytes_of(const std::vector<LinkFrame>& frames) {
  std::size_t sum = 0;
  for (const LinkFrame& frame : frames) sum += frame.payload.size() + brov::kFrameOverhead;
  return sum;
}

// From the tick that made SENSORS to its first bit on the wire.
std::uint64_t worst_lateness_us(const std::vector<LinkFrame>& sensors) {
  std::uint64_t worst_us = 0;
  for (std::size_t i = 1; i < sensors.size(); ++i) {
    const std::uint64_t due_us = brov::get_u32(sensors[i].payload.data()) * std::uint64_t{1000};
    worst_us = std::max(worst_us, sensors[i].start_us - due_us);
  }
  return worst_us;
}

}  // namespace

TEST_CASE("A board without any sensor starts and reports") {
  fake::Flash flash;
  Esp32 esp32(flash);
  esp32.boot();
  esp32.run_for(3000000);

  CHECK(esp32.text() == "\r\nBlueROV SLAM firmware 0.2.0: start 1 (power on), 115200 baud\r\n");
  const auto sensors = esp32.frames(MessageType::kSensors);
  CHECK(sensors.size() == 6);
  CHECK(esp32.frames(MessageType::kStatus).size() == 3);
  CHECK(esp32.status().boot_count == 1);
  CHECK(esp32.status().reset_reason == 1);
  CHECK_FALSE(depth_ok(sensors.back()));
  CHECK(esp32.status().i2c_errors > 0);
  CHECK(esp32.passes > 2500);  // a pass a millisecond, and sleep in between
  CHECK(esp32.passes < 3500);
  CHECK_FALSE(esp32.machine.watchdog_bites());
}

TEST_CASE("The wiring, and which core has the interrupts") {
  fake::Flash flash;
  Esp32 esp32(flash);
  esp32.boot();
  esp32.run_for(10000);

  const auto wired = [](const fake::Uart& uart, int rx, int tx, std::uint32_t baud) {
    return uart.installed() && uart.rx_pin == rx && uart.tx_pin == tx && uart.baud() == baud &&
           uart.installed_on_core == 0;
  };
  fake::Machine& machine = esp32.machine;
  CHECK(wired(machine.uart(0), 3, 1, 115200));
  CHECK(wired(machine.uart(kSonarA), 16, 17, 921600));
  CHECK(wired(machine.uart(kSonarB), 25, 26, 921600));
  CHECK(wired(machine.software_uart(27), 27, 14, 9600));
  CHECK(wired(machine.software_uart(19), 19, 18, 9600));
  CHECK(wired(machine.software_uart(13), 13, 15, 9600));
  CHECK(machine.uart(kSonarA).rx_threshold <= 64);
  for (const auto& task : machine.tasks()) CHECK(task->core == (task->name == "loop" ? 1 : 0));
}

TEST_CASE("Every start is counted in flash, with its reason") {
  fake::Flash flash;
  {
    Esp32 first(flash);
    first.boot();
    first.run_for(500000);
  }
  Esp32 second(flash, 9);
  second.boot();
  second.run_for(500000);
  CHECK(second.status().boot_count == 2);
  CHECK(second.status().reset_reason == 9);
  CHECK(second.text().find("start 2 (brown-out)") != std::string::npos);
}

TEST_CASE("A worn-out flash does not keep the board from starting") {
  fake::Flash flash;
  flash.broken = true;
  Esp32 esp32(flash, 4);
  esp32.boot();
  esp32.command(0x22, config(1, {{1, 5000}}));
  esp32.run_for(1500000);
  CHECK(esp32.status().boot_count == 0);
  CHECK(esp32.status().reset_reason == 4);
  CHECK(esp32.frames(MessageType::kSensors).size() >= 5);
}

TEST_CASE("Both sonars' bytes reach the board and come out as pings") {
  fake::Flash flash;
  Esp32 esp32(flash);
  feed_pings(esp32.machine.uart(kSonarA), 400, 5, 600000, 2);
  feed_pings(esp32.machine.uart(kSonarB), 1000, 5, 650000, 2);
  esp32.boot();
  esp32.run_until(3500000);
  const LinkFrame last = esp32.frames(MessageType::kSensors).back();
  CHECK(a_bytes(last) == 10 * ping(400).size());
  CHECK(b_packets(last) == 10 * 5);
  const std::size_t raw = esp32.frames(MessageType::kKoggerRawA).size() + esp32.frames(MessageType::kKoggerRawB).size();
  CHECK(raw + esp32.frames(MessageType::kKoggerCompressed).size() >= 20);
  const brov::StatusFields status = esp32.status();
  CHECK(status.pings_dropped[0] + status.pings_dropped[1] == 0);
  CHECK(status.overflow_bytes[0] + status.overflow_bytes[1] == 0);
}

TEST_CASE("A command for a sonar goes out on its own wire") {
  fake::Flash flash;
  Esp32 esp32(flash);
  esp32.boot();
  esp32.run_for(100000);
  const Buffer question = kogger_frame(0x12, {}, {3});
  esp32.command(0x21, kogger_command(7, question));
  esp32.run_for(50000);
  CHECK(esp32.machine.uart(kSonarA).sent().empty());
  CHECK(ascii(ascii(esp32.machine.uart(kSonarB).sent())) == question);
  const auto acks = esp32.frames(MessageType::kCommandAck);
  REQUIRE(acks.size() == 1);
  CHECK(acks[0].payload == unhex("210700"));
}

TEST_CASE("The 9600-baud sensors are read and configured") {
  fake::Flash flash;
  Esp32 esp32(flash);
  esp32.boot();
  fake::Machine& machine = esp32.machine;
  const Buffer gga = ascii("$GPGGA,120000.00,6000.0000,N,00500.0000,E,1,08,1.0,10.0,M,45.0,M,,*55\r\n");
  for (std::uint64_t at_us = 500000; at_us < 4500000; at_us += 1000000) {
    machine.software_uart(27).arrive(gga, at_us, 9600);
    machine.software_uart(19).arrive(ascii("53000,35.00\r"), at_us, 9600);
  }
  for (std::uint64_t at_us = 500000; at_us < 4500000; at_us += 50000) {
    machine.software_uart(13).arrive(unhex("5551" "0000000000080000" "ae"), at_us, 9600);
  }
  esp32.run_until(4500000);

  const auto& imu = machine.software_uart(13).sent();
  Buffer to_imu;
  for (const auto& byte : imu) to_imu.push_back(byte.value);
  CHECK(to_hex(to_imu) == "ffaa6988b5" "ffaa021e00" "ffaa030700" "ffaa000000");
  CHECK(ascii(machine.software_uart(19).sent()).substr(0, 14) == "O,EC,1\rO,S,1\rO");
  CHECK(machine.software_uart(27).sent().empty());

  const Buffer sensors = esp32.frames(MessageType::kSensors).back().payload;
  CHECK(sensors[34] == 1);  // GPS
  CHECK(sensors[39] == 1);  // EC
  CHECK(sensors[22] == 1);  // IMU
  CHECK(brov::get_u16(sensors.data() + 37) == 3500);
}

TEST_CASE("Depth and temperature come over I2C") {
  fake::Flash flash;
  Esp32 esp32(flash);
  brov::set_fixed_readings(esp32.machine.i2c(), 250000.0, 10.0);
  esp32.boot();
  esp32.run_for(2000000);
  const LinkFrame sensors = esp32.frames(MessageType::kSensors).back();
  CHECK(depth_ok(sensors));
  CHECK(temperature_ok(sensors));
  CHECK(brov::get_u16(sensors.payload.data() + 47) == 25000);  // 0.1 mbar
  CHECK(brov::get_u16(sensors.payload.data() + 52) == 1000);   // 0.01 degC
  CHECK(esp32.status().i2c_errors == 0);
}

TEST_CASE("A bus that a device holds down is clocked free, and nothing else notices") {
  fake::Flash flash;
  Esp32 esp32(flash);
  brov::set_fixed_readings(esp32.machine.i2c(), 250000.0, 10.0);
  esp32.boot();
  esp32.run_for(2000000);
  REQUIRE(depth_ok(esp32.frames(MessageType::kSensors).back()));

  esp32.machine.hold_sda_for(9);
  esp32.longest_pass_us = 0;
  esp32.run_for(1600000);
  CHECK_FALSE(esp32.machine.i2c_blocked());
  CHECK(esp32.status().i2c_errors >= 5);
  esp32.run_for(3000000);
  CHECK(depth_ok(esp32.frames(MessageType::kSensors).back()));
  CHECK(temperature_ok(esp32.frames(MessageType::kSensors).back()));
  CHECK(esp32.longest_pass_us < 4000);
  CHECK(worst_lateness_us(esp32.frames(MessageType::kSensors)) < 3000);
}

TEST_CASE("A bus that is dead for good costs a few milliseconds now and then") {
  fake::Flash flash;
  Esp32 esp32(flash);
  brov::set_fixed_readings(esp32.machine.i2c(), 250000.0, 10.0);
  esp32.machine.hold_sda_for(1000000);
  SUBCASE("a line held down") {}
  SUBCASE("free to look at, but no transfer ever ends") {
    esp32.machine.hold_sda_for(0);
    esp32.machine.set_i2c_hangs(true);
  }
  feed_pings(esp32.machine.uart(kSonarA), 1000, 5, 500000, 5);
  esp32.boot();
  esp32.run_until(6000000);
  const auto sensors = esp32.frames(MessageType::kSensors);
  CHECK(sensors.size() == 12);
  CHECK_FALSE(depth_ok(sensors.back()));
  CHECK(a_bytes(sensors.back()) == 25 * ping(1000).size());
  CHECK(esp32.status().overflow_bytes[0] == 0);
  CHECK(esp32.longest_pass_us < 13000);  // both sensors time out in the same pass
  CHECK_FALSE(esp32.machine.watchdog_bites());
}

TEST_CASE("The watchdog is fed by every task that could hang, and bites when one does") {
  fake::Flash flash;
  Esp32 esp32(flash);
  esp32.boot();
  esp32.run_for(5000000);
  std::size_t watched = 0;
  for (const auto& task : esp32.machine.tasks()) watched += task->watched;
  CHECK(watched == 3);
  CHECK(esp32.machine.longest_unfed_us() <= 1000000);
  CHECK_FALSE(esp32.machine.watchdog_bites());
  esp32.machine.spend(2500000);  // the loop hangs
  CHECK_FALSE(esp32.machine.watchdog_bites());
  esp32.machine.spend(1000000);
  CHECK(esp32.machine.watchdog_bites());
}

TEST_CASE("What CONFIG set survives the power") {
  fake::Flash flash;
  {
    Esp32 esp32(flash);
    esp32.boot();
    esp32.run_for(100000);
    esp32.command(0x22, config(1, {{1, 5000}, {2, 10000}, {3, 2}}));
    esp32.run_for(50000);
    const auto acks = esp32.frames(MessageType::kCommandAck);
    REQUIRE(acks.size() == 1);
    CHECK(acks[0].payload == unhex("220100"));
  }
  CHECK(flash.values.at("brov-settings/decimation") == 2);
  CHECK(flash.values.at("brov-settings/imu_mhz") == 10000);
  {
    Esp32 esp32(flash);
    esp32.boot();
    esp32.run_for(2000000);
    CHECK(esp32.frames(MessageType::kSensors).size() == 10);
  }
  flash.values["brov-settings/sensors_mhz"] = 0;  // nothing that CONFIG would have allowed
  Esp32 esp32(flash);
  esp32.boot();
  esp32.run_for(2000000);
  CHECK(esp32.frames(MessageType::kSensors).size() == 4);
}

TEST_CASE("The line changes its rate between two frames, and back when nobody answers") {
  fake::Flash flash;
  Esp32 esp32(flash);
  // Enough for the fast line to be busy nearly always, so that the change back finds it busy too.
  feed_pings(esp32.machine.uart(kSonarA), 3000, 20, 300000, 10);
  esp32.boot();
  esp32.run_for(1000000);
  esp32.command(0x22, config(5, {{4, 921600}}));
  esp32.run_for(1000000);
  CHECK(esp32.machine.uart(0).baud() == 921600);
  const auto acks = esp32.frames(MessageType::kCommandAck);  // frames() has checked that none was cut
  REQUIRE(acks.size() == 1);
  CHECK(acks[0].baud == 115200);
  SUBCASE("the host speaks at the new rate") {
    esp32.command(0x23, time_sync(6, 1), 921600);
    esp32.run_for(6000000);
    CHECK(esp32.machine.uart(0).baud() == 921600);
    CHECK(esp32.frames().back().baud == 921600);
  }
  SUBCASE("silence") {
    esp32.run_for(6000000);
    CHECK(esp32.machine.uart(0).baud() == 115200);
    CHECK(esp32.frames().back().baud == 115200);
  }
}

TEST_CASE("A full line: SENSORS first, no gap") {
  fake::Flash flash;
  Esp32 esp32(flash);
  feed_pings(esp32.machine.uart(kSonarA), 3000, 10, 300000, 8);
  feed_pings(esp32.machine.uart(kSonarB), 3000, 10, 350000, 8);
  esp32.boot();

  SUBCASE("115200") {
    esp32.run_until(400000);
    esp32.command(0x22, config(1, {{1, 19130}}));  // SENSORS out of step with everything, and often
    esp32.run_until(8000000);
    const auto all = esp32.frames();
    // SENSORS waits for no more than one window of 230 bytes, and two of the system's ticks.
    CHECK(worst_lateness_us(esp32.frames(MessageType::kSensors)) < 22000);
    CHECK(esp32.frames(MessageType::kSensors).size() >= 145);
    std::vector<LinkFrame> later;
    for (const LinkFrame& frame : all) {
      if (frame.start_us >= 4000000) later.push_back(frame);
    }
    const double seconds = static_cast<double>(later.back().end_us - later.front().start_us) / 1e6;
    CHECK(static_cast<double>(bytes_of(later)) >= 0.95 * 11520.0 * seconds);
    CHECK(esp32.status().link_load_percent >= 95);
    CHECK(esp32.status().pings_dropped[0] > 0);
  }
  SUBCASE("921600") {
    esp32.run_until(1000000);
    esp32.command(0x22, config(5, {{4, 921600}}));
    esp32.run_until(1500000);
    esp32.command(0x23, time_sync(6, 1), 921600);
    esp32.run_until(3000000);
    const std::size_t before = esp32.frames(MessageType::kSensors).size();
    const brov::StatusFields early = esp32.status();
    esp32.run_until(8200000);
    const auto sensors = esp32.frames(MessageType::kSensors);
    CHECK(worst_lateness_us({sensors.begin() + static_cast<std::ptrdiff_t>(before), sensors.end()}) < 7000);
    const brov::StatusFields late = esp32.status();
    for (const std::size_t channel : {0u, 1u}) {
      CHECK(late.pings_dropped[channel] == early.pings_dropped[channel]);
      CHECK(late.overflow_bytes[channel] == 0);
    }
    CHECK(esp32.machine.uart(kSonarA).bytes_lost() == 0);
  }
}

TEST_CASE("The texts of the reset reasons") {
  CHECK(std::string(brov::reset_reason_text(6)) == "task watchdog");
  CHECK(std::string(brov::reset_reason_text(11)) == "unknown");
  for (const int wanted : {1, 2, 3, 8, 10, 0}) CHECK_FALSE(brov::is_fault(static_cast<std::uint8_t>(wanted)));
  for (const int fault : {4, 5, 6, 7, 9}) CHECK(brov::is_fault(static_cast<std::uint8_t>(fault)));
}
