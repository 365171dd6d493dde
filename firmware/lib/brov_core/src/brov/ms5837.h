// MS5837-30BA depth sensor at 0x76. Source: TE datasheet rev C2, pressure and temperature calculation, CRC-4 (AN520).
#pragma once

#include "brov/i2c_device.h"

namespace brov {

// The checksum of the family over eight words, with the bits of the checksum itself zero.
std::uint8_t ms58xx_crc4(const std::uint16_t (&words)[8]);
// CRC-4 in the top bits of word 0. A bus held low reads as all zero, which the CRC would accept.
bool ms5837_prom_ok(const std::uint16_t (&prom)[7]);

struct Ms5837Result {
  std::int64_t pressure_pa = 0;  // = 0.01 mbar
  std::int32_t temperature_cdegc = 0;
};
// First and second order in 64-bit integers, every division a shift that rounds down. prom[i] is the datasheet's Ci.
// Check: 34982 36352 20328 22354 26646 26146, D1 4958179, D2 6815414: first order 19.81 degC, 3999.8 mbar.
Ms5837Result ms5837_compute(const std::uint16_t (&prom)[7], std::uint32_t d1, std::uint32_t d2);

class Ms5837 {
 public:
  void start(std::uint64_t boot_us) { wait_until_us_ = boot_us + 10000; }
  void tick(std::uint64_t now_us, CountedBus& bus);
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  bool ok(std::uint64_t now_us) const;
  std::int64_t pressure_pa() const { return result_.pressure_pa; }

 private:
  enum class Step : std::uint8_t { kReset, kProm, kConvert1, kRead1, kConvert2, kRead2 };

  bool step(std::uint64_t now_us, CountedBus& bus);
  bool read_prom_word(std::uint64_t now_us, CountedBus& bus);
  bool convert(std::uint8_t code, Step next, std::uint64_t now_us, CountedBus& bus);
  bool read_adc(std::uint32_t& value, std::uint64_t now_us, CountedBus& bus);
  bool take_pair(std::uint32_t d2, std::uint64_t now_us, CountedBus& bus);

  Step step_ = Step::kReset;
  std::uint8_t word_ = 0;
  std::uint16_t prom_[7] = {};
  std::uint32_t d1_ = 0;
  std::uint64_t wait_until_us_ = 10000, pair_started_us_ = 0;
  Stamp reading_seen_;
  Ms5837Result result_{};
};

}  // namespace brov
