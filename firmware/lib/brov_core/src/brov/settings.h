// What the host may change (CONFIG), and what the board is born with.
#pragma once

#include <cstdint>

namespace brov {

enum class Coding : std::uint8_t { kMean = 0, kPeak = 1, kCoded = 2 };

struct Settings {
  std::uint32_t sensors_rate_mhz = 2000;
  std::uint32_t imu_rate_mhz = 20000;
  std::uint8_t decimation = 4;
  Coding coding = Coding::kMean;
  std::uint32_t baud = 115200;  // at boot
};

enum class ConfigKey : std::uint8_t { kSensorsRate = 1, kImuRate = 2, kDecimation = 3, kBaud = 4 };

constexpr bool config_allowed(std::uint8_t key, std::uint32_t value) {
  switch (key) {
    case 1: return value >= 500 && value <= 20000;
    case 2: return value >= 1000 && value <= 20000;
    case 3: return value >= 1 && value <= 8;
    case 4: return value == 115200 || value == 921600;
    default: return false;
  }
}

}  // namespace brov
