// Where the rig's parts are connected. RX is the ESP32's input. The same table is in docs/rig-firmware.md.
#pragma once

#include <cstdint>

namespace brov::rig::pins {

constexpr std::int8_t kUsbRx = 3, kUsbTx = 1;
constexpr std::int8_t kSda = 21, kScl = 22;
// AD0 of each IMU, base first: low for the one that is spoken to.
constexpr std::int8_t kImuAddress[5] = {13, 14, 25, 26, 27};
constexpr std::int8_t kButton = 4;  // to 3.3 V, with a resistor of 10 kOhm to ground
constexpr std::int8_t kLamp = 2;

}  // namespace brov::rig::pins
