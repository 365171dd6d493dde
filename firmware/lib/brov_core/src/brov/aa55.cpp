#include "brov/aa55.h"

#include "brov/checksums.h"

namespace brov {
namespace {

constexpr std::uint8_t kSync1 = 0xAA, kSync2 = 0x55;
constexpr std::size_t kHeader = 5;

constexpr bool in_steps(std::size_t length, std::size_t minimum, std::size_t maximum, std::size_t step) {
  return length >= minimum && length <= maximum && (length - minimum) % step == 0;
}

constexpr bool length_allowed(std::uint8_t type, std::size_t length) {
  switch (type) {
    case 0x01: return length == 76;                         // SENSORS
    case 0x02:                                              // KOGGER_RAW_A
    case 0x03: return in_steps(length, 12, kMaxPayload, 1);  // KOGGER_RAW_B
    case 0x04: return in_steps(length, 1, kMaxPayload, 1);   // KOGGER_COMPRESSED
    case 0x05: return in_steps(length, 28, 10 + 64 * 18, 18);  // IMU_BURST
    case 0x06: return in_steps(length, 62, 126, 1);          // STATUS
    case 0x07: return length == 3;                          // COMMAND_ACK
    case 0x08: return in_steps(length, 16, 100, 6);          // ACOUSTIC_TDOA
    case 0x09: return in_steps(length, 22, 512, 1);          // ACOUSTIC_RECORD
    case 0x0A: return in_steps(length, 6, 261, 1);           // ACOUSTIC_MESSAGE
    case 0x0B: return length == 32;                         // GPS
    case 0x20:                                              // KOGGER_COMMAND_A
    case 0x21: return in_steps(length, 9, 264, 1);           // KOGGER_COMMAND_B
    case 0x22: return in_steps(length, 6, 41, 5);            // CONFIG
    case 0x23: return length == 9;                          // TIME_SYNC
    default: return length <= kMaxPayload;
  }
}

}  // namespace

const FrameRules kBoardFrames{length_allowed, nullptr};

std::size_t encode_frame(MessageType type, Bytes payload, std::uint8_t* into) {
  into[0] = kSync1;
  into[1] = kSync2;
  into[2] = static_cast<std::uint8_t>(type);
  into[3] = static_cast<std::uint8_t>(payload.size >> 8);
  into[4] = static_cast<std::uint8_t>(payload.size);
  for (std::size_t i = 0; i < payload.size; ++i) into[kHeader + i] = payload[i];
  const std::size_t end = kHeader + payload.size;
  into[end] = xor8({into + 2, end - 2});
  return end + 1;
}

bool FrameDecoder::is_intact(Bytes frame) const {
  if (xor8(frame.from(2)) != 0) return false;
  return rules_->content_intact == nullptr || rules_->content_intact(frame[2], frame.first(frame.size - 1).from(kHeader));
}

bool FrameDecoder::next(Frame& frame) {
  for (Bytes held = stream_.held(); held.size > 0; held = stream_.held()) {
    if (held[0] == kSync1 && (held.size < 2 || held[1] == kSync2)) {
      if (held.size < kHeader) return false;
      const std::size_t length = static_cast<std::size_t>(held[3]) << 8 | held[4];
      const std::size_t total = length + kFrameOverhead;
      if (!rules_->length_allowed(held[2], length)) {
        ++counters_.length_errors;
      } else if (held.size < total) {
        return false;
      } else if (is_intact(held.first(total))) {
        frame.type = held[2];
        frame.payload = held.first(total - 1).from(kHeader);
        stream_.take(total);
        ++counters_.frames_ok;
        return true;
      } else {
        ++counters_.checksum_errors;
      }
    }
    stream_.take(1);
    ++counters_.bytes_skipped;
  }
  return false;
}

}  // namespace brov
