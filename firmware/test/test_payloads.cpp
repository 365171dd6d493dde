#include <doctest/doctest.h>

#include "brov/aa55.h"
#include "brov/payloads.h"
#include "hex.h"
#include "vectors.h"

using namespace brov;

namespace {

std::string frame_hex(MessageType type, Bytes payload) {
  Buffer frame(payload.size + kFrameOverhead);
  CHECK(encode_frame(type, payload, frame.data()) == frame.size());
  return to_hex(frame);
}

template <typename Fields, std::size_t Size>
void check_packed(const std::vector<vectors::Packed<Fields>>& expected, MessageType type,
                  void (*pack)(const Fields&, std::uint8_t (&)[Size])) {
  REQUIRE_FALSE(expected.empty());
  for (const auto& vector : expected) {
    CAPTURE(vector.name);
    std::uint8_t payload[Size];
    pack(vector.fields, payload);
    CHECK(frame_hex(type, {payload, Size}) == vector.frame);
  }
}

}  // namespace

TEST_CASE("SENSORS as in the shared vectors") { check_packed(vectors::sensors, MessageType::kSensors, pack_sensors); }

TEST_CASE("STATUS as in the shared vectors") { check_packed(vectors::status, MessageType::kStatus, pack_status); }

TEST_CASE("GPS as in the shared vectors") { check_packed(vectors::gps, MessageType::kGps, pack_gps); }

TEST_CASE("IMU_BURST as in the shared vectors") {
  REQUIRE_FALSE(vectors::imu_bursts.empty());
  for (const auto& vector : vectors::imu_bursts) {
    CAPTURE(vector.name);
    const auto count = static_cast<std::uint8_t>(vector.samples.size());
    Buffer payload(kImuBurstHeaderBytes + count * kImuSampleBytes);
    const std::size_t size = pack_imu_burst(vector.t0_us, vector.dt_us, vector.samples.data(), count, payload.data());
    CHECK(size == payload.size());
    CHECK(frame_hex(MessageType::kImuBurst, view(payload)) == vector.frame);
  }
}

TEST_CASE("COMMAND_ACK as in the shared vectors") {
  REQUIRE(vectors::acks.size() == 5);
  for (const auto& vector : vectors::acks) {
    CAPTURE(vector.name);
    std::uint8_t payload[kAckBytes];
    pack_ack(vector.acked_type, vector.sequence, static_cast<AckResult>(vector.result), payload);
    CHECK(frame_hex(MessageType::kCommandAck, {payload, kAckBytes}) == vector.frame);
  }
}

TEST_CASE("unknown SENSORS values are those that the page reads as unavailable") {
  std::uint8_t payload[kSensorsBytes];
  pack_sensors({}, payload);
  CHECK(payload[40] == 1);
  CHECK(to_hex(Bytes{payload + 35, 4}) == "ffffffff");
  CHECK(to_hex(Bytes{payload + 41, 8}) == "ffffffffffffffff");
  CHECK(to_hex(Bytes{payload + 55, 5}) == "ffffffffff");
}
