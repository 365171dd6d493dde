// The USB serial line to the vehicle's computer. One core hands frames over and asks how much is still on its way;
// a task on the other core feeds them to the hardware.
#pragma once

#include <atomic>

#include <freertos/FreeRTOS.h>
#include <freertos/task.h>

#include "brov/byte_ring.h"
#include "hardware_uart.h"

namespace brov {

class UsbLink {
 public:
  explicit UsbLink(std::uint32_t baud);

  // On the core of the inputs and outputs.
  void begin() { uart_.begin(baud_); }
  [[noreturn]] void run_writer();
  void set_writer(TaskHandle_t writer) { writer_.store(writer); }
  std::size_t read(std::uint8_t* into, std::size_t most) { return uart_.read(into, most); }

  // On the core of the loop.
  void write(Bytes data);
  // Bytes that have not left the board yet: those that wait here, in the hardware's FIFO and in its shift register.
  // Never too small; too large by at most one piece while that moves into the FIFO.
  std::uint32_t backlog() const;
  // Behind the last byte that was handed over.
  void set_baud(std::uint32_t baud);

 private:
  static constexpr std::size_t kPieceBytes = 64;

  HardwareUart uart_;
  std::uint32_t baud_;
  std::atomic<TaskHandle_t> writer_{nullptr};
  ByteRing<1024> waiting_;  // the boot message, and no more than the transmitter's window of 552 bytes
};

}  // namespace brov
