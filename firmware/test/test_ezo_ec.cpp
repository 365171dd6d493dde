#include <doctest/doctest.h>

#include "reader_rig.h"

using namespace brov;

namespace {

constexpr std::uint64_t kSecond = 1000000;

struct Probe {
  // Every line a second after the one before.
  void say(const std::string& text) {
    now_us += kSecond;
    reader.feed(bytes_of(text), now_us);
  }
  SensorFields fields() const { return fields(now_us); }
  SensorFields fields(std::uint64_t at_us) const {
    SensorFields fields;
    reader.fill(fields, at_us);
    return fields;
  }

  std::uint64_t now_us = 0;
  EzoEcReader reader;
};

Probe awake() {
  Probe probe;
  probe.say("*OK\r");
  return probe;
}

}  // namespace

TEST_CASE("a reading with salinity") {
  Probe probe = awake();
  probe.say("53120,34.57\r");
  const SensorFields fields = probe.fields();
  CHECK(fields.ec_alive == 1);
  CHECK(fields.full_conductivity_dus == 531200);
  CHECK(fields.conductivity_dus == 0xFFFF);
  CHECK(fields.ec_salinity_cpsu == 3457);
  CHECK(probe.reader.errors() == 0);
}

TEST_CASE("a reading without salinity") {
  Probe probe = awake();
  probe.say("12.85\r");
  CHECK(probe.fields().full_conductivity_dus == 129);  // half up
  CHECK(probe.fields().conductivity_dus == 129);
  CHECK(probe.fields().ec_salinity_cpsu == 0xFFFF);
}

TEST_CASE("line feeds and empty lines mean nothing") {
  Probe probe = awake();
  probe.say("1413,0.70\r\n\r\n");
  CHECK(probe.fields().full_conductivity_dus == 14130);
  CHECK(probe.fields().ec_salinity_cpsu == 70);
  CHECK(probe.reader.errors() == 0);
}

TEST_CASE("answers and reports of the probe's state are no readings and no errors") {
  Probe probe = awake();
  for (const char* line : {"*OK", "*RS", "*RE", "*WA", "*UV", "*OV", "*SL", "?O,EC,S", "?I,EC,2.16"}) {
    probe.say(std::string(line) + "\r");
  }
  CHECK(probe.reader.errors() == 0);
  CHECK(probe.fields().ec_alive == 0);
}

TEST_CASE("anything else is an error") {
  const char* lines[] = {"*ER", "*", "hello", "-5", "1e4", "53120,", ",34.5", "53120,34.5,", "53120,26560,34.57,1.025",
                         "53120,42.01", "53120,26560", "5 3120", "53120,-1", "53.120.1", "no output"};
  Probe probe = awake();
  for (const char* line : lines) {
    probe.say(std::string(line) + "\r");
  }
  CHECK(probe.reader.errors() == sizeof lines / sizeof lines[0]);
  CHECK(probe.fields().ec_alive == 0);
}

TEST_CASE("the largest numbers saturate below the mark of the unknown") {
  Probe probe = awake();
  probe.say("1677721.4,42.00\r");
  CHECK(probe.fields().full_conductivity_dus == 0xFFFFFE);
  probe.say("99999999999999999999999999999,42\r");
  CHECK(probe.fields().full_conductivity_dus == 0xFFFFFE);
  CHECK(probe.fields().ec_salinity_cpsu == 4200);
}

TEST_CASE("a line of forty characters is read, of forty-one not, and the next one is") {
  Probe probe = awake();
  probe.say(std::string(35, '0') + "53120\r");
  CHECK(probe.fields().full_conductivity_dus == 531200);
  probe.say(std::string(36, '0') + "53121\r");
  CHECK(probe.reader.errors() == 1);
  CHECK(probe.fields().full_conductivity_dus == 531200);
  probe.say("53122\r");
  CHECK(probe.fields().full_conductivity_dus == 531220);
}

TEST_CASE("the first line after boot may have lost its head") {
  Probe probe;
  probe.say("120,34.57\r");
  CHECK(probe.fields().ec_alive == 0);
  CHECK(probe.reader.errors() == 0);
  probe.say("53120,34.57\r");
  CHECK(probe.fields().full_conductivity_dus == 531200);
}

TEST_CASE("so may the first one after a silence") {
  Probe probe = awake();
  probe.say("53120,34.57\r");
  probe.now_us += 3 * kSecond;
  probe.say("120,34.57\r");
  CHECK(probe.fields().ec_alive == 0);
  probe.say("53130,34.57\r");
  CHECK(probe.fields().full_conductivity_dus == 531300);
}

TEST_CASE("unplugged in mid-line and back: neither the joined line nor the next is believed") {
  Probe probe = awake();
  probe.say("53");
  probe.say("53120,34.57\r");
  CHECK(probe.fields().ec_alive == 0);
  CHECK(probe.reader.errors() == 1);
  probe.say("53120,34.57\r");
  CHECK(probe.fields().full_conductivity_dus == 531200);
  CHECK(probe.reader.errors() == 1);
}

TEST_CASE("every split point gives the same reading") {
  const std::string line = "53120,34.57\r";
  for (std::size_t split = 0; split <= line.size(); ++split) {
    Probe probe = awake();
    probe.say(line.substr(0, split));
    probe.now_us += 20000;
    probe.reader.feed(bytes_of(line.substr(split)), probe.now_us);
    CHECK(probe.fields().full_conductivity_dus == 531200);
    CHECK(probe.reader.errors() == 0);
  }
}

TEST_CASE("a reading is alive for three seconds") {
  Probe probe = awake();
  probe.say("53120,34.57\r");
  CHECK(probe.reader.alive(probe.now_us + 3 * kSecond));
  CHECK_FALSE(probe.reader.alive(probe.now_us + 3 * kSecond + 1));
  CHECK(probe.fields(probe.now_us + 3 * kSecond + 1).full_conductivity_dus == 0xFFFFFF);
}

TEST_CASE("a silent probe is configured at boot and every fifteen seconds") {
  EzoEcReader reader;
  KeptWrites hal;
  reader.start(0);
  for (std::uint64_t now_us = 1000; now_us <= 20 * kSecond; now_us += 1000) {
    reader.configure(now_us, hal);
  }
  REQUIRE(hal.writes.size() == 10);
  const char* commands[] = {"O,EC,1\r", "O,S,1\r", "O,TDS,0\r", "O,SG,0\r", "C,1\r"};
  for (std::size_t i = 0; i < 10; ++i) {
    CHECK(hal.writes[i].port == Port::kEc);
    CHECK(hal.writes[i].hex == to_hex(bytes_of(commands[i % 5])));
    CHECK(hal.writes[i].at_us == (i < 5 ? 700000 : 15700000) + (i % 5) * 400000);
  }
}

TEST_CASE("a probe that sends both numbers is left alone, one that sends one is told again") {
  for (const bool both : {true, false}) {
    EzoEcReader reader;
    KeptWrites hal;
    reader.start(0);
    for (std::uint64_t now_us = 1000; now_us <= 40 * kSecond; now_us += 1000) {
      if (now_us % kSecond == 0) {
        reader.feed(bytes_of(both ? "53120,34.57\r" : "53120\r"), now_us);
      }
      reader.configure(now_us, hal);
    }
    CHECK(hal.writes.size() == (both ? 5 : 15));
  }
}
