#include "rig/servos.h"

namespace brov::rig {

namespace {

constexpr float kCountsPerRad = 400.0f / 3.14159265f;
constexpr std::int8_t kOffsets[kPlatforms][kServos] = {
    {2, -1, 0, -19, -4, 1},
    {6, -12, 1, 14, -4, 11},
    {16, -11, -12, 9, -5, -16},
    {-8, 7, 8, -2, -2, -17},
};

}  // namespace

StackCalibration published_calibration() {
  StackCalibration calibration{};
  for (std::size_t platform = 0; platform < kPlatforms; ++platform) {
    for (std::size_t servo = 0; servo < kServos; servo += 2) {
      const std::int8_t* offsets = kOffsets[platform] + servo;
      calibration[platform][servo] = {-kCountsPerRad, static_cast<float>(offsets[0])};
      calibration[platform][servo + 1] = {kCountsPerRad, static_cast<float>(offsets[1])};
    }
  }
  return calibration;
}

std::size_t servo_counts(const ServoAngles& angles, const PlatformCalibration& calibration, Counts& counts) {
  for (std::size_t i = 0; i < kServos; ++i) {
    const float exact = kMiddleCounts + calibration[i].offset_counts + calibration[i].gain_counts_per_rad * angles[i];
    // Half a count outside still rounds to the end of the range.
    if (!(exact > kLowestCounts - 0.5f && exact < kHighestCounts + 0.5f)) return i;
    counts[i] = static_cast<std::uint16_t>(exact + 0.5f);
  }
  return kReachable;
}

}  // namespace brov::rig
