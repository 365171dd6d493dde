#include "i2c_models.h"

namespace brov {

namespace {

constexpr std::uint8_t kReset = 0x1E, kReadResult = 0x00, kReadProm = 0xA0;

}  // namespace

void ConvertingSensor::write(Bytes data, std::uint64_t now_us) {
  selected_bytes_ = 0;
  if (data.size != 1) return;
  const std::uint8_t command = data[0];
  if (command == kReset) {
    running_ = nullptr;
  } else if (command == kReadResult) {
    // Asked too early, the device answers 0 and the conversion is spoilt.
    const bool done = running_ != nullptr && now_us - started_us_ >= running_->duration_us;
    select(done ? running_->value : 0, 3);
    running_ = nullptr;
  } else if (command >= kReadProm && command < kReadProm + 16 && command % 2 == 0) {
    const std::size_t word = (command - kReadProm) / 2u;
    select(word < prom_words_ ? prom_[word] : 0, 2);
  } else {
    for (const Conversion& conversion : conversions_) {
      if (conversion.command != command) continue;
      running_ = &conversion;
      started_us_ = now_us;
      break;
    }
  }
}

void ConvertingSensor::read(std::uint8_t* into, std::size_t count) const {
  for (std::size_t i = 0; i < count; ++i) into[i] = i < selected_bytes_ ? selected_[i] : 0;
}

void ConvertingSensor::select(std::uint32_t value, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) selected_[i] = static_cast<std::uint8_t>(value >> 8 * (bytes - 1 - i));
  selected_bytes_ = bytes;
}

void I2cModels::time_restarts() {
  ms5837_.forget_conversion();
  tsys01_.forget_conversion();
}

bool I2cModels::write(std::uint8_t address, Bytes data) {
  ConvertingSensor* device = acknowledging(address);
  if (device != nullptr) device->write(data, now_us_);
  return device != nullptr;
}

bool I2cModels::read(std::uint8_t address, std::uint8_t* into, std::size_t count) {
  ConvertingSensor* device = acknowledging(address);
  if (device != nullptr) device->read(into, count);
  return device != nullptr;
}

ConvertingSensor* I2cModels::acknowledging(std::uint8_t address) {
  const bool all_silent = state_ == BusState::kBothSilent || state_ == BusState::kHeldLow;
  if (address == kMs5837Address && !all_silent && state_ != BusState::kMs5837Silent) return &ms5837_;
  if (address == kTsys01Address && !all_silent && state_ != BusState::kTsys01Silent) return &tsys01_;
  return nullptr;
}

}  // namespace brov
