#include <doctest/doctest.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "native/lockstep.h"
#include "rig.h"

using namespace brov;

namespace {

void put(Buffer& into, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) into.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}

// Messages to the program, one behind the other.
struct Script {
  Script& boot(std::uint64_t boot_us = 0, std::uint32_t baud = 115200, std::uint32_t sensors_rate_mhz = 2000) {
    bytes.push_back('B');
    put(bytes, boot_us, 8);
    put(bytes, 3, 2);
    put(bytes, 1, 1);
    put(bytes, baud, 4);
    put(bytes, sensors_rate_mhz, 4);
    put(bytes, 20000, 4);
    put(bytes, 4, 1);
    put(bytes, 0, 1);
    return *this;
  }
  Script& feed(std::uint8_t port, std::uint64_t at_us, const Buffer& data) {
    bytes.push_back('F');
    put(bytes, port, 1);
    put(bytes, at_us, 8);
    put(bytes, data.size(), 2);
    append(bytes, data);
    return *this;
  }
  Script& i2c(std::uint8_t what, std::uint64_t at_us, const Buffer& data) {
    bytes.push_back('I');
    put(bytes, what, 1);
    put(bytes, at_us, 8);
    put(bytes, data.size(), 1);
    append(bytes, data);
    return *this;
  }
  Script& run(std::uint64_t until_us) {
    bytes.push_back('R');
    put(bytes, until_us, 8);
    return *this;
  }
  Buffer bytes;
};

struct Output {
  int sink;
  std::uint64_t at_us;
  Buffer data;
};

struct Result {
  int exit_code;
  std::vector<Output> outputs;
  std::vector<std::uint64_t> done_us;
  std::string errors;

  std::vector<Output> of(int sink) const {
    std::vector<Output> some;
    for (const Output& output : outputs) {
      if (output.sink == sink) some.push_back(output);
    }
    return some;
  }
};

Buffer content(std::FILE* file) {
  std::rewind(file);
  Buffer bytes;
  for (int byte; (byte = std::fgetc(file)) != EOF;) bytes.push_back(static_cast<std::uint8_t>(byte));
  std::fclose(file);
  return bytes;
}

Result play(const Script& script) {
  std::FILE* in = std::tmpfile();
  std::FILE* out = std::tmpfile();
  std::FILE* errors = std::tmpfile();
  for (const std::uint8_t byte : script.bytes) std::fputc(byte, in);
  std::rewind(in);
  Result result;
  result.exit_code = run_lockstep(in, out, errors);
  std::fclose(in);
  const Buffer text = content(errors);
  result.errors.assign(text.begin(), text.end());
  const Buffer bytes = content(out);
  for (std::size_t at = 0; at < bytes.size();) {
    if (bytes[at] == 'D') {
      result.done_us.push_back(get_u64(bytes.data() + at + 1));
      at += 9;
    } else {
      REQUIRE(bytes[at] == 'O');
      const std::size_t size = get_u16(bytes.data() + at + 10);
      const auto data = bytes.begin() + static_cast<std::ptrdiff_t>(at + 12);
      result.outputs.push_back({bytes[at + 1], get_u64(bytes.data() + at + 2),
                                Buffer(data, data + static_cast<std::ptrdiff_t>(size))});
      at += 12 + size;
    }
  }
  return result;
}

using Times = std::vector<std::uint64_t>;

}  // namespace

TEST_CASE("The program gives the frames that the board hands over, each with its tick") {
  const Result result = play(Script().boot().run(450000));
  CHECK(result.exit_code == 0);
  CHECK(result.done_us == Times{450000});
  REQUIRE(result.outputs.size() == 2);
  CHECK(result.outputs[0].at_us == 50000);
  CHECK(result.outputs[0].data[2] == 0x01);
  CHECK(result.outputs[0].data.size() == 82);
  CHECK(result.outputs[1].at_us == 200000);
  CHECK(result.outputs[1].data[2] == 0x06);
  Rig rig;
  rig.run_until(450000);
  CHECK(result.outputs[1].data.size() == rig.hal.link[1].bytes());
}

TEST_CASE("A run ends behind the tick that gave more than frames, and goes on from there") {
  const Buffer inner = kogger_frame(0x20, {}, {3, 0, false, true});
  Script script;
  script.boot().feed(0, 100200, frame_of(0x20, kogger_command(1, inner)));
  script.feed(0, 100200, frame_of(0x21, kogger_command(2, inner)));
  script.run(300000).run(300000).run(299999);
  const Result result = play(script);
  CHECK(result.exit_code == 0);
  CHECK(result.done_us == Times{101000, 300000, 299999});
  REQUIRE(result.of(1).size() == 1);
  REQUIRE(result.of(2).size() == 1);
  CHECK(result.of(1)[0].data == inner);
  CHECK(result.of(1)[0].at_us == 101000);
  const auto link = result.of(0);
  for (std::size_t i = 1; i < link.size(); ++i) CHECK(link[i].at_us >= link[i - 1].at_us);
  CHECK(link.size() == 4);  // SENSORS, two acknowledgements, STATUS; no tick ran twice
}

TEST_CASE("Ticks are the multiples of 1 ms behind the boot") {
  const Result result = play(Script().boot(2999999).run(3049000).run(3049999).run(3050000));
  CHECK(result.done_us == Times{3049000, 3049999, 3050000});
  CHECK(result.outputs.size() == 1);
  const Result odd = play(Script().boot(3000500).run(3060000));
  REQUIRE(odd.outputs.size() == 1);
  CHECK(odd.outputs[0].at_us == 3051000);  // due at 3 050 500
}

TEST_CASE("Bytes are taken at the first tick at or behind their arrival") {
  Script script;
  script.boot().feed(0, 10000, frame_of(0x30, {1})).feed(0, 10001, frame_of(0x31, {2})).run(40000);
  const Result result = play(script);
  REQUIRE(result.outputs.size() == 2);
  CHECK(result.outputs[0].at_us == 10000);
  CHECK(result.outputs[1].at_us == 11000);
}

TEST_CASE("Settings saved, changed baud and I2C recovery are told") {
  Script script;
  script.boot().i2c(4, 0, {3}).run(30000).run(5000000).run(5000000).run(5000000).run(5000000).run(5000000);
  const Result silent = play(script);
  REQUIRE(!silent.of(18).empty());
  CHECK(silent.of(18)[0].data.empty());

  Script config_script;
  config_script.boot().feed(0, 1000, frame_of(0x22, config(1, {{1, 3000}, {2, 4000}, {3, 5}, {4, 921600}})));
  config_script.run(40000).run(40000).run(40000);
  const Result changed = play(config_script);
  REQUIRE(changed.of(17).size() == 1);
  const Buffer saved = changed.of(17)[0].data;
  REQUIRE(saved.size() == 9);
  CHECK(get_u32(saved.data()) == 3000);
  CHECK(get_u32(saved.data() + 4) == 4000);
  CHECK(saved[8] == 5);
  REQUIRE(changed.of(16).size() == 1);
  CHECK(get_u32(changed.of(16)[0].data.data()) == 921600);
}

TEST_CASE("A boot forgets inputs and state, but the I2C devices keep what they were told") {
  Script script;
  const Buffer prom = {0, 0, 0xA6, 0x88, 0, 0x8E, 0x68, 0x4F, 0x52, 0x57, 0x16, 0x68, 0x22, 0x66};
  Buffer checked = prom;
  std::uint16_t words[7];
  for (std::uint16_t crc = 0; crc < 16; ++crc) {
    checked[1] = static_cast<std::uint8_t>(crc << 4);
    for (std::size_t i = 0; i < 7; ++i) words[i] = get_u16(checked.data() + 2 * i);
    if (ms5837_prom_ok(words)) break;
  }
  Buffer adc;
  put(adc, 4958179, 4);
  put(adc, 6815414, 4);
  script.boot().i2c(0, 0, checked).i2c(2, 900000, adc).feed(0, 990000, frame_of(0x30, {1})).run(480000);
  script.boot(0, 921600).run(600000).run(600000);
  const Result result = play(script);
  CHECK(result.exit_code == 0);
  const auto link = result.of(0);
  REQUIRE(!link.empty());
  const Buffer& last = link.back().data;
  CHECK(last[2] == 0x01);
  CHECK(last[5 + 51] == 1);
  CHECK(get_u16(last.data() + 5 + 47) > 0);
  for (const Output& output : link) CHECK(output.data[2] != 0x07);
}

TEST_CASE("A malformed message ends the program with one line and code 2") {
  struct Case {
    const char* what;
    Script script;
  };
  Case cases[] = {{"unknown letter", {}}, {"run before boot", {}}, {"cut off", {}},     {"port", {}},
                  {"time", {}},           {"setting", {}},         {"i2c length", {}}, {"i2c kind", {}},
                  {"bus state", {}},      {"baud", {}}};
  cases[0].script.bytes = {'X'};
  cases[1].script.run(1000);
  cases[2].script.boot().run(1000).bytes.pop_back();
  cases[3].script.boot().feed(6, 0, {1});
  cases[4].script.boot().feed(1, 2000, {1}).feed(2, 1000, {1}).feed(1, 1999, {1});
  cases[5].script.boot(0, 115200, 0);
  cases[6].script.boot().i2c(0, 0, {1, 2});
  cases[7].script.boot().i2c(5, 0, {1});
  cases[8].script.boot().i2c(4, 0, {5});
  cases[9].script.boot(0, 9600);
  for (const Case& c : cases) {
    CAPTURE(c.what);
    const Result result = play(c.script);
    CHECK(result.exit_code == 2);
    CHECK(std::count(result.errors.begin(), result.errors.end(), '\n') == 1);
  }
  CHECK(play({}).exit_code == 0);
}
