// Servo angles to the counts of the PWM timer: counts = 300 + offset + gain * angle, to the nearest.
#pragma once

#include <cstdint>

#include "rig/kinematics.h"

namespace brov::rig {

constexpr std::uint16_t kLowestCounts = 100, kHighestCounts = 500;  // of 4096 in 20 ms: 0.49 to 2.44 ms
constexpr float kMiddleCounts = 300.0f;

struct ServoCalibration {
  float gain_counts_per_rad;  // negative for a servo that is built in mirrored
  float offset_counts;
};
using PlatformCalibration = std::array<ServoCalibration, kServos>;
using StackCalibration = std::array<PlatformCalibration, kPlatforms>;

// Half a turn is 400 counts; offsets as published, base first.
StackCalibration published_calibration();

using Counts = std::array<std::uint16_t, kServos>;

// Fills `counts` and returns kReachable, or returns the first servo that would have to leave its range.
std::size_t servo_counts(const ServoAngles& angles, const PlatformCalibration& calibration, Counts& counts);

}  // namespace brov::rig
