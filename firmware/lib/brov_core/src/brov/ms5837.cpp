#include "brov/ms5837.h"

namespace brov {

namespace {

constexpr std::uint8_t kAddress = 0x76;
constexpr std::uint8_t kReset = 0x1E, kConvertD1 = 0x4A, kConvertD2 = 0x5A, kReadAdc = 0x00, kReadProm = 0xA0;
constexpr std::uint64_t kResetUs = 10000, kConversionUs = 20000, kPairUs = 50000, kHealUs = 500000;
constexpr std::uint64_t kFreshUs = 1000000;
constexpr std::int64_t kMostPressurePa = 3200000;
constexpr std::int32_t kLeastCdegc = -2000, kMostCdegc = 8500;

}  // namespace

std::uint8_t ms58xx_crc4(const std::uint16_t (&words)[8]) {
  std::uint32_t remainder = 0;
  for (std::size_t i = 0; i < 16; ++i) {
    const std::uint16_t word = words[i / 2];
    remainder ^= i % 2 == 0 ? word >> 8 : word & 0xFFu;
    for (int bit = 0; bit < 8; ++bit) {
      remainder = (remainder & 0x8000u) != 0 ? (remainder << 1 ^ 0x3000u) & 0xFFFFu : remainder << 1;
    }
  }
  return static_cast<std::uint8_t>(remainder >> 12);
}

bool ms5837_prom_ok(const std::uint16_t (&prom)[7]) {
  std::uint16_t words[8] = {};
  std::uint32_t any = 0;
  for (std::size_t i = 0; i < 7; ++i) {
    words[i] = prom[i];
    any |= prom[i];
  }
  words[0] = prom[0] & 0x0FFF;
  return any != 0 && ms58xx_crc4(words) == prom[0] >> 12;
}

Ms5837Result ms5837_compute(const std::uint16_t (&prom)[7], std::uint32_t d1, std::uint32_t d2) {
  const std::int64_t dt = static_cast<std::int64_t>(d2) - prom[5] * std::int64_t{256};
  const std::int64_t temperature = 2000 + (dt * prom[6] >> 23);
  const std::int64_t offset = prom[2] * std::int64_t{65536} + (prom[4] * dt >> 7);
  const std::int64_t sensitivity = prom[1] * std::int64_t{32768} + (prom[3] * dt >> 8);

  const std::int64_t from_20_squared = (temperature - 2000) * (temperature - 2000);
  std::int64_t temperature_less = 0, offset_less = 0, sensitivity_less = 0;
  if (temperature < 2000) {
    temperature_less = 3 * dt * dt >> 33;
    offset_less = 3 * from_20_squared >> 1;
    sensitivity_less = 5 * from_20_squared >> 3;
    if (temperature < -1500) {
      const std::int64_t from_minus_15_squared = (temperature + 1500) * (temperature + 1500);
      offset_less += 7 * from_minus_15_squared;
      sensitivity_less += 4 * from_minus_15_squared;
    }
  } else {
    temperature_less = 2 * dt * dt >> 37;
    offset_less = from_20_squared >> 4;
  }
  const std::int64_t scaled_d1 = d1 * (sensitivity - sensitivity_less) >> 21;
  return {(scaled_d1 - (offset - offset_less)) * 10 >> 13, static_cast<std::int32_t>(temperature - temperature_less)};
}

void Ms5837::tick(std::uint64_t now_us, CountedBus& bus) {
  if (now_us >= wait_until_us_ && !step(now_us, bus)) {
    step_ = Step::kReset;
    wait_until_us_ = now_us + kHealUs;
  }
}

// One transaction; false = back to the reset.
bool Ms5837::step(std::uint64_t now_us, CountedBus& bus) {
  std::uint32_t d2 = 0;
  switch (step_) {
    case Step::kReset:
      step_ = Step::kProm;
      word_ = 0;
      wait_until_us_ = now_us + kResetUs;
      return bus.command(kAddress, kReset, now_us);
    case Step::kProm:
      return read_prom_word(now_us, bus);
    case Step::kConvert1:
      pair_started_us_ = now_us;
      return convert(kConvertD1, Step::kRead1, now_us, bus);
    case Step::kRead1:
      step_ = Step::kConvert2;
      return read_adc(d1_, now_us, bus);
    case Step::kConvert2:
      return convert(kConvertD2, Step::kRead2, now_us, bus);
    case Step::kRead2:
      step_ = Step::kConvert1;
      wait_until_us_ = pair_started_us_ + kPairUs;
      return read_adc(d2, now_us, bus) && take_pair(d2, now_us, bus);
  }
  return false;
}

bool Ms5837::read_prom_word(std::uint64_t now_us, CountedBus& bus) {
  std::uint8_t answer[2] = {};
  if (!bus.read_answer(kAddress, static_cast<std::uint8_t>(kReadProm + 2 * word_), answer, sizeof answer, now_us)) {
    return false;
  }
  prom_[word_] = static_cast<std::uint16_t>(answer[0] << 8 | answer[1]);
  ++word_;
  if (word_ < 7) {
    return true;
  }
  step_ = Step::kConvert1;
  if (ms5837_prom_ok(prom_)) {
    return true;
  }
  bus.count_bad_content();
  return false;
}

bool Ms5837::convert(std::uint8_t code, Step next, std::uint64_t now_us, CountedBus& bus) {
  step_ = next;
  wait_until_us_ = now_us + kConversionUs;
  return bus.command(kAddress, code, now_us);
}

bool Ms5837::read_adc(std::uint32_t& value, std::uint64_t now_us, CountedBus& bus) {
  std::uint8_t answer[3] = {};
  if (!bus.read_answer(kAddress, kReadAdc, answer, sizeof answer, now_us)) {
    return false;
  }
  value = static_cast<std::uint32_t>(answer[0] << 16 | answer[1] << 8 | answer[2]);
  if (value == 0) {
    bus.count_bad_content();  // what a chip answers that has not converted
  }
  return value != 0;
}

bool Ms5837::take_pair(std::uint32_t d2, std::uint64_t now_us, CountedBus& bus) {
  const Ms5837Result result = ms5837_compute(prom_, d1_, d2);
  if (result.pressure_pa <= 0 || result.pressure_pa > kMostPressurePa || result.temperature_cdegc < kLeastCdegc ||
      result.temperature_cdegc > kMostCdegc) {
    bus.count_bad_content();
    return false;
  }
  result_ = result;
  reading_seen_.set(now_us);
  return true;
}

bool Ms5837::ok(std::uint64_t now_us) const { return reading_seen_.within(now_us, kFreshUs); }

void Ms5837::fill(SensorFields& fields, std::uint64_t now_us) const {
  if (!ok(now_us)) {
    return;
  }
  fields.depth_ok = 1;
  fields.full_pressure_pa = static_cast<std::uint32_t>(result_.pressure_pa);
  fields.pressure_dmbar = static_cast<std::uint16_t>(clamped(divide_rounded(result_.pressure_pa, 10), 0, 0xFFFF));
  fields.depth_temperature_cdegc = static_cast<std::int16_t>(result_.temperature_cdegc);
}

}  // namespace brov
