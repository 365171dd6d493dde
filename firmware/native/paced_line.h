// A serial line that carries ten bits per byte, in exact arithmetic. docs/firmware-core.md section 3.
#pragma once

#include <cstdint>

namespace brov {

class PacedLine {
 public:
  explicit PacedLine(std::uint32_t baud) : baud_(baud) {}

  void set_baud(std::uint32_t baud, std::uint64_t now_us) {
    baud_ = baud;
    free_ = now_us * baud;
  }
  void write(std::uint64_t bytes, std::uint64_t now_us) {
    const std::uint64_t now = now_us * baud_;
    free_ = (free_ > now ? free_ : now) + bytes * kByte;
  }
  // Bytes written that are not out yet, the one that is just going out included.
  std::uint32_t backlog(std::uint64_t now_us) const {
    const std::uint64_t now = now_us * baud_;
    return free_ > now ? static_cast<std::uint32_t>((free_ - now + kByte - 1) / kByte) : 0;
  }

 private:
  static constexpr std::uint64_t kByte = 10000000;  // ten bits, in units of 1 / baud us

  std::uint32_t baud_;
  std::uint64_t free_ = 0;  // when the line is free, in the same units
};

}  // namespace brov
