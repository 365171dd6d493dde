#include "rig/mpu6050.h"

namespace brov::rig {

namespace {

constexpr std::uint8_t kConfig = 0x1A, kGyroConfig = 0x1B, kAccelConfig = 0x1C, kData = 0x3B, kPower = 0x6B,
                       kWhoAmI = 0x75;
constexpr std::uint8_t kGyroClock = 0x01, kLowPass44Hz = 0x03, kTwoG = 0x00, k250DegPerS = 0x00;
constexpr std::uint8_t kIdentity = 0x68;
constexpr std::size_t kDataBytes = 14;

std::int16_t big_endian(const std::uint8_t* at) { return static_cast<std::int16_t>(at[0] << 8 | at[1]); }

}  // namespace

std::int32_t ImuSums::acceleration_umps2(std::size_t axis, std::int32_t unknown) const {
  if (readings == 0) return unknown;
  return static_cast<std::int32_t>(divide_rounded(std::int64_t{acceleration[axis]} * 9806650, 16384 * readings));
}

std::int32_t ImuSums::rate_uradps(std::size_t axis, std::int32_t unknown) const {
  if (readings == 0) return unknown;
  // pi / 180 in units of 1e-9.
  return static_cast<std::int32_t>(divide_rounded(std::int64_t{rate[axis]} * 17453293, 131000 * readings));
}

std::int16_t ImuSums::temperature_cdegc(std::int16_t unknown) const {
  if (readings == 0) return unknown;
  return static_cast<std::int16_t>(divide_rounded(std::int64_t{temperature} * 100, 340 * readings) + 3653);
}

bool wake_imu(CountedBus& bus, std::uint64_t now_us) {
  std::uint8_t identity = 0;
  if (!bus.read_answer(kImuAddress, kWhoAmI, &identity, 1, now_us)) return false;
  if (identity != kIdentity) {
    bus.count_bad_content();
    return false;
  }
  const std::uint8_t steps[][2] = {
      {kPower, kGyroClock}, {kConfig, kLowPass44Hz}, {kGyroConfig, k250DegPerS}, {kAccelConfig, kTwoG}};
  for (const auto& step : steps) {
    if (!bus.write(kImuAddress, {step, sizeof step}, now_us)) return false;
  }
  return true;
}

bool read_imu(CountedBus& bus, ImuSums& sums, std::uint64_t now_us) {
  std::uint8_t bytes[kDataBytes];
  if (!bus.read_answer(kImuAddress, kData, bytes, sizeof bytes, now_us)) return false;
  std::int16_t values[kDataBytes / 2];
  bool any = false;
  for (std::size_t i = 0; i < kDataBytes / 2; ++i) {
    values[i] = big_endian(bytes + 2 * i);
    any = any || values[i] != 0;
  }
  if (!any) {
    bus.count_bad_content();
    return false;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    sums.acceleration[i] += values[i];
    sums.rate[i] += values[4 + i];
  }
  sums.temperature += values[3];
  ++sums.readings;
  return true;
}

}  // namespace brov::rig
