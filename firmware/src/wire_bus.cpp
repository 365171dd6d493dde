#include "wire_bus.h"

#include <Arduino.h>
#include <Wire.h>

#include "pins.h"

namespace brov {

namespace {

constexpr std::uint32_t kClockHz = 100000;
// The longest transaction (four bytes) takes 0.5 ms.
constexpr std::uint16_t kTimeoutMs = 5;
constexpr int kRecoveryClocks = 9;  // a byte and its acknowledgement, whatever a device was in the middle of
constexpr std::uint32_t kHalfClockUs = 5;

// Between two transactions both lines are high; a line that is held low need not be waited for.
bool is_free() { return digitalRead(pins::kSda) == HIGH && digitalRead(pins::kScl) == HIGH; }

}  // namespace

void WireBus::begin() {
  Wire.begin(pins::kSda, pins::kScl, kClockHz);
  Wire.setTimeOut(kTimeoutMs);
}

bool WireBus::write(std::uint8_t address, Bytes data) {
  if (!is_free()) return false;
  Wire.beginTransmission(address);
  Wire.write(data.data, data.size);
  return Wire.endTransmission() == 0;
}

bool WireBus::read(std::uint8_t address, std::uint8_t* into, std::size_t count) {
  if (!is_free()) return false;
  const bool stop = true;
  if (Wire.requestFrom(address, count, stop) != count) return false;
  for (std::size_t i = 0; i < count; ++i) into[i] = static_cast<std::uint8_t>(Wire.read());
  return true;
}

void WireBus::recover() {
  Wire.end();
  digitalWrite(pins::kSda, HIGH);
  digitalWrite(pins::kScl, HIGH);
  pinMode(pins::kSda, OUTPUT_OPEN_DRAIN);
  pinMode(pins::kScl, OUTPUT_OPEN_DRAIN);
  for (int i = 0; i < kRecoveryClocks; ++i) {
    digitalWrite(pins::kScl, LOW);
    delayMicroseconds(kHalfClockUs);
    digitalWrite(pins::kScl, HIGH);
    delayMicroseconds(kHalfClockUs);
  }
  // A stop: SDA rises while SCL is high.
  digitalWrite(pins::kScl, LOW);
  digitalWrite(pins::kSda, LOW);
  delayMicroseconds(kHalfClockUs);
  digitalWrite(pins::kScl, HIGH);
  delayMicroseconds(kHalfClockUs);
  digitalWrite(pins::kSda, HIGH);
  delayMicroseconds(kHalfClockUs);
  begin();
}

}  // namespace brov
