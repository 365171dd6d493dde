#include "brov/transmitter.h"

namespace brov {

namespace {

// Bytes that may lie in the line: what SENSORS may have to wait for.
constexpr std::size_t kWindowSlow = 230;  // 20 ms at 115200 baud
constexpr std::size_t kWindowFast = 552;  // 6 ms at 921600 baud
static_assert(kWindowSlow >= kPayloadLimitSlow + kFrameOverhead && kWindowFast >= kPayloadLimitFast + kFrameOverhead,
              "the largest frame fits an empty window");

constexpr std::uint64_t kTrialUs = 5000000;
constexpr std::uint64_t kShortestMarkUs = 500000;

}  // namespace

void Transmitter::tick(std::uint64_t now_us) {
  if (on_trial_ && now_us - trial_started_us_ >= kTrialUs) {
    on_trial_ = false;
    set_baud(baud_before_trial_, now_us);
  }
  if (baud_change_waits() && queue_.acks_empty() && hal_.link_backlog(now_us) == 0) {
    baud_before_trial_ = baud_;
    on_trial_ = true;
    trial_started_us_ = now_us;
    set_baud(wanted_baud_, now_us);
  }
  const bool acks_only = baud_change_waits();
  const std::size_t window = slow() ? kWindowSlow : kWindowFast;
  while (const std::size_t length = queue_.next_length(acks_only)) {
    const std::size_t backlog = hal_.link_backlog(now_us);
    if (backlog != 0 && backlog + length > window) break;
    std::uint8_t frame[SendQueue::kMaxFrame];
    const Bytes taken(frame, queue_.take(acks_only, frame));
    count(taken);
    hal_.link_write(taken, now_us);
  }
}

void Transmitter::set_baud(std::uint32_t baud, std::uint64_t now_us) {
  // What was packed for the fast line would hold SENSORS up for 45 ms a frame on the slow one.
  if (baud < baud_) queue_.drop_sonar_data();
  baud_ = wanted_baud_ = baud;
  hal_.link_set_baud(baud, now_us);
}

void Transmitter::count(Bytes frame) {
  tx_bytes_ += static_cast<std::uint32_t>(frame.size);
  bytes_since_mark_ += frame.size;
  const auto type = static_cast<MessageType>(frame[2]);
  const bool sonar =
      type == MessageType::kKoggerRawA || type == MessageType::kKoggerRawB || type == MessageType::kKoggerCompressed;
  if (!sonar) other_bytes_since_mark_ += frame.size;
}

void Transmitter::measure(std::uint64_t now_us) {
  const std::uint64_t elapsed_us = now_us - mark_us_;
  if (elapsed_us < kShortestMarkUs) return;
  const std::uint64_t capacity = elapsed_us * bytes_per_s();  // of the line, in millionths of a byte
  const std::uint64_t percent = (200 * 1000000 * bytes_since_mark_ + capacity) / (2 * capacity);
  load_percent_ = static_cast<std::uint8_t>(percent < 100 ? percent : 100);
  other_bytes_per_s_ = static_cast<std::uint32_t>(other_bytes_since_mark_ * 1000000 / elapsed_us);
  mark_us_ = now_us;
  bytes_since_mark_ = other_bytes_since_mark_ = 0;
}

}  // namespace brov
