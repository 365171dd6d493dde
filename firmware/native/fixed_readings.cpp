#include "fixed_readings.h"

#include <cmath>

#include "brov/sensors.h"

namespace brov {

namespace {

constexpr std::uint32_t kAdcEnd = 1u << 24;

// The smallest raw value at which a reading that grows with it is at least the wanted one.
template <typename Reading>
std::uint32_t raw_value_for(Reading at_least) {
  std::uint32_t low = 1, high = kAdcEnd - 1;
  while (low < high) {
    const std::uint32_t middle = (low + high) / 2;
    if (at_least(middle)) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

void set_ms5837(ConvertingSensor& sensor, double pressure_pa, double temperature_degc) {
  // Coefficients of the worked example in TE's datasheet.
  std::uint16_t prom[7] = {0, 34982, 36352, 20328, 22354, 26646, 26146};
  while (!ms5837_prom_ok(prom)) prom[0] = static_cast<std::uint16_t>(prom[0] + 0x1000);
  for (std::size_t i = 0; i < 7; ++i) sensor.set_prom_word(i, prom[i]);
  const auto wanted_cdegc = static_cast<std::int32_t>(std::lround(temperature_degc * 100.0));
  const auto wanted_pa = static_cast<std::int64_t>(std::llround(pressure_pa));
  const std::uint32_t d2 = raw_value_for(
      [&](std::uint32_t raw) { return ms5837_compute(prom, kAdcEnd / 2, raw).temperature_cdegc >= wanted_cdegc; });
  const std::uint32_t d1 =
      raw_value_for([&](std::uint32_t raw) { return ms5837_compute(prom, raw, d2).pressure_pa >= wanted_pa; });
  sensor.set_value(0, d1);
  sensor.set_value(1, d2);
}

void set_tsys01(ConvertingSensor& sensor, double temperature_degc) {
  // Coefficients k4 to k0 of the worked example in TE's datasheet; the last word's bytes make the sum of all zero.
  std::uint16_t prom[8] = {0, 28446, 24926, 36016, 32791, 40781, 0, 0};
  while (!tsys01_prom_ok(prom)) ++prom[7];
  for (std::size_t i = 0; i < 8; ++i) sensor.set_prom_word(i, prom[i]);
  sensor.set_value(0, raw_value_for([&](std::uint32_t raw) {
                     return tsys01_temperature_degc(prom, raw) >= temperature_degc;
                   }));
}

}  // namespace

void set_fixed_readings(I2cModels& models, std::optional<double> pressure_pa, std::optional<double> temperature_degc) {
  const bool depth = pressure_pa.has_value() && temperature_degc.has_value();
  const bool celsius = temperature_degc.has_value();
  if (depth) set_ms5837(models.ms5837(), *pressure_pa, *temperature_degc);
  if (celsius) set_tsys01(models.tsys01(), *temperature_degc);
  models.set_state(depth ? BusState::kFine : celsius ? BusState::kMs5837Silent : BusState::kBothSilent);
}

}  // namespace brov
