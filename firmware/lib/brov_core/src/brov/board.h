// The board: inputs, jobs and transmitter, tick by tick. docs/firmware-core.md.
#pragma once

#include <array>

#include "brov/aa55.h"
#include "brov/bundle.h"
#include "brov/hal.h"
#include "brov/kogger_framer.h"
#include "brov/sensors.h"
#include "brov/send_queue.h"
#include "brov/settings.h"

namespace brov {

constexpr std::uint8_t kFirmwareVersion[3] = {0, 2, 0};

struct BootInfo {
  std::uint64_t boot_us = 0;  // device time now
  std::uint16_t boot_count = 0;
  std::uint8_t reset_reason = 1;  // the ESP-IDF's numbers
};

class Board final : private ReportSink {
 public:
  Board(Hal& hal, const Settings& settings, const BootInfo& boot);

  // Room for bytes of this input (sonar rings 16 384); what does not fit is dropped and counted.
  // May be called from another context than tick() for one port at a time: the rings are single-producer single-consumer.
  void receive(Port port, Bytes data);
  void tick(std::uint64_t now_us);
  // No later than this the next tick has something to do (for a loop that may sleep). Inputs may wake it earlier.
  std::uint64_t next_wanted_us(std::uint64_t now_us) const;

  std::uint32_t baud() const { return baud_; }
  // ... private parts are the implementation's
};

}  // namespace brov
