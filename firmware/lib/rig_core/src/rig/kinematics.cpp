#include "rig/kinematics.h"

#include <cmath>

#include "rig/trigonometry.h"

namespace brov::rig {

namespace {

constexpr float kRodMm = 106.0f, kArmMm = 24.0f, kHomeHeightMm = 100.0f;

struct Leg {
  float base_x, base_y;        // the servo's axis, mm
  float plate_x, plate_y;      // the ball joint in the plate, mm
  float forward_x, forward_y;  // where the level arm points
};
// Table 2.3 of the thesis in the rig's frame; tests/rig compares them with the Python reference's.
constexpr Leg kLegs[kServos] = {
    {-63.84089f, -52.57025f, -56.85152f, -10.00400f, 0.86602540f, -0.5f},
    {-13.60673f, -81.57295f, 19.76205f, -54.23686f, -0.86602540f, 0.5f},
    {77.44761f, -29.00271f, 37.08948f, -44.23286f, 0.0f, 1.0f},
    {77.44761f, 29.00271f, 37.08948f, 44.23286f, 0.0f, -1.0f},
    {-13.60673f, 81.57295f, 19.76205f, 54.23686f, -0.86602540f, -0.5f},
    {-63.84089f, 52.57025f, -56.85152f, 10.00400f, 0.86602540f, 0.5f},
};

constexpr float kRadPerDeg = 0.01745329252f;
constexpr float kAxisLimits[kAxes] = {5.0f, 5.0f, 16.0f, 15.0f * kRadPerDeg, 15.0f * kRadPerDeg, 5.0f * kRadPerDeg};
constexpr float kRounding = 1.0f + 1e-6f;  // a limit itself is within it, however it was rounded on the way

}  // namespace

std::size_t servo_angles(const SetPoint& set_point, ServoAngles& angles) {
  const float sr = sine(set_point[3]), cr = cosine(set_point[3]);
  const float sp = sine(set_point[4]), cp = cosine(set_point[4]);
  const float sy = sine(set_point[5]), cy = cosine(set_point[5]);
  // The joints lie in the plate: the rotation's third column is not needed.
  const float xx = cy * cp, xy = cy * sp * sr - sy * cr;
  const float yx = sy * cp, yy = sy * sp * sr + cy * cr;
  const float zx = -sp, zy = cp * sr;
  for (std::size_t i = 0; i < kServos; ++i) {
    const Leg& leg = kLegs[i];
    const float qx = set_point[0] + xx * leg.plate_x + xy * leg.plate_y - leg.base_x;
    const float qy = set_point[1] + yx * leg.plate_x + yy * leg.plate_y - leg.base_y;
    const float c = kHomeHeightMm - set_point[2] - zx * leg.plate_x - zy * leg.plate_y;
    const float a = leg.forward_x * qx + leg.forward_y * qy;
    const float k = kArmMm * kArmMm - kRodMm * kRodMm + qx * qx + qy * qy + c * c;
    const float square = 4.0f * kArmMm * kArmMm * (a * a + c * c) - k * k;
    if (!(square >= 0.0f)) return i;
    const float root = std::sqrt(square);
    angles[i] = arc_tangent(c * k - a * root, a * k + c * root);
  }
  return kReachable;
}

bool within_axis_limits(const SetPoint& set_point) {
  for (std::size_t i = 0; i < kAxes; ++i) {
    if (!(std::fabs(set_point[i]) <= kAxisLimits[i] * kRounding)) return false;
  }
  return true;
}

}  // namespace brov::rig
