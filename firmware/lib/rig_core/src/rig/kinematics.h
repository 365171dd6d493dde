// Servo angles of one platform's set point. docs/rig.md has frames and signs; the Python reference is rig/platform.py.
#pragma once

#include <array>
#include <cstddef>

namespace brov::rig {

constexpr std::size_t kPlatforms = 4, kServos = 6, kAxes = 6;

// x, y, z in mm from home, then roll, pitch, yaw in rad.
using SetPoint = std::array<float, kAxes>;
using SetPoints = std::array<SetPoint, kPlatforms>;
using ServoAngles = std::array<float, kServos>;  // rad from the horizontal, up is positive

constexpr std::size_t kReachable = kServos;

// Fills `angles` (branch "down") and returns kReachable, or returns the first servo that has no angle.
std::size_t servo_angles(const SetPoint& set_point, ServoAngles& angles);

// What one platform may do along each axis from home, as published: 5 mm, 5 mm, 16 mm, 15 deg, 15 deg, 5 deg.
bool within_axis_limits(const SetPoint& set_point);

}  // namespace brov::rig
