#include "brov/host_commands.h"

#include "brov/checksums.h"

namespace brov {

namespace {

constexpr std::size_t kMaxBatch = 512;
constexpr std::uint8_t kFirstDownwardType = 0x20, kFirstUnknownDownwardType = 0x24;
constexpr std::size_t kConfigPairBytes = 5;
constexpr std::uint8_t kKoggerSetting = 2;

// Exactly one BB55 frame; the sonars know nothing but the sums modulo 256.
bool is_whole_kogger_frame(Bytes bytes) {
  if (bytes.size < 8 || bytes[0] != 0xBB || bytes[1] != 0x55 || bytes.size != bytes[5] + std::size_t{8}) return false;
  const KoggerCheck check{bytes[bytes.size - 2], bytes[bytes.size - 1]};
  return kogger_mod256(Bytes(bytes.data + 2, bytes.size - 4)) == check;
}

}  // namespace

void HostCommands::take(std::uint64_t now_us) {
  std::size_t left = ring_.size();  // once: the writer may be adding to it
  if (left == 0) return;
  if (left > kMaxBatch) left = kMaxBatch;
  const DecoderCounters before = decoder_.counters();
  while (left != 0) {
    const Bytes piece = ring_.front(left < FrameDecoder::kMaxFeed ? left : FrameDecoder::kMaxFeed);
    decoder_.feed(piece);
    ring_.consume(piece.size);
    left -= piece.size;
    FrameDecoder::Frame frame;
    while (decoder_.next(frame)) obey(frame, now_us);
  }
  const DecoderCounters& after = decoder_.counters();
  const std::uint32_t failed =
      after.checksum_errors - before.checksum_errors + (after.length_errors - before.length_errors);
  const std::uint32_t bad = failed != 0 ? failed : after.bytes_skipped != before.bytes_skipped ? 1 : 0;
  bad_commands_ = static_cast<std::uint16_t>(bad_commands_ + bad);
}

void HostCommands::obey(const FrameDecoder::Frame& frame, std::uint64_t now_us) {
  const Bytes payload = frame.payload;
  if (frame.type >= kFirstDownwardType && frame.type < kFirstUnknownDownwardType) transmitter_.host_heard();
  switch (static_cast<MessageType>(frame.type)) {
    case MessageType::kKoggerCommandA: relay(Channel::kA, frame.type, payload, now_us); break;
    case MessageType::kKoggerCommandB: relay(Channel::kB, frame.type, payload, now_us); break;
    case MessageType::kConfig: configure(payload, now_us); break;
    case MessageType::kTimeSync: listener_.time_sync(get_u64(payload.data + 1), now_us); break;
    default:
      ++bad_commands_;
      if (frame.type >= kFirstUnknownDownwardType) {
        acknowledge(frame.type, payload.size != 0 ? payload[0] : 0, AckResult::kUnknown);
      }
  }
}

void HostCommands::relay(Channel channel, std::uint8_t type, Bytes payload, std::uint64_t now_us) {
  const Bytes inner = payload.from(1);
  PendingCommands& pending = sonars_.pending(channel);
  AckResult result = AckResult::kOk;
  if (!is_whole_kogger_frame(inner)) {
    result = AckResult::kBadInnerChecksum;
  } else if (const KoggerFrame frame{inner, 0}; frame.id() == kKoggerUartId && frame.type() == kKoggerSetting) {
    result = AckResult::kRejected;  // another baud rate would cut the board off from its sonar
  } else if (pending.full(now_us)) {
    result = AckResult::kBusy;
  }
  acknowledge(type, payload[0], result);
  if (result != AckResult::kOk) {
    ++bad_commands_;
    return;
  }
  pending.add(now_us);
  hal_.port_write(channel == Channel::kA ? Port::kSonarA : Port::kSonarB, inner, now_us);
}

void HostCommands::configure(Bytes payload, std::uint64_t now_us) {
  const std::uint8_t type = static_cast<std::uint8_t>(MessageType::kConfig);
  bool allowed = true;
  for (Bytes pairs = payload.from(1); pairs.size != 0; pairs = pairs.from(kConfigPairBytes)) {
    allowed = allowed && config_allowed(pairs[0], get_u32(pairs.data + 1));
  }
  acknowledge(type, payload[0], allowed ? AckResult::kOk : AckResult::kRejected);
  if (!allowed) {
    ++bad_commands_;
    return;
  }
  const Settings before = settings_;
  for (Bytes pairs = payload.from(1); pairs.size != 0; pairs = pairs.from(kConfigPairBytes)) {
    const std::uint32_t value = get_u32(pairs.data + 1);
    switch (static_cast<ConfigKey>(pairs[0])) {
      case ConfigKey::kSensorsRate: settings_.sensors_rate_mhz = value; break;
      case ConfigKey::kImuRate: settings_.imu_rate_mhz = value; break;
      case ConfigKey::kDecimation: settings_.decimation = static_cast<std::uint8_t>(value); break;
      case ConfigKey::kBaud: transmitter_.request_baud(value); break;
    }
  }
  listener_.settings_changed(before, now_us);
}

void HostCommands::acknowledge(std::uint8_t type, std::uint8_t sequence, AckResult result) {
  std::uint8_t payload[kAckBytes];
  pack_ack(type, sequence, result, payload);
  transmitter_.queue().put(Urgency::kAcks, MessageType::kCommandAck, Bytes(payload, sizeof payload));
}

}  // namespace brov
