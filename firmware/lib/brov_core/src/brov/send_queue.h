// What waits to be sent, by urgency, and the pings of which whole ones go when the line is too slow.
// docs/firmware-core.md sections 2 (ping store) and 3.
#pragma once

#include <array>

#include "brov/aa55.h"
#include "brov/bytes.h"
#include "brov/hal.h"
#include "brov/payloads.h"

namespace brov {

constexpr std::size_t kLengthBytes = 2;  // what a stored frame takes beyond its own bytes
constexpr std::size_t stored_bytes(std::size_t payload_bytes) { return payload_bytes + kFrameOverhead + kLengthBytes; }

// Frames in a ring of bytes, each behind its length; oldest first.
template <std::size_t Capacity, std::size_t MaxFrames>
class FrameRing {
 public:
  bool empty() const { return frames_ == 0; }
  bool fits(std::size_t length) const { return frames_ < MaxFrames && used_ + length + kLengthBytes <= Capacity; }
  std::size_t front_length() const {
    return buffer_[index(0)] | static_cast<std::size_t>(buffer_[index(1)]) << 8;
  }
  std::uint8_t front_byte(std::size_t offset) const { return buffer_[index(kLengthBytes + offset)]; }

  void push(Bytes frame) {
    append(static_cast<std::uint8_t>(frame.size));
    append(static_cast<std::uint8_t>(frame.size >> 8));
    for (std::size_t i = 0; i < frame.size; ++i) append(frame[i]);
    ++frames_;
  }
  // The oldest frame into `into`, unless that is null; returns its length.
  std::size_t pop(std::uint8_t* into) {
    const std::size_t length = front_length();
    if (into != nullptr) {
      for (std::size_t i = 0; i < length; ++i) into[i] = front_byte(i);
    }
    start_ = index(length + kLengthBytes);
    used_ -= length + kLengthBytes;
    --frames_;
    return length;
  }
  void clear() { start_ = used_ = frames_ = 0; }
  void drop_newest(std::size_t frames, std::size_t stored_bytes) {
    used_ -= stored_bytes;
    frames_ -= frames;
  }
  // Drops frames that take `stored_bytes` in all and lie behind the oldest `ahead_bytes`, which move up.
  void drop_behind(std::size_t ahead_bytes, std::size_t frames, std::size_t stored_bytes) {
    for (std::size_t i = ahead_bytes; i-- > 0;) buffer_[index(i + stored_bytes)] = buffer_[index(i)];
    start_ = index(stored_bytes);
    used_ -= stored_bytes;
    frames_ -= frames;
  }

 private:
  // Position of a byte counted from the oldest. A subtraction: the modulo of a capacity that is no power of two is slow.
  std::size_t index(std::size_t offset) const {
    const std::size_t at = start_ + offset;
    return at >= Capacity ? at - Capacity : at;
  }
  void append(std::uint8_t byte) { buffer_[index(used_++)] = byte; }

  std::array<std::uint8_t, Capacity> buffer_{};
  std::size_t start_ = 0, used_ = 0, frames_ = 0;
};

enum class Urgency : std::uint8_t { kSensors, kAcks, kReports, kSonarOther };

class SendQueue {
 public:
  // An encoded frame behind those of its urgency; a full queue loses its oldest.
  void put(Urgency urgency, MessageType type, Bytes payload);

  // A ping, payload by payload; nothing of it is sent before end_ping().
  void begin_ping(Channel channel);
  void ping_payload(MessageType type, Bytes payload);
  void end_ping(std::uint32_t line_bytes_per_s);
  // Loses every ping, the one being sent included, and every other sonar frame.
  void drop_sonar_data();

  bool acks_empty() const { return acks_.empty(); }
  // Length of the frame to send next, 0 for none. acks_only: during a change of baud rate.
  std::size_t next_length(bool acks_only) const;
  // Takes it; `into` has kMaxFrame bytes. Returns its length.
  static constexpr std::size_t kMaxFrame = 518;
  std::size_t take(bool acks_only, std::uint8_t* into);

  std::uint32_t pings_dropped(Channel channel) const { return pings_dropped_[static_cast<std::size_t>(channel)]; }
  // Payload bytes of other sonar frames lost to a full queue.
  std::uint32_t lost_sonar_bytes(Channel channel) const { return lost_bytes_[static_cast<std::size_t>(channel)]; }

 private:
  static constexpr std::size_t kPingStore = 12288;
  static constexpr std::size_t kMaxPings = 16;
  static constexpr int kNone = -1;

  struct Ping {
    std::uint32_t order = 0;  // of all pings of both channels
    std::uint16_t frames = 0;
    std::uint32_t bytes = 0;  // of its frames, without their lengths

    std::size_t stored_bytes() const { return bytes + frames * kLengthBytes; }
  };
  struct Store {
    FrameRing<kPingStore, kPingStore> frames;
    std::array<Ping, kMaxPings> pings{};
    std::size_t first = 0, count = 0;

    Ping& ping(std::size_t i) { return pings[(first + i) % kMaxPings]; }
    const Ping& ping(std::size_t i) const { return pings[(first + i) % kMaxPings]; }
  };

  void drop_oldest_other();
  std::size_t waiting(std::size_t channel) const;  // pings behind the one being sent
  std::uint32_t waiting_bytes() const;
  void drop_oldest_waiting(std::size_t channel);
  int store_to_send() const;

  FrameRing<4 * stored_bytes(kSensorsBytes), 4> sensors_;
  FrameRing<32 * stored_bytes(kAckBytes), 32> acks_;
  FrameRing<32 * stored_bytes(kImuBurstHeaderBytes + kMaxBurstSamples * kImuSampleBytes), 32> reports_;
  FrameRing<8192, 32> other_;
  std::array<Store, 2> stores_{};
  std::array<std::uint32_t, 2> pings_dropped_{{0, 0}}, lost_bytes_{{0, 0}};

  int sending_ = kNone;  // the store whose first ping is the next to go, or partly handed over
  std::size_t writing_ = 0;
  Ping written_{};
  bool written_fits_ = false;
  std::size_t last_dropped_ = 1;  // A is the first whose turn it is
  std::uint32_t next_order_ = 0;
};

}  // namespace brov
