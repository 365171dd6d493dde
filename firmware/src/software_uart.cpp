#include "software_uart.h"

#include "brov/hal.h"

namespace brov {

namespace {

// 64 ms of bytes, should the reading task be held up.
constexpr int kReceiveBufferBytes = 64;

}  // namespace

void SoftwareUart::begin() {
  serial_.begin(kSensorBaud, SWSERIAL_8N1, rx_pin_, tx_pin_, false, kReceiveBufferBytes);
}

std::size_t SoftwareUart::read(std::uint8_t* into, std::size_t most) {
  std::size_t size = 0;
  // The library gives what it has decoded before it decodes more.
  while (size < most) {
    const int count = serial_.read(into + size, most - size);
    if (count <= 0) break;
    size += static_cast<std::size_t>(count);
  }
  return size;
}

bool SoftwareUart::send_one() {
  if (waiting_.size() == 0) return false;
  serial_.write(waiting_.front(1)[0]);
  waiting_.consume(1);
  return true;
}

}  // namespace brov
