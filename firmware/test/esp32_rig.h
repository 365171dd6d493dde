// The ESP32's application, started on a pretended machine, with what a test wants to know of its USB line.
#pragma once

#include <string>
#include <vector>

#include "arduino_fakes/machine.h"
#include "brov/aa55.h"
#include "hex.h"
#include "rig.h"

// One frame that came out of the USB line.
struct LinkFrame {
  std::uint8_t type;
  Buffer payload;
  std::uint64_t start_us, end_us;
  std::uint32_t baud;
};

class Esp32 {
 public:
  explicit Esp32(fake::Flash& flash, int reset_reason = 1) : machine(flash, reset_reason) {}

  // setup() and then loop() until the machine's clock says so.
  void boot();
  void run_until(std::uint64_t us);
  void run_for(std::uint64_t us) { run_until(machine.now_us() + us); }

  // What came out of the USB line, in order; fails the test if anything there is neither a frame nor text.
  std::vector<LinkFrame> frames();
  std::vector<LinkFrame> frames(brov::MessageType type);
  std::string text();
  // Newest STATUS; there must be one.
  brov::StatusFields status();

  // A whole frame from the host.
  void command(std::uint8_t type, const Buffer& payload, std::uint32_t baud = 115200);

  fake::Machine machine;
  std::uint64_t passes = 0, longest_pass_us = 0;

 private:
  void parse();

  std::size_t parsed_ = 0;
  std::vector<LinkFrame> frames_;
  std::string text_;
};

// `per_s` pings a second from `from_us` on, for so many seconds.
void feed_pings(fake::Uart& sonar, std::size_t samples, unsigned per_s, std::uint64_t from_us, unsigned seconds);

std::string ascii(const std::vector<fake::WireByte>& bytes);
Buffer ascii(const std::string& text);
