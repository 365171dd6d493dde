// AA55 frames: AA 55 | type | u16 big-endian length | payload | xor. docs/protocol.md section 1.
#pragma once

#include "brov/bytes.h"
#include "brov/stream_buffer.h"

namespace brov {

enum class MessageType : std::uint8_t {
  kSensors = 0x01,
  kKoggerRawA = 0x02,
  kKoggerRawB = 0x03,
  kKoggerCompressed = 0x04,
  kImuBurst = 0x05,
  kStatus = 0x06,
  kCommandAck = 0x07,
  kGps = 0x0B,
  kKoggerCommandA = 0x20,
  kKoggerCommandB = 0x21,
  kConfig = 0x22,
  kTimeSync = 0x23,
};

constexpr std::size_t kMaxPayload = 4096;
constexpr std::size_t kFrameOverhead = 6;

// Writes the whole frame; `into` has payload.size + kFrameOverhead bytes. Returns its length.
std::size_t encode_frame(MessageType type, Bytes payload, std::uint8_t* into);

struct DecoderCounters {
  std::uint32_t frames_ok = 0;
  std::uint32_t checksum_errors = 0;
  std::uint32_t length_errors = 0;
  std::uint32_t bytes_skipped = 0;
};

// What counts as a frame on one kind of link: a false header is refused early by the length that its type cannot have.
struct FrameRules {
  bool (*length_allowed)(std::uint8_t type, std::size_t length);
  bool (*content_intact)(std::uint8_t type, Bytes payload);  // none: the frame's own check is enough
};
extern const FrameRules kBoardFrames;  // the vehicle's board: docs/protocol.md

// Bytes, cut anywhere, to frames, with resynchronisation one byte behind a false start.
// next() is called until it returns false; a frame's payload stays valid until the next call of feed().
class FrameDecoder {
 public:
  struct Frame {
    std::uint8_t type = 0;
    Bytes payload;
  };

  explicit FrameDecoder(const FrameRules& rules = kBoardFrames) : rules_(&rules) {}

  // At most kMaxFeed bytes; call next() until false before the next feed().
  static constexpr std::size_t kMaxFeed = 256;
  void feed(Bytes data) { stream_.append(data); }
  bool next(Frame& frame);
  const DecoderCounters& counters() const { return counters_; }

 private:
  bool is_intact(Bytes frame) const;

  const FrameRules* rules_;  // a pointer, so that a decoder can be assigned a fresh one
  StreamBuffer<kMaxPayload + kFrameOverhead + kMaxFeed> stream_;
  DecoderCounters counters_{};
};

}  // namespace brov
