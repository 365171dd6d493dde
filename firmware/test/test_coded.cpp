#include <doctest/doctest.h>

#include <random>

#include "brov/coded.h"
#include "hex.h"
#include "vectors.h"

using namespace brov;

namespace {

Buffer encoded(const Buffer& samples, std::size_t size) {
  const Bytes part = view(samples);
  Buffer code(size, 0xEE);
  encode_samples({&part, 1, 0, false}, code.data(), size);
  return code;
}

// The samples of a code, empty if it is none.
Buffer decoded(const Buffer& code, std::size_t count) {
  Buffer samples(count);
  return decode_samples(view(code), samples.data(), count) ? samples : Buffer();
}

// Samples that stand for `group` of a sub-channel each.
std::size_t coded_count(std::size_t samples, std::size_t group, std::size_t channels) {
  std::size_t count = 0;
  for (std::size_t channel = 0; channel < channels; ++channel) {
    count += ((samples + channels - 1 - channel) / channels + group - 1) / group;
  }
  return count;
}

// The samples of every chunk of a coded payload, rebuilt as docs/protocol.md says.
std::vector<Buffer> rebuilt(const Buffer& payload) {
  const std::size_t channels = (payload[1] >> 2 & 7) + 1u, decimation = payload[2], group = decimation >= 6 ? 2 : 1;
  Buffer code;
  std::vector<std::size_t> sizes;
  std::size_t count = 0;
  for (std::size_t at = 9; at < payload.size();) {
    sizes.push_back(payload[at + 6]);
    const std::size_t bytes = coded_count(sizes.back(), decimation, channels);
    code.insert(code.end(), payload.begin() + static_cast<long>(at) + 7, payload.begin() + static_cast<long>(at + 7 + bytes));
    count += coded_count(sizes.back(), group, channels);
    at += 7 + bytes;
  }
  const Buffer values = decoded(code, count);
  REQUIRE(values.size() == count);
  std::vector<Buffer> chunks;
  for (const std::size_t size : sizes) chunks.emplace_back(size);
  std::size_t at = 0;
  for (std::size_t channel = 0; channel < channels; ++channel) {
    for (Buffer& chunk : chunks) {
      for (std::size_t i = channel; i < chunk.size(); i += group * channels, ++at) {
        chunk[i] = values[at];
        if (group == 2 && i + channels < chunk.size()) chunk[i + channels] = values[at];
      }
    }
  }
  return chunks;
}

}  // namespace

TEST_CASE("the shared coded payloads, decoded") {
  int payloads = 0;
  for (const auto& vector : vectors::bundles) {
    if (vector.coding != 2 || vector.decimation == 1 || std::string(vector.name) == "coded_short") continue;
    CAPTURE(vector.name);
    std::vector<std::string> samples;
    for (const char* payload : vector.payloads) {
      for (const Buffer& chunk : rebuilt(unhex(payload))) samples.push_back(to_hex(chunk));
      ++payloads;
    }
    REQUIRE(samples.size() == vector.frames.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const std::string frame = vector.frames[i];
      CHECK(samples[i] == frame.substr(24, frame.size() - 28));  // behind sync, header and offsets, before the checks
    }
  }
  CHECK(payloads >= 10);
}

TEST_CASE("any run that fits is coded in exactly its bytes") {
  std::mt19937 random(1);
  for (int round = 0; round < 300; ++round) {
    const std::size_t size = 16 + random() % 200, count = 1 + random() % (8 * size - 15);
    Buffer samples(count);
    const unsigned spread = 1u << random() % 9;
    for (auto& sample : samples) sample = static_cast<std::uint8_t>(random() % spread);
    const Buffer result = decoded(encoded(samples, size), count);
    REQUIRE(result.size() == count);
    CHECK(result[0] == samples[0]);
  }
}

TEST_CASE("the longest run fits however wild it is, and a constant is kept") {
  Buffer wild(8 * 16 - 15);
  for (std::size_t i = 0; i < wild.size(); ++i) wild[i] = i % 2 == 0 ? 0 : 255;
  CHECK(decoded(encoded(wild, 16), wild.size()) == Buffer(wild.size(), 0));
  for (const std::uint8_t value : Buffer{0, 1, 128, 255}) {
    const Buffer constant(100, value);
    CHECK(decoded(encoded(constant, 16), 100) == constant);
  }
}

TEST_CASE("pairs and sub-channels come in their order") {
  const Buffer first = {10, 20, 30, 40, 50}, second = {60, 70, 80};
  const Bytes parts[] = {view(first), view(second)};
  const auto order = [&](std::uint8_t version, bool pairs) {
    Buffer values;
    const SampleRun run{parts, 2, version, pairs};
    run.each([&](Bytes some) { values.insert(values.end(), some.data, some.data + some.size); });
    CHECK(run.size() == values.size());
    return values;
  };
  CHECK(order(0, false) == Buffer{10, 20, 30, 40, 50, 60, 70, 80});
  CHECK(order(0, true) == Buffer{15, 35, 50, 65, 80});
  CHECK(order(1, false) == Buffer{10, 30, 50, 60, 80, 20, 40, 70});
  CHECK(order(1, true) == Buffer{20, 50, 70, 30, 70});
}

TEST_CASE("what is no code is refused") {
  Buffer samples(300);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<std::uint8_t>(i * 7919 % 61);
  const Buffer code = encoded(samples, 75);
  REQUIRE(decoded(code, 300).size() == 300);
  const auto with = [&](std::size_t at, std::uint8_t value) {
    Buffer changed = code;
    changed[at] = value;
    return changed;
  };
  CHECK(decoded(with(0, 240), 300).size() == 300);
  CHECK(decoded(with(0, 241), 300).empty());
  CHECK(decoded(with(74, static_cast<std::uint8_t>(code[74] | 1)), 300).empty());       // padding
  CHECK(decoded(Buffer(75, 0), 300).empty());                // no symbols
  CHECK(decoded(Buffer(code.begin(), code.end() - 8), 300).empty());
  CHECK(decoded(Buffer(15, 0), 1).empty());
  CHECK(decoded(code, 0).empty());
  CHECK(decoded(code, 299).empty());
  CHECK(decoded(code, 5000).empty());
}
