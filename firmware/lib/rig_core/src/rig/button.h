// A push button: pressed once it has been down for as long as its contacts may bounce.
#pragma once

#include <cstdint>

namespace brov::rig {

class Button {
 public:
  // The contact now; true once for each press.
  bool pressed(bool down, std::uint64_t now_us) {
    if (down != last_) {
      last_ = down;
      since_us_ = now_us;
    }
    if (now_us - since_us_ < kBounceUs || down == settled_) return false;
    settled_ = down;
    return down;
  }

 private:
  static constexpr std::uint64_t kBounceUs = 30000;

  bool last_ = false, settled_ = false;
  std::uint64_t since_us_ = 0;
};

}  // namespace brov::rig
