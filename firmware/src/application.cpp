#include "application.h"

#include <esp_log.h>
#include <esp_task_wdt.h>

#include "boot.h"
#include "device_time.h"
#include "settings_store.h"

namespace brov {

namespace {

// Of the loop, the mover and the writer. Far above the tens of milliseconds that erasing flash takes.
constexpr std::uint32_t kWatchdogS = 3;

BootInfo boot_now() {
  BootInfo boot;
  boot.boot_count = count_boot();
  boot.reset_reason = reset_reason();
  boot.boot_us = device_us();
  return boot;
}

}  // namespace

Application::Application()
    : boot_(boot_now()),
      board_(new Board(*this, load_settings(kBootBaud), boot_)),
      led_(*board_, boot_.reset_reason, boot_.boot_us) {
  // The drivers' own messages would land in the middle of a frame.
  esp_log_level_set("*", ESP_LOG_NONE);
  bus_.begin();
  char text[kMaxBootText];
  const std::size_t size = write_boot_text(boot_.boot_count, boot_.reset_reason, kBootBaud, text);
  ports_.link().write(Bytes(reinterpret_cast<const std::uint8_t*>(text), size));
  ESP_ERROR_CHECK(esp_task_wdt_init(kWatchdogS, true));
  ESP_ERROR_CHECK(esp_task_wdt_add(nullptr));
  ports_.start(*board_);
}

void Application::pass() {
  const std::uint64_t next_us = jobs_.run_due(device_us());
  esp_task_wdt_reset();
  const std::uint64_t now_us = device_us();
  // Less than a whole tick of the system still ends in time: a delay of one ends with the tick that is under way.
  if (next_us > now_us) vTaskDelay(static_cast<TickType_t>((next_us - now_us + 999) / 1000));
}

std::uint64_t Application::run(std::uint64_t now_us) {
  board_->tick(now_us);
  return board_->next_wanted_us(now_us);
}

void Application::link_write(Bytes frame, std::uint64_t) { ports_.link().write(frame); }

std::uint32_t Application::link_backlog(std::uint64_t) { return ports_.link().backlog(); }

void Application::link_set_baud(std::uint32_t baud, std::uint64_t) { ports_.link().set_baud(baud); }

void Application::port_write(Port port, Bytes data, std::uint64_t) { ports_.write(port, data); }

void Application::save_settings(const Settings& settings) { store_settings(settings); }

}  // namespace brov
