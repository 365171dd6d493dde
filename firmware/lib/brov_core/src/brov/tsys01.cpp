#include "brov/tsys01.h"

#include "brov/rounding.h"

namespace brov {

namespace {

constexpr std::uint8_t kAddress = 0x77;
constexpr std::uint8_t kReset = 0x1E, kConvert = 0x48, kReadAdc = 0x00, kReadProm = 0xA0;
constexpr std::uint64_t kResetUs = 10000, kConversionUs = 10000, kPeriodUs = 100000, kHealUs = 500000;
constexpr std::uint64_t kFreshUs = 1000000;
constexpr double kLeastDegc = -40.0, kMostDegc = 125.0;

}  // namespace

bool tsys01_prom_ok(const std::uint16_t (&prom)[8]) {
  std::uint32_t sum = 0;
  for (const std::uint16_t word : prom) {
    sum += static_cast<std::uint32_t>((word >> 8) + (word & 0xFF));
  }
  return sum != 0 && sum % 256 == 0;
}

double tsys01_temperature_degc(const std::uint16_t (&prom)[8], std::uint32_t adc24) {
  const double a = adc24 / 256.0;
  double t = -2e-21 * prom[1];
  t = t * a + 4e-16 * prom[2];
  t = t * a + -2e-11 * prom[3];
  t = t * a + 1e-6 * prom[4];
  return t * a + -1.5e-2 * prom[5];
}

void Tsys01::tick(std::uint64_t now_us, CountedBus& bus) {
  if (now_us >= wait_until_us_ && !step(now_us, bus)) {
    step_ = Step::kReset;
    wait_until_us_ = now_us + kHealUs;
  }
}

// One transaction; false = back to the reset.
bool Tsys01::step(std::uint64_t now_us, CountedBus& bus) {
  switch (step_) {
    case Step::kReset:
      step_ = Step::kProm;
      word_ = 0;
      wait_until_us_ = now_us + kResetUs;
      return bus.command(kAddress, kReset, now_us);
    case Step::kProm:
      return read_prom_word(now_us, bus);
    case Step::kConvert:
      step_ = Step::kRead;
      started_us_ = now_us;
      wait_until_us_ = now_us + kConversionUs;
      return bus.command(kAddress, kConvert, now_us);
    case Step::kRead:
      step_ = Step::kConvert;
      wait_until_us_ = started_us_ + kPeriodUs;
      return read_temperature(now_us, bus);
  }
  return false;
}

bool Tsys01::read_prom_word(std::uint64_t now_us, CountedBus& bus) {
  std::uint8_t answer[2] = {};
  if (!bus.read_answer(kAddress, static_cast<std::uint8_t>(kReadProm + 2 * word_), answer, sizeof answer, now_us)) {
    return false;
  }
  prom_[word_] = static_cast<std::uint16_t>(answer[0] << 8 | answer[1]);
  ++word_;
  if (word_ < 8) {
    return true;
  }
  step_ = Step::kConvert;
  if (tsys01_prom_ok(prom_)) {
    return true;
  }
  bus.count_bad_content();
  return false;
}

bool Tsys01::read_temperature(std::uint64_t now_us, CountedBus& bus) {
  std::uint8_t answer[3] = {};
  if (!bus.read_answer(kAddress, kReadAdc, answer, sizeof answer, now_us)) {
    return false;
  }
  const std::uint32_t adc24 = static_cast<std::uint32_t>(answer[0] << 16 | answer[1] << 8 | answer[2]);
  const double temperature_degc = tsys01_temperature_degc(prom_, adc24);
  if (adc24 == 0 || temperature_degc < kLeastDegc || temperature_degc > kMostDegc) {
    bus.count_bad_content();
    return false;
  }
  temperature_degc_ = temperature_degc;
  reading_seen_.set(now_us);
  return true;
}

bool Tsys01::ok(std::uint64_t now_us) const { return reading_seen_.within(now_us, kFreshUs); }

void Tsys01::fill(SensorFields& fields, std::uint64_t now_us) const {
  if (!ok(now_us)) {
    return;
  }
  fields.temperature_ok = 1;
  fields.temperature_cdegc = static_cast<std::int16_t>(rounded(temperature_degc_ * 100.0));
}

}  // namespace brov
