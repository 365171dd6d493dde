#include "brov/kogger_framer.h"

#include "brov/checksums.h"

namespace brov {
namespace {

constexpr std::uint8_t kSync1 = 0xBB, kSync2 = 0x55;
constexpr std::size_t kHeader = 6, kOverhead = 8;
constexpr std::uint8_t kFramesToLearn = 10;

}  // namespace

bool KoggerFramer::next(KoggerFrame& frame) {
  for (Bytes held = stream_.held(); held.size > 0; held = stream_.held()) {
    if (held[0] == kSync1 && (held.size < 2 || held[1] == kSync2)) {
      if (held.size < kHeader || held.size < kOverhead + held[5]) return false;
      const Bytes raw = held.first(kOverhead + held[5]);
      if (intact(raw)) {
        frame.raw = raw;
        frame.behind = held.size - 1;
        stream_.take(raw.size);
        ++frames_ok_;
        return true;
      }
      ++checksum_errors_;
    }
    stream_.take(1);
  }
  return false;
}

bool KoggerFramer::intact(Bytes raw) {
  const Bytes body = raw.first(raw.size - 2).from(2);
  const KoggerCheck check{raw[raw.size - 2], raw[raw.size - 1]};
  if ((mod255_ ? kogger_mod255(body) : kogger_mod256(body)) == check) {
    streak_ = 0;
    return true;
  }
  if (learns_ && (mod255_ ? kogger_mod256(body) : kogger_mod255(body)) == check && ++streak_ >= kFramesToLearn) {
    mod255_ = !mod255_;
    streak_ = 0;
  }
  return false;
}

}  // namespace brov
