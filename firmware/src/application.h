// The firmware of the ESP32: the portable board on this machine's wires.
#pragma once

#include <memory>

#include "brov/board.h"
#include "job.h"
#include "ports.h"
#include "status_led.h"
#include "wire_bus.h"

namespace brov {

#ifndef BROV_LINK_BAUD
#define BROV_LINK_BAUD 115200
#endif
constexpr std::uint32_t kBootBaud = BROV_LINK_BAUD;
static_assert(config_allowed(static_cast<std::uint8_t>(ConfigKey::kBaud), kBootBaud), "115200 or 921600");

class Application final : private Hal, private Job {
 public:
  Application();
  // One pass of the loop: what is due, then sleep until something is.
  void pass();

 private:
  void link_write(Bytes frame, std::uint64_t now_us) override;
  std::uint32_t link_backlog(std::uint64_t now_us) override;
  void link_set_baud(std::uint32_t baud, std::uint64_t now_us) override;
  void port_write(Port port, Bytes data, std::uint64_t now_us) override;
  I2cBus& i2c() override { return bus_; }
  void save_settings(const Settings& settings) override;
  std::uint64_t run(std::uint64_t now_us) override;  // the board's tick

  Ports ports_{kBootBaud};
  WireBus bus_;
  BootInfo boot_;
  // On the heap, where two regions have room for it; static memory ends at 122 KB. Nothing is allocated after setup().
  std::unique_ptr<Board> board_;
  StatusLed led_;
  JobList<2> jobs_{{this, &led_}};
};

}  // namespace brov
