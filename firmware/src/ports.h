// Everything that comes in or goes out byte by byte, on core 0, so that the loop on core 1 never waits for a wire.
//
// Core 0 has the interrupts of all UARTs and of the software serial ports, the task that moves what they received into
// the board's rings, and the task that feeds the USB line. A byte sent by software keeps its core busy for a
// millisecond; here that only delays bytes that the drivers' buffers hold meanwhile. Core 1 has the loop: decoding,
// pings, reports, I2C. Wi-Fi and Bluetooth, which would live on core 0, are never started.
#pragma once

#include "brov/board.h"
#include "hardware_uart.h"
#include "software_uart.h"
#include "usb_link.h"

namespace brov {

class Ports {
 public:
  explicit Ports(std::uint32_t link_baud);
  // Starts both tasks. The board must live as long as this.
  void start(Board& board);

  UsbLink& link() { return link_; }
  // For the loop: never waits.
  void write(Port port, Bytes data);

 private:
  static void run_mover(void* self);
  static void run_writer(void* self);
  void begin_all();
  void move();

  UsbLink link_;
  HardwareUart sonar_a_, sonar_b_;
  SoftwareUart imu_, gps_, ec_;
  Board* board_ = nullptr;
  TaskHandle_t writer_ = nullptr;
  std::uint8_t block_[1024] = {};  // on its way from a driver to the board
};

}  // namespace brov
