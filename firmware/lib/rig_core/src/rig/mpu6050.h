// InvenSense's MPU-6050 at +-2 g and +-250 deg/s. All five share an address; a pin of each chooses the one that has it.
#pragma once

#include "brov/i2c_device.h"

namespace brov::rig {

constexpr std::uint8_t kImuAddress = 0x68;  // AD0 low

// Sums of raw readings.
struct ImuSums {
  std::int32_t acceleration[3] = {};  // 16384 is 1 g
  std::int32_t rate[3] = {};          // 131 is 1 deg/s
  std::int32_t temperature = 0;       // 340 is 1 K, 0 is 36.53 degC
  std::uint8_t readings = 0;

  // The means on the wire; `unknown` without any reading.
  std::int32_t acceleration_umps2(std::size_t axis, std::int32_t unknown) const;
  std::int32_t rate_uradps(std::size_t axis, std::int32_t unknown) const;
  std::int16_t temperature_cdegc(std::int16_t unknown) const;
};

// The one that is chosen: woken and set up. False where nothing answers, or something else does.
bool wake_imu(CountedBus& bus, std::uint64_t now_us);
// Adds one reading. False, and nothing added, where none comes or the sensor is asleep (it reads all zeros then).
bool read_imu(CountedBus& bus, ImuSums& sums, std::uint64_t now_us);

}  // namespace brov::rig
