// One transaction's outcome and the counters that the I2C sensors share. docs/firmware-core.md section 6.
#pragma once

#include "brov/readings.h"

namespace brov {

// The bus with the error counters that STATUS shows; recovers a stuck bus.
class CountedBus {
 public:
  explicit CountedBus(I2cBus& bus) : bus_(bus) {}
  bool write(std::uint8_t address, Bytes data, std::uint64_t now_us);
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count, std::uint64_t now_us);
  bool command(std::uint8_t address, std::uint8_t code, std::uint64_t now_us);  // one byte
  // A command byte and its answer, as one transaction: at most one error.
  bool read_answer(std::uint8_t address, std::uint8_t code, std::uint8_t* into, std::size_t count, std::uint64_t now_us);
  void count_bad_content() { ++errors_; }  // CRC, implausible reading
  std::uint16_t errors() const { return errors_; }

 private:
  bool note(bool ok, std::uint64_t now_us);

  I2cBus& bus_;
  std::uint16_t errors_ = 0;
  std::uint8_t failed_in_a_row_ = 0;
  Stamp recovered_;
};

}  // namespace brov
