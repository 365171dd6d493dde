// Where everything is connected. The same table, with wires and supplies, is in docs/firmware.md; a test compares them.
#pragma once

#include <cstdint>

namespace brov::pins {

// RX is the ESP32's input: it goes to the device's TX.
constexpr std::int8_t kUsbRx = 3, kUsbTx = 1;  // the DevKit's USB bridge
constexpr std::int8_t kSonarARx = 16, kSonarATx = 17;
constexpr std::int8_t kSonarBRx = 25, kSonarBTx = 26;
constexpr std::int8_t kGpsRx = 27, kGpsTx = 14;
constexpr std::int8_t kEcRx = 19, kEcTx = 18;
constexpr std::int8_t kImuRx = 13, kImuTx = 15;
constexpr std::int8_t kSda = 21, kScl = 22;
constexpr std::int8_t kLed = 2;  // many DevKit boards have a blue LED here, Espressif's own has none

constexpr std::int8_t kAll[] = {kUsbRx, kUsbTx, kSonarARx, kSonarATx, kSonarBRx, kSonarBTx, kGpsRx, kGpsTx,
                                kEcRx,  kEcTx,  kImuRx,    kImuTx,    kSda,      kScl,      kLed};

constexpr bool are_usable() {
  std::uint64_t seen = 0;
  for (const std::int8_t pin : kAll) {
    // 6 to 11 hold the flash; 34 and above cannot drive anything and none of ours is a mere input.
    if (pin < 0 || (pin >= 6 && pin <= 11) || pin >= 34 || (seen >> pin & 1) != 0) return false;
    seen |= std::uint64_t{1} << pin;
  }
  return true;
}
static_assert(are_usable(), "every function has a pin of its own");

}  // namespace brov::pins
