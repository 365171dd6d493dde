// A hardware UART through the ESP-IDF's driver: 8N1, interrupts on the core that begins it.
#pragma once

#include <cstdint>

#include <driver/uart.h>

#include "brov/bytes.h"

namespace brov {

class HardwareUart {
 public:
  struct Buffers {
    int receive;
    int transmit;  // 0: write() returns when the last byte is in the hardware's FIFO
  };

  HardwareUart(uart_port_t number, std::int8_t rx_pin, std::int8_t tx_pin, Buffers buffers)
      : number_(number), rx_pin_(rx_pin), tx_pin_(tx_pin), buffers_(buffers) {}

  void begin(std::uint32_t baud);
  // What has come, at most `most` bytes; never waits.
  std::size_t read(std::uint8_t* into, std::size_t most);
  void write(Bytes data) { uart_write_bytes(number_, data.data, data.size); }
  void set_baud(std::uint32_t baud) { ESP_ERROR_CHECK(uart_set_baudrate(number_, baud)); }
  uart_port_t number() const { return number_; }

 private:
  uart_port_t number_;
  std::int8_t rx_pin_, tx_pin_;
  Buffers buffers_;
};

}  // namespace brov
