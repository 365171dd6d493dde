#include "brov/sonar_traffic.h"

#include "brov/bundle.h"

namespace brov {

namespace {

constexpr std::size_t kTimeBytes = 4;
constexpr std::uint64_t kAnswerUs = 300000;
// Raw needs this much of the line, with hysteresis.
constexpr std::uint64_t kEnterRawPercent = 75, kLeaveRawPercent = 85;

constexpr std::size_t frame_bytes(const std::uint8_t* frame) { return frame[5] + std::size_t{8}; }

constexpr MessageType raw_type(Channel channel) {
  return channel == Channel::kA ? MessageType::kKoggerRawA : MessageType::kKoggerRawB;
}

// Whole BB55 frames gathered to one KOGGER_RAW payload.
class RawPayload {
 public:
  bool empty() const { return size_ == 0; }
  bool fits(Bytes frame, std::size_t limit) const { return empty() || size_ + frame.size <= limit; }
  void add(Bytes frame, std::uint32_t t_us) {
    if (empty()) {
      put_u32(bytes_, t_us);
      size_ = kTimeBytes;
    }
    for (std::size_t i = 0; i < frame.size; ++i) bytes_[size_ + i] = frame[i];
    size_ += frame.size;
  }
  Bytes payload() const { return {bytes_, size_}; }
  void clear() { size_ = 0; }

 private:
  std::uint8_t bytes_[kPayloadLimitFast];
  std::size_t size_ = 0;
};
static_assert(kTimeBytes + kMaxKoggerFrame <= kPayloadLimitFast, "one frame always fits");

}  // namespace

bool PendingCommands::full(std::uint64_t now_us) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    if (now_us - sent_us_[i] < kAnswerUs) sent_us_[kept++] = sent_us_[i];
  }
  count_ = kept;
  return count_ == kMost;
}

// Where one batch of a sonar goes: pings at once, other frames gathered until the batch is over.
class SonarTraffic::Outlet final : public SonarPort::Sink {
 public:
  Outlet(SonarTraffic& traffic, Channel channel) : traffic_(traffic), channel_(channel) {}

  void ping_ended(const PingCollector& ping) override { traffic_.send_ping(channel_, ping); }
  void other_frame(Bytes raw, std::uint32_t t_us) override {
    traffic_.side(channel_).pending.clear();
    if (!others_.fits(raw, traffic_.transmitter_.payload_limit())) flush();
    others_.add(raw, t_us);
  }
  void flush() {
    if (others_.empty()) return;
    traffic_.transmitter_.queue().put(Urgency::kSonarOther, raw_type(channel_), others_.payload());
    others_.clear();
  }

 private:
  SonarTraffic& traffic_;
  Channel channel_;
  RawPayload others_;
};

void SonarTraffic::take(Channel channel, std::uint64_t now_us) {
  Outlet outlet(*this, channel);
  side(channel).port.take(now_us, outlet);
  outlet.flush();
}

void SonarTraffic::end_after_silence(Channel channel, std::uint64_t now_us) {
  Outlet outlet(*this, channel);
  side(channel).port.end_after_silence(now_us, outlet);
}

void SonarTraffic::choose_raw() {
  const SonarPort& a = sides_[0].port;
  const SonarPort& b = sides_[1].port;
  const std::uint64_t wanted =
      std::uint64_t{a.ping_bytes_per_s()} + b.ping_bytes_per_s() + transmitter_.other_bytes_per_s();
  const std::uint64_t percent = raw_ ? kLeaveRawPercent : kEnterRawPercent;
  raw_ = !a.rate_needed() && !b.rate_needed() && wanted * 100 < percent * transmitter_.bytes_per_s();
}

void SonarTraffic::send_ping(Channel channel, const PingCollector& ping) {
  choose_raw();
  SendQueue& queue = transmitter_.queue();
  queue.begin_ping(channel);
  if (raw_ && ping.longest_frame() + kTimeBytes <= transmitter_.payload_limit()) {
    send_raw(channel, ping);
  } else {
    send_compressed(channel, ping);
  }
  queue.end_ping(transmitter_.bytes_per_s());
}

void SonarTraffic::send_raw(Channel channel, const PingCollector& ping) {
  RawPayload payload;
  const auto flush = [&] { transmitter_.queue().ping_payload(raw_type(channel), payload.payload()); };
  for (Bytes rest = ping.raw(); rest.size != 0;) {
    const Bytes frame = rest.first(frame_bytes(rest.data));
    rest = rest.from(frame.size);
    if (!payload.fits(frame, transmitter_.payload_limit())) {
      flush();
      payload.clear();
    }
    payload.add(frame, ping.t_us());
  }
  flush();
}

void SonarTraffic::send_compressed(Channel channel, const PingCollector& ping) {
  class ToQueue final : public BundlePacker::Sink {
   public:
    explicit ToQueue(SendQueue& queue) : queue_(queue) {}
    void payload(Bytes payload) override { queue_.ping_payload(MessageType::kKoggerCompressed, payload); }

   private:
    SendQueue& queue_;
  } to_queue(transmitter_.queue());

  BundlePacker packer(channel, settings_.decimation, settings_.coding, transmitter_.payload_limit(), to_queue);
  packer.begin(++side(channel).compressed_pings, ping.t_us(), ping.version(), ping.mark());
  for (Bytes rest = ping.raw(); rest.size != 0;) {
    const KoggerFrame frame{rest.first(frame_bytes(rest.data)), 0};
    rest = rest.from(frame.raw.size);
    const Bytes chart = frame.payload();
    packer.add({get_u16(chart.data), get_u16(chart.data + 2), get_u16(chart.data + 4), chart.from(6)});
  }
  packer.end();
}

}  // namespace brov
