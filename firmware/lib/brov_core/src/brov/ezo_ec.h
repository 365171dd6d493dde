// Atlas EZO EC: lines of conductivity and salinity. They have no checksum. docs/firmware-core.md section 6.
#pragma once

#include <array>

#include "brov/readings.h"

namespace brov {

class EzoEcReader {
 public:
  void start(std::uint64_t boot_us) { command_us_ = boot_us + kFirstCommandUs; }
  void feed(Bytes batch, std::uint64_t now_us);
  void configure(std::uint64_t now_us, Hal& hal);
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  bool alive(std::uint64_t now_us) const;
  std::uint32_t conductivity_dus() const { return conductivity_dus_; }
  std::uint16_t errors() const { return errors_; }

 private:
  static constexpr std::size_t kMaxLineBytes = 40;
  static constexpr std::uint64_t kFirstCommandUs = 700000;

  void end_line(std::uint64_t now_us);
  bool take_reading(Bytes text, std::uint64_t now_us);

  std::array<std::uint8_t, kMaxLineBytes> line_{};
  std::size_t size_ = 0;
  bool too_long_ = false;
  bool whole_ = false;           // this line's first byte was not lost
  bool has_end_ = false;         // a line end came, and no gap in mid-line since
  std::uint64_t end_us_ = 0;
  std::uint64_t byte_us_ = 0;
  std::uint16_t errors_ = 0;

  std::uint32_t conductivity_dus_ = 0;
  std::uint16_t salinity_cpsu_ = 0xFFFF;
  Stamp reading_seen_, both_seen_;

  std::uint8_t command_ = 0;
  bool configuring_ = true;
  std::uint64_t command_us_ = kFirstCommandUs, set_us_ = 0;
};

}  // namespace brov
