// EspSoftwareSerial 8.1.0, as far as src/ uses it: write() keeps the caller busy until the stop bit is out.
#pragma once

#include <cstddef>
#include <cstdint>

namespace EspSoftwareSerial {

enum Config { SWSERIAL_8N1 = 3 };

class UART {
 public:
  UART() = default;
  UART(const UART&) = delete;
  UART& operator=(const UART&) = delete;
  void begin(std::uint32_t baud, Config config, std::int8_t rxPin, std::int8_t txPin, bool invert, int bufCapacity = 64,
             int isrBufCapacity = 0);
  int read(std::uint8_t* buffer, std::size_t size);
  std::size_t write(std::uint8_t byte);

 private:
  int rx_pin_ = -1;
};

}  // namespace EspSoftwareSerial

using SoftwareSerial = EspSoftwareSerial::UART;
using EspSoftwareSerial::SWSERIAL_8N1;
