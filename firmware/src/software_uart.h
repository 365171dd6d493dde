// A 9600-baud sensor on two ordinary pins. Received by interrupts on every edge; sent by counting time, one byte per
// call.
#pragma once

#include <cstdint>

#include <SoftwareSerial.h>

#include "brov/byte_ring.h"

namespace brov {

class SoftwareUart {
 public:
  SoftwareUart(std::int8_t rx_pin, std::int8_t tx_pin) : rx_pin_(rx_pin), tx_pin_(tx_pin) {}

  // On the core of the inputs and outputs.
  void begin();
  std::size_t read(std::uint8_t* into, std::size_t most);
  // The next byte that waits to be sent, if there is one: keeps this core busy for ten bit times (1.04 ms).
  bool send_one();

  // On the core of the loop.
  void write(Bytes data) { waiting_.write(data); }

 private:
  SoftwareSerial serial_;
  std::int8_t rx_pin_, tx_pin_;
  ByteRing<64> waiting_;  // the longest command has eight bytes, and there are 100 ms between two
};

}  // namespace brov
