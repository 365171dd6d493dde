// NXP's 16-channel PWM controller as a driver of twelve servos at 50 Hz. Datasheet PCA9685 rev. 4, section 7.3.
#pragma once

#include "brov/i2c_device.h"

namespace brov::rig {

constexpr std::size_t kBoardServos = 12;
constexpr std::uint8_t kFirstServoBoard = 0x40;  // the next has its A0 bridged

class Pca9685 {
 public:
  explicit Pca9685(std::uint8_t address) : address_(address) {}

  // Sets it up for servos unless it is: a board that runs keeps its pulses when only the ESP32 has started anew.
  // Its oscillator needs 0.5 ms afterwards. False: not acknowledged.
  bool begin(CountedBus& bus, std::uint64_t now_us);
  enum class State : std::uint8_t { kRuns, kStartedAnew, kSilent };
  // Whether it still is what begin() made of it.
  State check(CountedBus& bus, std::uint64_t now_us) const;
  // The ends of the pulses of channels 0 to 11, in counts of 4096; all begin at 0. One transaction: the outputs change
  // together, at its stop.
  bool write(const std::uint16_t (&counts)[kBoardServos], CountedBus& bus, std::uint64_t now_us) const;

 private:
  std::uint8_t address_;
};

}  // namespace brov::rig
