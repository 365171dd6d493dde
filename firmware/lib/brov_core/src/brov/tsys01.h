// TSYS01 thermometer at 0x77. Source: TE datasheet, temperature polynomial, PROM checksum.
#pragma once

#include "brov/i2c_device.h"

namespace brov {

// The sum of all bytes is 0. A bus held low reads as all zero, which the sum would accept.
bool tsys01_prom_ok(const std::uint16_t (&prom)[8]);

// a = adc24 / 256, k4..k0 = prom[1]..prom[5], in this order of operations:
//   (((-2e-21 k4 a + 4e-16 k3) a + -2e-11 k2) a + 1e-6 k1) a + -1.5e-2 k0
// Check: 28446 24926 36016 32791 40781 and a = 36636: 10.59 degC.
double tsys01_temperature_degc(const std::uint16_t (&prom)[8], std::uint32_t adc24);

class Tsys01 {
 public:
  void start(std::uint64_t boot_us) { wait_until_us_ = boot_us + 10000; }
  void tick(std::uint64_t now_us, CountedBus& bus);
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  bool ok(std::uint64_t now_us) const;
  double temperature_degc() const { return temperature_degc_; }

 private:
  enum class Step : std::uint8_t { kReset, kProm, kConvert, kRead };

  bool step(std::uint64_t now_us, CountedBus& bus);
  bool read_prom_word(std::uint64_t now_us, CountedBus& bus);
  bool read_temperature(std::uint64_t now_us, CountedBus& bus);

  Step step_ = Step::kReset;
  std::uint8_t word_ = 0;
  std::uint16_t prom_[8] = {};
  std::uint64_t wait_until_us_ = 10000, started_us_ = 0;
  Stamp reading_seen_;
  double temperature_degc_ = 0.0;
};

}  // namespace brov
