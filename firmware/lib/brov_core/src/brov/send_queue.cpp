#include "brov/send_queue.h"

namespace brov {

namespace {

constexpr std::uint32_t kMaxWaitingPercent = 15;  // of a second of the line: older pings are of no use to a pilot

template <typename Ring>
void put_dropping_oldest(Ring& ring, Bytes frame) {
  while (!ring.empty() && !ring.fits(frame.size)) ring.pop(nullptr);
  if (ring.fits(frame.size)) ring.push(frame);
}

}  // namespace

void SendQueue::put(Urgency urgency, MessageType type, Bytes payload) {
  std::uint8_t encoded[kMaxFrame];
  const Bytes frame(encoded, encode_frame(type, payload, encoded));
  switch (urgency) {
    case Urgency::kSensors: put_dropping_oldest(sensors_, frame); break;
    case Urgency::kAcks: put_dropping_oldest(acks_, frame); break;
    case Urgency::kReports: put_dropping_oldest(reports_, frame); break;
    case Urgency::kSonarOther:
      while (!other_.empty() && !other_.fits(frame.size)) drop_oldest_other();
      other_.push(frame);
      break;
  }
}

void SendQueue::drop_oldest_other() {
  const bool of_a = other_.front_byte(2) == static_cast<std::uint8_t>(MessageType::kKoggerRawA);
  const std::size_t lost = other_.pop(nullptr) - kFrameOverhead;
  lost_bytes_[of_a ? 0 : 1] += static_cast<std::uint32_t>(lost);
}

void SendQueue::drop_sonar_data() {
  while (!other_.empty()) drop_oldest_other();
  for (std::size_t channel = 0; channel < stores_.size(); ++channel) {
    Store& store = stores_[channel];
    pings_dropped_[channel] += static_cast<std::uint32_t>(store.count);
    store.frames.clear();
    store.count = 0;
  }
  sending_ = kNone;
}

void SendQueue::begin_ping(Channel channel) {
  writing_ = static_cast<std::size_t>(channel);
  written_ = {};
  written_.order = next_order_++;
  written_fits_ = stores_[writing_].count < kMaxPings;
}

void SendQueue::ping_payload(MessageType type, Bytes payload) {
  std::uint8_t encoded[kMaxFrame];
  const Bytes frame(encoded, encode_frame(type, payload, encoded));
  Store& store = stores_[writing_];
  written_fits_ = written_fits_ && store.frames.fits(frame.size);
  if (!written_fits_) return;
  store.frames.push(frame);
  written_.bytes += static_cast<std::uint32_t>(frame.size);
  ++written_.frames;
}

void SendQueue::end_ping(std::uint32_t line_bytes_per_s) {
  Store& store = stores_[writing_];
  if (!written_fits_) {
    store.frames.drop_newest(written_.frames, written_.stored_bytes());
    ++pings_dropped_[writing_];
    return;
  }
  if (written_.frames == 0) return;
  store.ping(store.count++) = written_;
  // Without the next one to go being safe, two pings that end together would cost one of them on an idle line.
  sending_ = store_to_send();
  const std::uint32_t limit = line_bytes_per_s * kMaxWaitingPercent / 100;
  while (waiting(0) + waiting(1) > 1 && waiting_bytes() > limit) {
    const std::size_t turn = 1 - last_dropped_;
    drop_oldest_waiting(waiting(turn) != 0 ? turn : 1 - turn);
  }
}

std::size_t SendQueue::waiting(std::size_t channel) const {
  return stores_[channel].count - (sending_ == static_cast<int>(channel) ? 1 : 0);
}

std::uint32_t SendQueue::waiting_bytes() const {
  std::uint32_t bytes = 0;
  for (std::size_t channel = 0; channel < stores_.size(); ++channel) {
    const Store& store = stores_[channel];
    for (std::size_t i = store.count - waiting(channel); i < store.count; ++i) bytes += store.ping(i).bytes;
  }
  return bytes;
}

void SendQueue::drop_oldest_waiting(std::size_t channel) {
  Store& store = stores_[channel];
  const bool behind_sent_one = sending_ == static_cast<int>(channel);
  const Ping dropped = store.ping(behind_sent_one ? 1 : 0);
  std::size_t ahead_bytes = 0;
  if (behind_sent_one) {
    ahead_bytes = store.ping(0).stored_bytes();
    store.ping(1) = store.ping(0);
  }
  store.frames.drop_behind(ahead_bytes, dropped.frames, dropped.stored_bytes());
  store.first = (store.first + 1) % kMaxPings;
  --store.count;
  ++pings_dropped_[channel];
  last_dropped_ = channel;
}

int SendQueue::store_to_send() const {
  if (sending_ != kNone) return sending_;
  const Store& a = stores_[0];
  const Store& b = stores_[1];
  if (a.count == 0) return b.count == 0 ? kNone : 1;
  if (b.count == 0) return 0;
  return static_cast<std::int32_t>(a.ping(0).order - b.ping(0).order) < 0 ? 0 : 1;
}

std::size_t SendQueue::next_length(bool acks_only) const {
  if (acks_only) return acks_.empty() ? 0 : acks_.front_length();
  if (!sensors_.empty()) return sensors_.front_length();
  if (!acks_.empty()) return acks_.front_length();
  if (!reports_.empty()) return reports_.front_length();
  if (!other_.empty()) return other_.front_length();
  const int store = store_to_send();
  return store == kNone ? 0 : stores_[static_cast<std::size_t>(store)].frames.front_length();
}

std::size_t SendQueue::take(bool acks_only, std::uint8_t* into) {
  if (acks_only) return acks_.pop(into);
  if (!sensors_.empty()) return sensors_.pop(into);
  if (!acks_.empty()) return acks_.pop(into);
  if (!reports_.empty()) return reports_.pop(into);
  if (!other_.empty()) return other_.pop(into);
  sending_ = store_to_send();
  Store& store = stores_[static_cast<std::size_t>(sending_)];
  const std::size_t length = store.frames.pop(into);
  Ping& ping = store.ping(0);
  ping.bytes -= static_cast<std::uint32_t>(length);
  if (--ping.frames == 0) {
    store.first = (store.first + 1) % kMaxPings;
    --store.count;
    sending_ = kNone;
  }
  return length;
}

}  // namespace brov
