// The USB serial line: what goes next, how much may lie in it, its load, and its change of rate.
// docs/firmware-core.md sections 3 and 5.
#pragma once

#include "brov/bundle.h"
#include "brov/hal.h"
#include "brov/send_queue.h"

namespace brov {

class Transmitter {
 public:
  Transmitter(Hal& hal, std::uint32_t baud, std::uint64_t boot_us) : hal_(hal), baud_(baud), mark_us_(boot_us) {}

  SendQueue& queue() { return queue_; }
  const SendQueue& queue() const { return queue_; }
  void tick(std::uint64_t now_us);

  void request_baud(std::uint32_t baud) { wanted_baud_ = baud; }
  void host_heard() { on_trial_ = false; }

  // Load and rate since the last mark; a new mark where that is long enough ago.
  void measure(std::uint64_t now_us);
  std::uint8_t load_percent() const { return load_percent_; }
  std::uint32_t other_bytes_per_s() const { return other_bytes_per_s_; }
  std::uint32_t tx_bytes() const { return tx_bytes_; }

  std::uint32_t baud() const { return baud_; }
  std::uint32_t bytes_per_s() const { return baud_ / 10; }
  std::size_t payload_limit() const { return slow() ? kPayloadLimitSlow : kPayloadLimitFast; }

 private:
  bool slow() const { return baud_ <= kRomBaud; }
  bool baud_change_waits() const { return wanted_baud_ != baud_; }
  void set_baud(std::uint32_t baud, std::uint64_t now_us);
  void count(Bytes frame);

  Hal& hal_;
  SendQueue queue_;
  std::uint32_t baud_;
  std::uint32_t wanted_baud_ = baud_, baud_before_trial_ = baud_;
  bool on_trial_ = false;
  std::uint64_t trial_started_us_ = 0;

  std::uint32_t tx_bytes_ = 0;
  std::uint64_t mark_us_;
  std::uint64_t bytes_since_mark_ = 0, other_bytes_since_mark_ = 0;
  std::uint8_t load_percent_ = 0;
  std::uint32_t other_bytes_per_s_ = 1500;  // a guess of what the small frames take, until it is measured
};

}  // namespace brov
