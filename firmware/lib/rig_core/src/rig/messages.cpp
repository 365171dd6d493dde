#include "rig/messages.h"

namespace brov::rig {

namespace {

constexpr float kNanoPerMm = 1e6f, kNano = 1e9f;

std::int32_t get_i32(const std::uint8_t* at) { return static_cast<std::int32_t>(get_u32(at)); }

std::size_t body_bytes(std::uint8_t type) {
  switch (static_cast<RigMessage>(type)) {
    case RigMessage::kState: return kStateBytes;
    case RigMessage::kAck: return kRigAckBytes;
    case RigMessage::kImu: return kImuBytes;
    case RigMessage::kMove: return kMoveBytes;
    case RigMessage::kStop:
    case RigMessage::kWhere: return kSequenceBytes;
    case RigMessage::kReadImu: return kReadImuBytes;
    case RigMessage::kServos: return kServosBytes;
  }
  return 0;
}

bool length_allowed(std::uint8_t type, std::size_t length) {
  const std::size_t body = body_bytes(type);
  return body != 0 && length == body + kCrcBytes;
}

bool content_intact(std::uint8_t type, Bytes payload) {
  const Bytes body = payload.first(payload.size - kCrcBytes);
  return get_u16(payload.data + body.size) == message_crc(type, body);
}

// Numbers one behind the other into a body, and the frame around it.
class Writer {
 public:
  explicit Writer(RigMessage type) : type_(static_cast<std::uint8_t>(type)) {}
  Writer& u8(std::uint8_t v) {
    body_[size_++] = v;
    return *this;
  }
  Writer& u16(std::uint16_t v) {
    put_u16(body_ + size_, v);
    size_ += 2;
    return *this;
  }
  Writer& u32(std::uint32_t v) {
    put_u32(body_ + size_, v);
    size_ += 4;
    return *this;
  }
  Writer& i32(std::int32_t v) { return u32(static_cast<std::uint32_t>(v)); }
  // |v| is far below 2.1e9 / scale: set points and angles of a plate.
  Writer& scaled(float v, float scale, bool known) {
    if (!known) return i32(kUnknown32);
    const auto size = static_cast<std::int32_t>((v < 0.0f ? -v : v) * scale + 0.5f);
    return i32(v < 0.0f ? -size : size);
  }
  std::size_t frame(std::uint8_t* into) {
    const std::uint16_t crc = message_crc(type_, {body_, size_});
    u16(crc);
    return encode_frame(static_cast<MessageType>(type_), {body_, size_}, into);
  }

 private:
  std::uint8_t type_;
  std::uint8_t body_[kStateBytes + kCrcBytes];
  std::size_t size_ = 0;
};

// A servo's angle is beyond 2.1 rad, where nanoradians end, only in a platform that nobody could build.
constexpr float kLargestAngle = 2.1f;

float within(float angle) {
  return angle > kLargestAngle ? kLargestAngle : angle < -kLargestAngle ? -kLargestAngle : angle;
}

}  // namespace

const FrameRules kRigFrames{length_allowed, content_intact};

std::uint16_t message_crc(std::uint8_t type, Bytes body) {
  std::uint16_t crc = 0xFFFF;
  const auto add = [&crc](std::uint8_t byte) {
    crc = static_cast<std::uint16_t>(crc ^ byte << 8);
    for (int bit = 0; bit < 8; ++bit) {
      crc = static_cast<std::uint16_t>((crc & 0x8000) != 0 ? crc << 1 ^ 0x1021 : crc << 1);
    }
  };
  add(type);
  for (std::size_t i = 0; i < body.size; ++i) add(body[i]);
  return crc;
}

bool unpack_move(Bytes body, Move& move) {
  move.sequence = body[0];
  move.platforms = body[1];
  move.steps = get_u16(body.data + 2);
  const std::uint8_t* at = body.data + 4;
  for (SetPoint& set_point : move.set_points) {
    for (std::size_t i = 0; i < 3; ++i, at += 4) set_point[i] = static_cast<float>(get_i32(at)) / kNanoPerMm;
    for (std::size_t i = 3; i < kAxes; ++i, at += 4) set_point[i] = static_cast<float>(get_i32(at)) / kNano;
  }
  return move.platforms != 0 && move.platforms < 1 << kPlatforms && move.steps != 0 && move.steps <= kMaxSteps;
}

bool unpack_servos(Bytes body, Servos& servos) {
  servos.sequence = body[0];
  servos.platform = body[1];
  const std::uint8_t* at = body.data + 2;
  bool plausible = servos.platform < kPlatforms;
  for (ServoCalibration& each : servos.calibration) {
    each.gain_counts_per_rad = static_cast<float>(get_i32(at)) / 1e6f;
    each.offset_counts = static_cast<float>(get_i32(at + 4)) / 1e3f;
    at += 8;
    // Half of what the published servos do, or twice as much, is another kind of servo; 60 counts are 27 degrees.
    const float gain = each.gain_counts_per_rad < 0.0f ? -each.gain_counts_per_rad : each.gain_counts_per_rad;
    const float offset = each.offset_counts < 0.0f ? -each.offset_counts : each.offset_counts;
    plausible = plausible && gain >= 60.0f && gain <= 260.0f && offset <= 60.0f;
  }
  return plausible;
}

std::size_t encode_ack(const RigAck& ack, std::uint8_t* into) {
  Writer writer(RigMessage::kAck);
  writer.u8(ack.type).u8(ack.sequence).u8(static_cast<std::uint8_t>(ack.result)).u8(ack.platform).u8(ack.servo);
  return writer.frame(into);
}

std::size_t encode_state(const RigState& state, std::uint8_t* into) {
  Writer writer(RigMessage::kState);
  writer.u8(state.sequence).u8(static_cast<std::uint8_t>(state.mode)).u8(static_cast<std::uint8_t>(state.stopped_by));
  writer.u8(state.moving_platforms).u16(state.steps_done).u16(state.steps).u32(state.t_ms);
  for (const SetPoint& set_point : state.set_points) {
    for (std::size_t i = 0; i < 3; ++i) writer.scaled(set_point[i], kNanoPerMm, state.known);
    for (std::size_t i = 3; i < kAxes; ++i) writer.scaled(set_point[i], kNano, state.known);
  }
  for (const ServoAngles& angles : state.angles) {
    for (const float angle : angles) writer.scaled(within(angle), kNano, state.known);
  }
  for (const Counts& counts : state.counts) {
    for (const std::uint16_t count : counts) writer.u16(state.known ? count : kUnknownCounts);
  }
  const RigCounters& counters = state.counters;
  writer.u16(counters.bad_frames).u16(counters.refused).u16(counters.i2c_errors);
  writer.u16(counters.servo_board_restarts).u16(counters.presses);
  return writer.frame(into);
}

std::size_t encode_imu(std::uint8_t sequence, std::uint8_t imu, const ImuSums& sums, std::uint8_t* into) {
  Writer writer(RigMessage::kImu);
  writer.u8(sequence).u8(imu).u8(sums.readings);
  for (std::size_t i = 0; i < 3; ++i) writer.i32(sums.acceleration_umps2(i, kUnknown32));
  for (std::size_t i = 0; i < 3; ++i) writer.i32(sums.rate_uradps(i, kUnknown32));
  writer.u16(static_cast<std::uint16_t>(sums.temperature_cdegc(kUnknown16)));
  return writer.frame(into);
}

}  // namespace brov::rig
