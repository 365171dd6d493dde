// From one set of set points to another, linearly, one step every 50 ms.
#pragma once

#include <cstdint>

#include "rig/kinematics.h"

namespace brov::rig {

constexpr std::uint64_t kStepUs = 50000;

class Motion {
 public:
  // The first step is due 50 ms from now, the last one is `to` itself.
  void begin(const SetPoints& from, const SetPoints& to, std::uint16_t steps, std::uint64_t now_us) {
    from_ = from, to_ = to;
    steps_ = steps, done_ = 0;
    due_us_ = now_us + kStepUs;
    under_way_ = true;
  }
  void end() { under_way_ = false; }
  bool under_way() const { return under_way_; }
  std::uint16_t steps() const { return steps_; }
  std::uint16_t done() const { return done_; }
  std::uint64_t due_us() const { return due_us_; }

  // The next step, where one is due. A board that was held up goes on from there: no jump to catch up.
  bool step(std::uint64_t now_us, SetPoints& next) {
    if (!under_way_ || now_us < due_us_) return false;
    due_us_ = due_us_ + kStepUs > now_us ? due_us_ + kStepUs : now_us + kStepUs;
    under_way_ = ++done_ < steps_;
    const float share = static_cast<float>(done_) / static_cast<float>(steps_);
    for (std::size_t p = 0; p < kPlatforms; ++p) {
      for (std::size_t i = 0; i < kAxes; ++i) {
        next[p][i] = done_ == steps_ ? to_[p][i] : from_[p][i] + share * (to_[p][i] - from_[p][i]);
      }
    }
    return true;
  }

 private:
  SetPoints from_{}, to_{};
  std::uint16_t steps_ = 0, done_ = 0;
  std::uint64_t due_us_ = 0;
  bool under_way_ = false;
};

}  // namespace brov::rig
