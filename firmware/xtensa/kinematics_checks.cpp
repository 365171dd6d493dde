#include "kinematics_checks.h"

#include <cstring>

#include "crc32.h"
#include "line.h"
#include "rig/servos.h"

using namespace brov::rig;

namespace {

constexpr int kStacks = 500;
constexpr float kLimits[kAxes] = {5.0f, 5.0f, 16.0f, 0.26179939f, 0.26179939f, 0.08726646f};

// Instructions of the calls between begin() and end(), counted each.
class Measure {
 public:
  void begin() { started_ = machine::instructions(); }
  void end() {
    const std::uint32_t taken = machine::instructions() - started_;
    sum_ += taken;
    ++count_;
    if (taken > worst_) worst_ = taken;
  }
  void print(const char* name) const {
    Line().text(name).text("_mean ").number(count_ == 0 ? 0 : sum_ / count_).print_measure();
    Line().text(name).text("_worst ").number(worst_).print_measure();
  }

 private:
  std::uint32_t started_ = 0, worst_ = 0, count_ = 0;
  std::uint64_t sum_ = 0;
};

// Evenly over the axis limits; not all of them can be reached.
SetPoint any_set_point(std::uint32_t& seed) {
  SetPoint set_point{};
  for (std::size_t i = 0; i < kAxes; ++i) {
    seed = seed * 1664525u + 1013904223u;
    set_point[i] = kLimits[i] * (static_cast<float>(seed >> 8) * (2.0f / 16777216.0f) - 1.0f);
  }
  return set_point;
}

}  // namespace

void check_kinematics() {
  std::uint32_t seed = 1, reached = 0;
  Crc32 crc;
  Measure six_legs, stack;
  const StackCalibration calibration = published_calibration();
  for (int i = 0; i < kStacks; ++i) {
    SetPoints set_points{};
    bool whole = true;
    for (SetPoint& set_point : set_points) {
      set_point = any_set_point(seed);
      ServoAngles angles{};
      six_legs.begin();
      const std::size_t servo = servo_angles(set_point, angles);
      if (servo != kReachable) {  // it took less: its count is left out
        whole = false;
        continue;
      }
      six_legs.end();
      ++reached;
      std::uint8_t bytes[sizeof angles];
      std::memcpy(bytes, angles.data(), sizeof bytes);
      crc.add({bytes, sizeof bytes});
    }
    if (!whole) continue;
    stack.begin();
    for (std::size_t p = 0; p < kPlatforms; ++p) {
      ServoAngles angles{};
      Counts counts{};
      if (servo_angles(set_points[p], angles) == kReachable) servo_counts(angles, calibration[p], counts);
    }
    stack.end();
  }
  Line line;
  line.text("kinematics ").number(4 * kStacks).text(" reached ").number(reached).text(" crc ").hex(crc.value()).print();
  six_legs.print("ik_six_legs");
  stack.print("ik_stack");
}
