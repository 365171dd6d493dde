#include "boot.h"

#include <cstdio>

#include <Preferences.h>
#include <esp_system.h>

#include "brov/board.h"

namespace brov {

std::uint8_t reset_reason() {
  switch (esp_reset_reason()) {
    case ESP_RST_POWERON: return 1;  // the EN button and the USB bridge's reset line too
    case ESP_RST_EXT: return 2;
    case ESP_RST_SW: return 3;
    case ESP_RST_PANIC: return 4;
    case ESP_RST_INT_WDT: return 5;
    case ESP_RST_TASK_WDT: return 6;
    case ESP_RST_WDT: return 7;
    case ESP_RST_DEEPSLEEP: return 8;
    case ESP_RST_BROWNOUT: return 9;
    case ESP_RST_SDIO: return 10;
    default: return 0;
  }
}

const char* reset_reason_text(std::uint8_t reason) {
  static constexpr const char* kTexts[] = {
      "unknown",       "power on", "reset pin",  "software",  "crash", "interrupt watchdog",
      "task watchdog", "watchdog", "deep sleep", "brown-out", "SDIO"};
  return reason < sizeof kTexts / sizeof kTexts[0] ? kTexts[reason] : kTexts[0];
}

bool is_fault(std::uint8_t reason) { return (reason >= 4 && reason <= 7) || reason == 9; }

std::uint16_t count_boot() {
  Preferences flash;
  if (!flash.begin("brov-boot", false)) return 0;
  const auto count = static_cast<std::uint16_t>(flash.getUShort("count", 0) + 1);
  const bool kept = flash.putUShort("count", count) == sizeof count;
  flash.end();
  return kept ? count : std::uint16_t{0};
}

std::size_t write_boot_text(std::uint16_t boot_count, std::uint8_t reason, std::uint32_t baud,
                            char (&into)[kMaxBootText]) {
  const int size = std::snprintf(into, sizeof into, "\r\nBlueROV SLAM firmware %u.%u.%u: start %u (%s), %lu baud\r\n",
                                 static_cast<unsigned>(kFirmwareVersion[0]), static_cast<unsigned>(kFirmwareVersion[1]),
                                 static_cast<unsigned>(kFirmwareVersion[2]), static_cast<unsigned>(boot_count),
                                 reset_reason_text(reason), static_cast<unsigned long>(baud));
  return size > 0 ? static_cast<std::size_t>(size) : 0;
}

}  // namespace brov
