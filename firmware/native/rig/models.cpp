#include "models.h"

namespace brov::rig {

namespace {

constexpr std::uint8_t kMode1 = 0x00, kMode2 = 0x01, kLed0 = 0x06, kLedEnd = 0x46, kPreScale = 0xFE;
constexpr std::uint8_t kSleep = 0x10, kFullOff = 0x10;
constexpr std::uint8_t kPower = 0x6B, kWhoAmI = 0x75, kData = 0x3B, kAsleep = 0x40;
constexpr std::uint8_t kFirstBoard = 0x40, kImu = 0x68;

}  // namespace

void RegisterDevice::write(Bytes data) {
  if (data.size == 0) return;
  pointer_ = data[0];
  for (std::size_t i = 1; i < data.size; ++i) {
    if (writable(pointer_)) registers_[pointer_] = data[i];
    if (increments()) ++pointer_;
  }
}

void RegisterDevice::read(std::uint8_t* into, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    into[i] = value(pointer_);
    if (increments()) ++pointer_;
  }
}

void Pca9685Model::power_on() {
  registers_ = {};
  registers_[kMode1] = 0x11;
  registers_[kMode2] = 0x04;
  for (std::size_t off_high = kLed0 + 3; off_high < kLedEnd; off_high += 4) registers_[off_high] = kFullOff;
  registers_[kPreScale] = 0x1E;
}

std::uint16_t Pca9685Model::pulse_counts(std::size_t channel) const {
  const std::uint8_t* led = registers_.data() + kLed0 + 4 * channel;
  if ((registers_[kMode1] & kSleep) != 0 || (led[3] & kFullOff) != 0) return 0;
  return static_cast<std::uint16_t>((get_u16(led + 2) - get_u16(led)) & 0x0FFF);
}

double Pca9685Model::frequency_hz() const { return 25e6 / (4096.0 * (registers_[kPreScale] + 1)); }

bool Pca9685Model::writable(std::uint8_t number) const {
  if (number == kPreScale) return (registers_[kMode1] & kSleep) != 0;
  return number < kLedEnd;
}

Mpu6050Model::Mpu6050Model(std::uint8_t identity) {
  registers_[kPower] = kAsleep;
  registers_[kWhoAmI] = identity;
}

std::uint8_t Mpu6050Model::value(std::uint8_t number) const {
  if (number < kData || number >= kData + 2 * raw_.size()) return registers_[number];
  if ((registers_[kPower] & kAsleep) != 0) return 0;
  const std::size_t at = number - kData;
  const auto word = static_cast<std::uint16_t>(raw_[at / 2]);
  return static_cast<std::uint8_t>(at % 2 == 0 ? word >> 8 : word);
}

bool RigModels::write(std::uint8_t address, Bytes data) {
  RegisterDevice* device = acknowledging(address);
  if (device == nullptr) return false;
  ++writes;
  device->write(data);
  return true;
}

bool RigModels::read(std::uint8_t address, std::uint8_t* into, std::size_t count) {
  RegisterDevice* device = acknowledging(address);
  if (device != nullptr) device->read(into, count);
  return device != nullptr;
}

RegisterDevice* RigModels::acknowledging(std::uint8_t address) {
  for (std::size_t i = 0; i < kBoards; ++i) {
    if (address == kFirstBoard + i) return board_answers[i] ? &boards[i] : nullptr;
  }
  if (address == kImu && selected_imu < kImus && imu_answers[selected_imu]) return &imus[selected_imu];
  return nullptr;
}

}  // namespace brov::rig
