// What the readers of the small sensors share: when a byte came, how old a reading is, where reports go.
#pragma once

#include <cstdint>

#include "brov/hal.h"
#include "brov/payloads.h"

namespace brov {

// When a byte with `bytes_behind` bytes of its batch behind it came, if the last one came at `now_us`.
constexpr std::uint64_t arrival_us(std::uint64_t now_us, std::uint64_t bytes_behind, std::uint32_t baud) {
  const std::uint64_t ago = bytes_behind * 10000000u / baud;
  return ago > now_us ? 0 : now_us - ago;
}

// The tick that took the newest of something, if there was any.
class Stamp {
 public:
  constexpr void set(std::uint64_t now_us) {
    known_ = true;
    at_us_ = now_us;
  }
  constexpr bool within(std::uint64_t now_us, std::uint64_t span_us) const {
    return known_ && now_us - at_us_ <= span_us;
  }

 private:
  bool known_ = false;
  std::uint64_t at_us_ = 0;
};

// Receives complete reports of the readers.
class ReportSink {
 public:
  virtual void imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count) = 0;
  virtual void gps_report(const GpsFields& report) = 0;

 protected:
  ~ReportSink() = default;
};

}  // namespace brov
