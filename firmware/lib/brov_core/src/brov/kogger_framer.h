// BB55 frames out of one sonar's bytes. docs/firmware-core.md section 2, docs/protocol.md section 4.
#pragma once

#include "brov/bytes.h"
#include "brov/stream_buffer.h"

namespace brov {

constexpr std::size_t kMaxKoggerFrame = 263;
constexpr std::uint8_t kKoggerChartId = 0x03;
constexpr std::uint8_t kKoggerUartId = 0x18;

// A whole, intact frame, sync and checks included.
struct KoggerFrame {
  Bytes raw;
  std::size_t behind = 0;  // bytes of the batch that came after its first byte (for its time of arrival)

  std::uint8_t type() const { return raw[3] & 3; }
  std::uint8_t version() const { return raw[3] >> 3 & 7; }
  bool mark() const { return (raw[3] & 0x40) != 0; }
  std::uint8_t id() const { return raw[4]; }
  Bytes payload() const { return {raw.data + 6, raw.size - 8}; }
};

enum class KoggerChecksum : std::uint8_t { kAuto, kMod256 };

// As FrameDecoder: feed() at most kMaxFeed bytes, then next() until false. `behind` counts from the end of this batch;
// for a frame that began in an earlier batch it is larger than the batch.
class KoggerFramer {
 public:
  static constexpr std::size_t kMaxFeed = 256;
  explicit KoggerFramer(KoggerChecksum checksum = KoggerChecksum::kAuto) : learns_(checksum == KoggerChecksum::kAuto) {}
  void feed(Bytes data) { stream_.append(data); }
  bool next(KoggerFrame& frame);
  std::uint32_t frames_ok() const { return frames_ok_; }
  std::uint32_t checksum_errors() const { return checksum_errors_; }
  bool idle() const { return stream_.held().size == 0; }  // nothing held

 private:
  bool intact(Bytes raw);

  StreamBuffer<kMaxKoggerFrame + kMaxFeed> stream_;
  std::uint32_t frames_ok_ = 0, checksum_errors_ = 0;
  bool learns_;
  bool mod255_ = false;
  std::uint8_t streak_ = 0;
};

}  // namespace brov
