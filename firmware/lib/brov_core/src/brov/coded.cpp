#include "brov/coded.h"

#include "brov/bundle.h"

namespace brov {
namespace {

constexpr int kMaxCoarseness = 240;
constexpr int kUsualCoarseness = 96;
constexpr std::uint32_t kEscape = 15;
constexpr int kHeaderBits = 16;
constexpr std::int32_t kTop = 255 * 8;
constexpr std::int32_t kFloor = 24 * 8;
constexpr std::int8_t kLevels[kEscape] = {0, -3, 2, 3, -6, 4, 5, -9, 6, 7, -12, 8, 9, -15, 10};

// Half a step at a running mean; both are in 1/8 of an amplitude.
inline std::int32_t half_step(unsigned coarseness, std::int32_t mean) {
  const auto scale = static_cast<std::int32_t>((16 + coarseness % 16) << (coarseness / 16));
  const std::int32_t half = (scale * (mean + kFloor)) >> 13;
  return half != 0 ? half : 1;
}

inline std::uint8_t decoded(std::uint32_t symbol, std::int32_t mean, std::int32_t half) {
  const std::int32_t sample = (mean + kLevels[symbol] * half + 4) >> 3;
  return static_cast<std::uint8_t>(sample < 0 ? 0 : sample > 255 ? 255 : sample);
}

// Whether the next level, which the end of the scale cuts short, is the better one, and not just noise there.
bool takes_edge(std::int32_t deviation, std::int32_t reached, std::int32_t edge, std::int32_t half) {
  const std::int32_t way = reached + ((5 * (edge - reached)) >> 3);
  return deviation >= (way > half >> 2 ? way : half >> 2);
}

// The symbol for a deviation that stays inside the scale; a level is taken from 5/8 of the way to it.
std::uint32_t symbol_for(std::int32_t deviation, std::int32_t mean, std::int32_t half) {
  std::int32_t level = 0;
  if (deviation >= 0) {  // levels 2, 3, 4... half steps up
    if (8 * deviation >= 10 * half) {
      level = 1;
      for (std::int32_t from = 21 * half; 8 * deviation >= from; from += 8 * half) {
        if (++level == 10) return kEscape;
      }
    }
    const std::int32_t reached = level != 0 ? (level + 1) * half : 0, room = kTop - mean;
    if (reached < room && room < (level + 2) * half) level += takes_edge(deviation, reached, room, level ? 0 : half);
    return static_cast<std::uint32_t>(level + ((level + 1) >> 1));
  }
  for (std::int32_t from = 15 * half; -8 * deviation >= from; from += 24 * half) {  // levels 3, 6, 9... half steps down
    if (++level == 6) return kEscape;
  }
  const std::int32_t reached = 3 * level * half;
  if (reached < mean && mean < reached + 3 * half) level += takes_edge(-deviation, reached, mean, level ? 0 : half);
  return level == 0 ? 0 : level == 6 ? kEscape : static_cast<std::uint32_t>(3 * level - 2);
}

// One code, written as far as it fits.
class Attempt {
 public:
  Attempt(unsigned coarseness, std::uint8_t* into, std::size_t size)
      : coarseness_(coarseness), into_(into), size_(size), end_(static_cast<std::int32_t>(8 * size)) {
    for (std::size_t i = 0; i < size; ++i) into[i] = 0;
    into[0] = static_cast<std::uint8_t>(coarseness);
  }

  bool fits() const { return at_ <= end_; }
  std::int32_t bits() const { return at_ + static_cast<std::int32_t>(8 * size_) - end_; }

  void take(Bytes samples) {
    if (!begun_) {
      begun_ = true;
      into_[1] = samples[0];
      mean_ = 8 * samples[0];
      samples = samples.from(1);
    }
    std::int32_t mean = mean_, owed = owed_;
    std::int32_t at = at_;
    for (std::size_t i = 0; i < samples.size; ++i) {
      const std::int32_t half = half_step(coarseness_, mean), away = 8 * samples[i] - mean;
      // With part of what earlier samples lost: local means stay true, and peaks are left alone.
      const std::int32_t deviation = away < 2 * half ? away + (owed >> 3) : away;
      std::int32_t error = ((mean + 4) & ~7) - mean;
      const std::int32_t most_up = 10 * half, most_down = -15 * half;
      if (8 * deviation >= most_up || 8 * deviation <= most_down || mean < 3 * half || mean > kTop - 2 * half) {
        const std::int32_t inside = deviation < -mean ? -mean : deviation > kTop - mean ? kTop - mean : deviation;
        const std::uint32_t symbol = symbol_for(inside, mean, half);
        error = 8 * (symbol == kEscape ? samples[i] : decoded(symbol, mean, half)) - mean;
        at += static_cast<std::int32_t>(symbol);
        if (symbol == kEscape) escape(samples[i], at);
      }
      owed += away - error - (owed >> 2);
      mean += error >> 2;
      if (at < end_) into_[at >> 3] = static_cast<std::uint8_t>(into_[at >> 3] | 0x80 >> (at & 7));
      ++at;
    }
    mean_ = mean;
    owed_ = owed;
    at_ = at;
  }

 private:
  void escape(std::uint8_t sample, std::int32_t at) {
    end_ -= 8;
    if (at < end_) into_[end_ >> 3] = sample;
  }

  const unsigned coarseness_;
  std::uint8_t* const into_;
  const std::size_t size_;
  std::int32_t at_ = kHeaderBits, end_;  // where the next bit comes, and where the samples begin that are sent as they are
  std::int32_t mean_ = 0, owed_ = 0;
  bool begun_ = false;
};

// How much coarser the steps must be for `excess` bits to become `room`, as a rule; 0 if they hardly can be finer.
int coarser_by(std::int32_t excess, std::int32_t room) {
  constexpr int kMost = 64;
  int by = 0;
  excess *= 256;
  room *= 256;
  if (excess > room) {
    for (; by < kMost && excess > room; ++by) excess -= excess >> 4;
    return by;
  }
  for (; by > -kMost && excess + (excess >> 4) <= room; --by) excess += excess >> 4;
  return by;
}

// Reads unary symbols.
class SymbolReader {
 public:
  explicit SymbolReader(Bytes code) : code_(code) {}

  // False if there is no symbol 0..15.
  bool next(std::uint32_t& symbol) {
    for (symbol = 0; at_ != 8 * code_.size && symbol <= kEscape; ++symbol) {
      if (bit()) return true;
    }
    return false;
  }
  // Whether all bits up to `end` are zero.
  bool zeros_until(std::size_t end) {
    if (at_ > end) return false;
    while (at_ != end) {
      if (bit()) return false;
    }
    return true;
  }

 private:
  bool bit() {
    const bool set = (code_[at_ / 8] & 0x80u >> at_ % 8) != 0;
    ++at_;
    return set;
  }

  Bytes code_;
  std::size_t at_ = kHeaderBits;
};

}  // namespace

std::size_t SampleRun::size() const {
  std::size_t size = 0;
  each([&](Bytes samples) { size += samples.size; });
  return size;
}

void encode_samples(const SampleRun& run, std::uint8_t* into, std::size_t size) {
  constexpr int kMostAttempts = 8, kGuesses = 4;
  std::uint8_t other[kPayloadLimitFast];
  std::uint8_t *spare = other, *best = into;
  const auto least = static_cast<std::int32_t>(run.size()) - 1 + kHeaderBits, most = static_cast<std::int32_t>(8 * size);
  int too_fine = -1, fitting = kMaxCoarseness + 1, next = kUsualCoarseness;
  for (int tried = 1; tried <= kMostAttempts; ++tried) {
    Attempt attempt(static_cast<unsigned>(next), spare, size);
    run.each([&](Bytes samples) { attempt.take(samples); });
    if (attempt.fits()) {
      fitting = next;
      std::uint8_t* const fits = spare;
      spare = best;
      best = fits;
    } else {
      too_fine = next;
    }
    const int by = coarser_by(attempt.bits() - least, most - least);
    if (by == 0 || fitting - too_fine == 1) break;
    next += by;
    if (tried >= kGuesses) next = (too_fine + fitting) / 2;
    if (tried + 1 == kMostAttempts && fitting > kMaxCoarseness) next = kMaxCoarseness;  // the last attempt must fit
    if (next <= too_fine) next = too_fine + 1;
    if (next >= fitting) next = fitting - 1;
  }
  for (std::size_t i = 0; best != into && i < size; ++i) into[i] = best[i];
}

bool decode_samples(Bytes code, std::uint8_t* samples, std::size_t count) {
  if (code.size < kMinCodeBytes || count == 0 || code[0] > kMaxCoarseness) return false;
  SymbolReader symbols(code);
  std::size_t escaped = code.size;
  std::int32_t mean = 8 * code[1];
  samples[0] = code[1];
  for (std::size_t i = 1; i < count; ++i) {
    std::uint32_t symbol = 0;
    if (!symbols.next(symbol)) return false;
    samples[i] = symbol == kEscape ? code[--escaped] : decoded(symbol, mean, half_step(code[0], mean));
    mean += (8 * samples[i] - mean) >> 2;
  }
  return symbols.zeros_until(8 * escaped);
}

}  // namespace brov
