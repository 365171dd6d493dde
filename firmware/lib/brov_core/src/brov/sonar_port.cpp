#include "brov/sonar_port.h"

#include "brov/bundle.h"
#include "brov/hal.h"
#include "brov/sensors.h"

namespace brov {

namespace {

constexpr std::uint8_t kContent = 1;
constexpr std::uint8_t kResponseBit = 0x80;
constexpr std::size_t kChartHeaderBytes = 6;
constexpr std::size_t kMaxBatch = 1024;
constexpr std::uint64_t kPingSilenceUs = 8000;
constexpr std::int64_t kRateSmoothing = 5;

struct Chart {
  std::uint16_t seq_offset, resolution_mm, first_sample;
  std::uint32_t end;  // behind its last sample
};

Chart chart_of(const KoggerFrame& frame) {
  const Bytes payload = frame.payload();
  const std::uint16_t seq_offset = get_u16(payload.data);
  const auto samples = static_cast<std::uint32_t>(payload.size - kChartHeaderBytes);
  return {seq_offset, get_u16(payload.data + 2), get_u16(payload.data + 4), seq_offset + samples};
}

}  // namespace

PingCollector::Kind PingCollector::kind(const KoggerFrame& frame) {
  const bool response = (frame.raw[3] & kResponseBit) != 0;
  if (frame.type() != kContent || response || frame.id() != kKoggerChartId || frame.version() > 1) return Kind::kOther;
  if (frame.payload().size <= kChartHeaderBytes) return Kind::kBadChart;
  const Chart chart = chart_of(frame);
  return chart.resolution_mm == 0 || chart.end >= kMaxPingBytes ? Kind::kBadChart : Kind::kChart;
}

bool PingCollector::ended_by(const KoggerFrame& frame) const {
  if (!open()) return false;
  const Chart chart = chart_of(frame);
  const bool other_ping = frame.version() != version_ || chart.resolution_mm != resolution_mm_ ||
                          chart.first_sample != first_sample_ || chart.seq_offset < filled_;
  return other_ping || size_ + frame.raw.size > kMaxBytes || frames_ == kMaxFrames;
}

void PingCollector::add(const KoggerFrame& frame, std::uint64_t first_byte_us, std::uint64_t now_us) {
  if (!open()) {
    t_us_ = static_cast<std::uint32_t>(first_byte_us);
    version_ = frame.version();
    mark_ = frame.mark();
  }
  const Chart chart = chart_of(frame);
  filled_ = chart.end;
  resolution_mm_ = chart.resolution_mm;
  first_sample_ = chart.first_sample;
  for (std::size_t i = 0; i < frame.raw.size; ++i) raw_[size_ + i] = frame.raw[i];
  size_ += frame.raw.size;
  if (frame.raw.size > longest_) longest_ = frame.raw.size;
  ++frames_;
  last_chunk_us_ = now_us;
}

void SonarPort::take(std::uint64_t now_us, Sink& sink) {
  std::size_t left = ring_.size();  // once: the writer may be adding to it
  if (left > kMaxBatch) left = kMaxBatch;
  bytes_ += static_cast<std::uint32_t>(left);
  heard_ = heard_ || left != 0;
  while (left != 0) {
    const Bytes piece = ring_.front(left < KoggerFramer::kMaxFeed ? left : KoggerFramer::kMaxFeed);
    framer_.feed(piece);
    ring_.consume(piece.size);
    left -= piece.size;
    KoggerFrame frame;
    while (framer_.next(frame)) {
      take_frame(frame, arrival_us(now_us, frame.behind + left, kSonarBaud), now_us, sink);
    }
  }
}

void SonarPort::take_frame(const KoggerFrame& frame, std::uint64_t first_byte_us, std::uint64_t now_us, Sink& sink) {
  switch (PingCollector::kind(frame)) {
    case PingCollector::Kind::kOther: sink.other_frame(frame.raw, static_cast<std::uint32_t>(first_byte_us)); break;
    case PingCollector::Kind::kBadChart: break;
    case PingCollector::Kind::kChart:
      if (ping_.ended_by(frame)) end_ping(now_us, sink);
      ping_.add(frame, first_byte_us, now_us);
      break;
  }
}

void SonarPort::end_after_silence(std::uint64_t now_us, Sink& sink) {
  if (ping_.open() && now_us - ping_.last_chunk_us() >= kPingSilenceUs) end_ping(now_us, sink);
}

void SonarPort::end_ping(std::uint64_t now_us, Sink& sink) {
  measure(now_us);
  sink.ping_ended(ping_);
  ping_.clear();
}

void SonarPort::measure(std::uint64_t now_us) {
  if (ended_one_ && now_us > ended_us_) {
    const std::uint64_t bytes = ping_.raw().size;
    const auto rate = static_cast<std::int64_t>(bytes * 1000000 / (now_us - ended_us_));
    rate_ += rate_known_ ? (rate - rate_) / kRateSmoothing : rate;
    rate_known_ = true;
  }
  ended_one_ = true;
  ended_us_ = now_us;
}

}  // namespace brov
