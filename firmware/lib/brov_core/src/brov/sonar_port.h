// One sonar's UART: bytes to whole pings and other frames, and how many bytes per second its pings are.
// docs/firmware-core.md section 2.
#pragma once

#include <array>

#include "brov/byte_ring.h"
#include "brov/kogger_framer.h"

namespace brov {

// The chart frames of one ping, as the sonar sent them.
class PingCollector {
 public:
  enum class Kind : std::uint8_t { kChart, kBadChart, kOther };
  static Kind kind(const KoggerFrame& frame);

  bool open() const { return frames_ != 0; }
  // Whether this chart frame begins another ping than the open one.
  bool ended_by(const KoggerFrame& chart) const;
  void add(const KoggerFrame& chart, std::uint64_t first_byte_us, std::uint64_t now_us);
  void clear() { size_ = frames_ = longest_ = 0; }

  Bytes raw() const { return {raw_.data(), size_}; }
  std::uint32_t t_us() const { return t_us_; }
  std::uint8_t version() const { return version_; }
  bool mark() const { return mark_; }
  std::size_t longest_frame() const { return longest_; }
  std::uint64_t last_chunk_us() const { return last_chunk_us_; }  // the tick that took it

 private:
  static constexpr std::size_t kMaxBytes = 8192, kMaxFrames = 80;

  std::array<std::uint8_t, kMaxBytes> raw_{};
  std::size_t size_ = 0, frames_ = 0, longest_ = 0;
  std::uint32_t t_us_ = 0;
  std::uint8_t version_ = 0;
  bool mark_ = false;
  std::uint32_t filled_ = 0;  // samples up to the end of the last chunk
  std::uint16_t resolution_mm_ = 0, first_sample_ = 0;
  std::uint64_t last_chunk_us_ = 0;
};

class SonarPort {
 public:
  class Sink {
   public:
    virtual void ping_ended(const PingCollector& ping) = 0;
    virtual void other_frame(Bytes raw, std::uint32_t t_us) = 0;

   protected:
    ~Sink() = default;
  };

  void receive(Bytes data) { ring_.write(data); }  // from another core, if need be
  void take(std::uint64_t now_us, Sink& sink);     // one tick's batch
  void end_after_silence(std::uint64_t now_us, Sink& sink);

  bool has_input() const { return ring_.size() != 0; }
  std::uint32_t packets() const { return framer_.frames_ok(); }
  std::uint32_t bytes() const { return bytes_; }
  std::uint32_t frame_errors() const { return framer_.checksum_errors(); }
  std::uint32_t overflow_bytes() const { return ring_.lost(); }
  // Raw bytes of pings per second, 0 until it is known.
  std::uint32_t ping_bytes_per_s() const { return rate_known_ ? static_cast<std::uint32_t>(rate_) : 0; }
  bool rate_needed() const { return heard_ && !rate_known_; }

 private:
  void take_frame(const KoggerFrame& frame, std::uint64_t first_byte_us, std::uint64_t now_us, Sink& sink);
  void end_ping(std::uint64_t now_us, Sink& sink);
  void measure(std::uint64_t now_us);

  ByteRing<16384> ring_;
  KoggerFramer framer_;
  PingCollector ping_;
  std::uint32_t bytes_ = 0;
  bool heard_ = false;

  bool ended_one_ = false, rate_known_ = false;
  std::uint64_t ended_us_ = 0;
  std::int64_t rate_ = 0;
};

}  // namespace brov
