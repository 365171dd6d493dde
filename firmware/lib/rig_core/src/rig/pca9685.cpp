#include "rig/pca9685.h"

namespace brov::rig {

namespace {

constexpr std::uint8_t kMode1 = 0x00, kMode2 = 0x01, kLed0 = 0x06, kPreScale = 0xFE;
constexpr std::uint8_t kSleep = 0x10, kAutoIncrement = 0x20, kTotemPole = 0x04;
constexpr std::uint8_t kModeBits = 0x7F;  // RESTART reads back by itself
// round(25 MHz / (4096 x 50 Hz)) - 1, which makes 50.03 Hz.
constexpr std::uint8_t kPreScale50Hz = 121;
static_assert(kPreScale50Hz == (25000000 + 4096 * 50 / 2) / (4096 * 50) - 1, "section 7.3.5");

}  // namespace

bool Pca9685::begin(CountedBus& bus, std::uint64_t now_us) {
  if (check(bus, now_us) == State::kRuns) return true;
  // The prescaler can only be written while the oscillator sleeps.
  const std::uint8_t steps[][2] = {
      {kMode1, kSleep | kAutoIncrement}, {kPreScale, kPreScale50Hz}, {kMode2, kTotemPole}, {kMode1, kAutoIncrement}};
  for (const auto& step : steps) {
    if (!bus.write(address_, {step, sizeof step}, now_us)) return false;
  }
  return true;
}

Pca9685::State Pca9685::check(CountedBus& bus, std::uint64_t now_us) const {
  std::uint8_t mode = 0, pre_scale = 0;
  if (!bus.read_answer(address_, kMode1, &mode, 1, now_us)) return State::kSilent;
  if (!bus.read_answer(address_, kPreScale, &pre_scale, 1, now_us)) return State::kSilent;
  return (mode & kModeBits) == kAutoIncrement && pre_scale == kPreScale50Hz ? State::kRuns : State::kStartedAnew;
}

bool Pca9685::write(const std::uint16_t (&counts)[kBoardServos], CountedBus& bus, std::uint64_t now_us) const {
  std::uint8_t message[1 + 4 * kBoardServos] = {kLed0};
  for (std::size_t i = 0; i < kBoardServos; ++i) put_u16(message + 1 + 4 * i + 2, counts[i]);
  return bus.write(address_, {message, sizeof message}, now_us);
}

}  // namespace brov::rig
