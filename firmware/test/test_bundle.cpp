#include <doctest/doctest.h>

#include "brov/bundle.h"
#include "hex.h"
#include "vectors.h"

using namespace brov;

namespace {

class Payloads final : public BundlePacker::Sink {
 public:
  void payload(Bytes payload) override { found.push_back(to_hex(payload)); }
  std::vector<std::string> found;
};

std::string decimated(const std::string& samples, std::uint8_t decimation, Coding coding, std::uint8_t version = 0) {
  const Buffer bytes = unhex(samples);
  Buffer into(bytes.size());
  const std::size_t size = decimate(view(bytes), decimation, coding, version, into.data());
  REQUIRE(size <= into.size());
  return to_hex(view(into).first(size));
}

}  // namespace

TEST_CASE("the shared pings, packed") {
  REQUIRE(vectors::bundles.size() == 23);
  for (const auto& vector : vectors::bundles) {
    CAPTURE(vector.name);
    Payloads payloads;
    BundlePacker packer(static_cast<Channel>(vector.channel), vector.decimation, static_cast<Coding>(vector.coding),
                        vector.payload_limit, payloads);
    packer.begin(vector.ping_number, vector.t_us, vector.version, vector.mark);
    std::vector<Buffer> samples;
    for (const auto& chunk : vector.chunks) {
      samples.push_back(unhex(chunk.samples));
      packer.add({chunk.seq_offset, chunk.resolution_mm, chunk.first_sample, view(samples.back())});
    }
    packer.end();
    CHECK(payloads.found == std::vector<std::string>(vector.payloads.begin(), vector.payloads.end()));
  }
}

TEST_CASE("means round half up, and a short last group counts only what it has") {
  CHECK(decimated("00000001", 4, Coding::kMean) == "00");      // 0.25
  CHECK(decimated("00000101", 4, Coding::kMean) == "01");      // 0.5
  CHECK(decimated("fffffffe", 4, Coding::kMean) == "ff");      // 254.75
  CHECK(decimated("fffffefe", 4, Coding::kMean) == "ff");      // 254.5
  CHECK(decimated("fffefefe", 4, Coding::kMean) == "fe");      // 254.25
  CHECK(decimated("ffffffff", 4, Coding::kMean) == "ff");
  CHECK(decimated("0a0a0a0a14", 4, Coding::kMean) == "0a14");  // 20 alone, not 20 / 4
  CHECK(decimated("0a0a0a0a1415", 4, Coding::kMean) == "0a15");
  CHECK(decimated("0102030405060708", 8, Coding::kMean) == "05");  // 4.5
  CHECK(decimated("010203", 1, Coding::kMean) == "010203");
  CHECK(decimated("", 4, Coding::kMean) == "");
}

TEST_CASE("peaks are maxima") {
  CHECK(decimated("0001fe02030405", 4, Coding::kPeak) == "fe05");
  CHECK(decimated("00000000ff", 4, Coding::kPeak) == "00ff");
}

TEST_CASE("sub-channels of version 1 never mix") {
  CHECK(decimated("00ff00ff00ff00ff", 4, Coding::kMean, 1) == "00ff");
  CHECK(decimated("00ff00ff00ff00ff10", 4, Coding::kMean, 1) == "00ff10");
  CHECK(decimated("01", 4, Coding::kMean, 1) == "01");
  // 21 bytes: 11 and 10 samples, three groups of each.
  CHECK(decimated("00ff00ff00ff00ff00ff00ff00ff00ff00ff00ff00", 4, Coding::kPeak, 1) == "00ff00ff00ff");
}

TEST_CASE("a chunk that reaches 20 000 samples is left out") {
  const Buffer samples(100, 7);
  Payloads payloads;
  BundlePacker packer(Channel::kA, 4, Coding::kMean, kPayloadLimitSlow, payloads);
  packer.begin(1, 2, 0, false);
  packer.add({19900, 20, 0, view(samples)});
  packer.end();
  CHECK(payloads.found.empty());
  packer.begin(1, 2, 0, false);
  packer.add({19899, 20, 0, view(samples)});
  packer.end();
  CHECK(payloads.found.size() == 1);
}

TEST_CASE("a ping without chunks makes no payload, and an ended one leaves nothing to the next") {
  const Buffer samples(8, 7);
  Payloads payloads;
  BundlePacker packer(Channel::kB, 4, Coding::kMean, kPayloadLimitSlow, payloads);
  packer.begin(1, 2, 0, true);
  packer.end();
  CHECK(payloads.found.empty());
  packer.begin(1, 2, 0, true);
  packer.add({0, 20, 0, view(samples)});
  packer.end();
  packer.begin(2, 0x01020304, 0, false);
  packer.add({0, 20, 0, view(samples)});
  packer.end();
  REQUIRE(payloads.found.size() == 2);
  CHECK(payloads.found[0] == "016004010102000000" "00001400000008" "0707");
  CHECK(payloads.found[1] == "014004010204030201" "00001400000008" "0707");
}
