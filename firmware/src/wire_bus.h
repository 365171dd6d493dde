// The I2C bus of the depth and temperature sensors, through the framework's Wire.
#pragma once

#include "brov/hal.h"

namespace brov {

class WireBus final : public I2cBus {
 public:
  void begin();

  bool write(std::uint8_t address, Bytes data) override;
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override;
  void recover() override;
};

}  // namespace brov
