// What waits to be sent, by urgency, and the pings of which whole ones go when the line is too slow.
// docs/firmware-core.md sections 2 (ping store) and 3.
#pragma once

#include <array>

#include "brov/aa55.h"
#include "brov/bytes.h"
#include "brov/hal.h"

namespace brov {

// Frames in a ring of bytes, each behind its length; oldest first.
template <std::size_t Capacity, std::size_t MaxFrames>
class FrameRing {
 public:
  bool empty() const { return frames_ == 0; }
  std::size_t frames() const { return frames_; }
  bool fits(std::size_t length) const { return frames_ < MaxFrames && used_ + length + 2 <= Capacity; }
  std::size_t front_length() const { return peek(0) | static_cast<std::size_t>(peek(1)) << 8; }

  void push(Bytes frame) {
    append(static_cast<std::uint8_t>(frame.size));
    append(static_cast<std::uint8_t>(frame.size >> 8));
    for (std::size_t i = 0; i < frame.size; ++i) append(frame[i]);
    ++frames_;
  }
  // The oldest frame into `into`; returns its length.
  std::size_t pop(std::uint8_t* into) {
    const std::size_t length = front_length();
    if (into != nullptr) {
      for (std::size_t i = 0; i < length; ++i) into[i] = peek(2 + i);
    }
    start_ = (start_ + length + 2) % Capacity;
    used_ -= length + 2;
    --frames_;
    return length;
  }
  void drop_newest(std::size_t length) {  // the frame pushed last, of this length
    used_ -= length + 2;
    --frames_;
  }
  void clear() { start_ = used_ = frames_ = 0; }

 private:
  void append(std::uint8_t byte) { buffer_[(start_ + used_++) % Capacity] = byte; }
  std::uint8_t peek(std::size_t offset) const { return buffer_[(start_ + offset) % Capacity]; }

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

  bool acks_empty() const;
  // Length of the frame to send next, 0 for none. acks_only: during a change of baud rate.
  std::size_t next_length(bool acks_only) const;
  // Takes it; `into` has kMaxFrame bytes. Returns its length.
  static constexpr std::size_t kMaxFrame = 520;
  std::size_t take(bool acks_only, std::uint8_t* into);

  std::uint32_t pings_dropped(Channel channel) const { return pings_dropped_[static_cast<std::size_t>(channel)]; }
  // Bytes of other sonar frames lost to a full queue since the last call.
  std::uint32_t take_lost_sonar_bytes(Channel channel);

 private:
  static constexpr std::size_t kPingStore = 12288;
  static constexpr std::size_t kMaxPings = 16;
  struct Ping {
    std::uint32_t order = 0;
    std::uint16_t frames = 0;
    std::uint32_t bytes = 0;  // of its frames, without their lengths
  };
  struct Store {
    FrameRing<kPingStore, 2048> frames;
    std::array<Ping, kMaxPings> pings{};
    std::size_t first = 0, count = 0;
  };
  void drop_oldest_waiting(Channel channel);

  FrameRing<4 * 84, 4> sensors_;
  FrameRing<32 * 11, 32> acks_;
  FrameRing<32 * 130, 32> reports_;
  FrameRing<8192, 32> other_;
  std::array<Store, 2> stores_{};
  std::array<std::uint32_t, 2> pings_dropped_{{0, 0}}, lost_bytes_{{0, 0}};
  // implementation state: which ping is being written, which is being sent, whose turn to drop it is
  int writing_ = -1, sending_ = -1;
  bool writing_failed_ = false;
  Channel last_dropped_ = Channel::kB;
  std::uint32_t order_ = 0;
};

}  // namespace brov
