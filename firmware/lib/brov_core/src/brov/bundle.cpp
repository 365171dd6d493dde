#include "brov/bundle.h"

#include "brov/coded.h"

namespace brov {
namespace {

constexpr std::size_t kHeader = 9, kChunkHeader = 7;
constexpr std::size_t kMaxChunkSamples = 249;  // LENGTH 255 less the six header bytes of a chart
constexpr std::uint8_t kPairsFromDecimation = 6;  // too few bits for every sample: pairs of them are coded
constexpr unsigned kMarkBit = 1 << 5, kLastBit = 1 << 6;

constexpr std::size_t divided_up(std::size_t count, std::size_t by) { return (count + by - 1) / by; }

constexpr std::size_t decimated_size(std::size_t samples, std::size_t decimation, std::uint8_t version) {
  if (version == 0) return divided_up(samples, decimation);
  const std::size_t first = divided_up(samples, 2);
  return divided_up(first, decimation) + divided_up(samples - first, decimation);
}

// 65536 / (2 count), rounded up.
constexpr std::uint16_t kReciprocals[] = {0, 32768, 16384, 10923, 8192, 6554, 5462, 4682, 4096};

// The mean of `count` samples, 1 to 8, rounded half up. A multiplication: the division that it stands for (exactly, for
// sums of so few bytes) takes fifty instructions where the processor has none, once for every byte of a ping.
std::uint8_t mean_of(const std::uint8_t* at, std::size_t step, std::size_t count) {
  std::uint32_t sum = 0;
  for (std::size_t left = count; left != 0; --left, at += step) sum += *at;
  return static_cast<std::uint8_t>((2 * sum + count) * kReciprocals[count] >> 16);
}

std::uint8_t peak_of(const std::uint8_t* at, std::size_t step, std::size_t count) {
  std::uint8_t peak = 0;
  for (; count != 0; --count, at += step) peak = *at > peak ? *at : peak;
  return peak;
}

}  // namespace

std::size_t decimate(Bytes samples, std::uint8_t decimation, Coding coding, std::uint8_t version, std::uint8_t* into) {
  const std::size_t channels = version == 0 ? 1 : 2;
  const std::size_t whole = channels * decimation;
  const auto group = coding == Coding::kPeak ? peak_of : mean_of;
  std::size_t written = 0;
  for (; samples.size >= whole; samples = samples.from(whole)) {
    for (std::size_t c = 0; c < channels; ++c) into[written++] = group(samples.data + c, channels, decimation);
  }
  for (std::size_t c = 0; c < channels && c < samples.size; ++c) {
    into[written++] = group(samples.data + c, channels, divided_up(samples.size - c, channels));
  }
  return written;
}

BundlePacker::BundlePacker(Channel channel, std::uint8_t decimation, Coding coding, std::size_t payload_limit,
                           Sink& sink)
    : channel_(channel), decimation_(decimation), coding_(coding), limit_(payload_limit), sink_(sink) {}

void BundlePacker::begin(std::uint8_t ping_number, std::uint32_t t_us, std::uint8_t version, bool mark) {
  ping_number_ = ping_number;
  t_us_ = t_us;
  version_ = version;
  mark_ = mark;
  chunks_ = 0;
  size_ = kHeader;
}

void BundlePacker::add(const ChartChunk& chunk) {
  const std::size_t size = chunk.samples.size;
  if (chunk.seq_offset + size >= kMaxPingBytes) return;
  const std::size_t room = (limit_ - kHeader - kChunkHeader) * decimation_;
  const std::size_t group = static_cast<std::size_t>(decimation_) * (version_ == 0 ? 1 : 2);
  const std::size_t shorter = room < kMaxChunkSamples ? room : kMaxChunkSamples;
  std::size_t most = shorter / group * group;
  if (size <= kMaxChunkSamples && decimated_size(size, decimation_, version_) * decimation_ <= room / group * group) {
    most = size;
  }
  for (std::size_t start = 0; start < size; start += most) {
    const Bytes rest = chunk.samples.from(start);
    piece(static_cast<std::uint16_t>(chunk.seq_offset + start), chunk, rest.first(rest.size < most ? rest.size : most));
  }
}

void BundlePacker::piece(std::uint16_t seq_offset, const ChartChunk& chunk, Bytes part) {
  const std::size_t size = kChunkHeader + decimated_size(part.size, decimation_, version_);
  if (chunks_ != 0 && size_ + size > limit_) flush(false);
  std::uint8_t* at = payload_ + size_;
  put_u16(at, seq_offset);
  put_u16(at + 2, chunk.resolution_mm);
  put_u16(at + 4, chunk.first_sample);
  at[6] = static_cast<std::uint8_t>(part.size);
  if (!coded()) decimate(part, decimation_, coding_, version_, at + kChunkHeader);
  parts_[chunks_++] = part;
  size_ += size;
}

void BundlePacker::end() {
  if (chunks_ != 0) flush(true);
}

void BundlePacker::fill_coded() {
  std::uint8_t code[kPayloadLimitFast];
  const std::size_t size = size_ - kHeader - chunks_ * kChunkHeader;
  const bool means = size < kMinCodeBytes;
  if (!means) encode_samples({parts_, chunks_, version_, decimation_ >= kPairsFromDecimation}, code, size);
  const std::uint8_t* from = code;
  std::uint8_t* at = payload_ + kHeader;
  for (std::size_t chunk = 0; chunk < chunks_; ++chunk) {
    at += kChunkHeader;
    if (means) decimate(parts_[chunk], decimation_, Coding::kMean, version_, at);
    for (std::size_t left = decimated_size(parts_[chunk].size, decimation_, version_); left != 0; --left, ++at) {
      if (!means) *at = *from++;
    }
  }
}

void BundlePacker::flush(bool last) {
  if (coded()) fill_coded();
  const unsigned flags = static_cast<unsigned>(coding_) | static_cast<unsigned>(version_) << 2 |
                         (mark_ ? kMarkBit : 0) | (last ? kLastBit : 0);
  payload_[0] = static_cast<std::uint8_t>(channel_);
  payload_[1] = static_cast<std::uint8_t>(flags);
  payload_[2] = decimation_;
  payload_[3] = chunks_;
  payload_[4] = ping_number_;
  put_u32(payload_ + 5, t_us_);
  sink_.payload({payload_, size_});
  chunks_ = 0;
  size_ = kHeader;
}

}  // namespace brov
