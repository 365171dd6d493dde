// The ground-truth rig's firmware: the portable board on this machine's wires. Everything happens in the loop: nothing
// here is faster than a step of 50 ms, and the UART's driver holds what comes meanwhile.
#include <memory>

#include <Arduino.h>
#include <Wire.h>
#include <esp_log.h>
#include <esp_task_wdt.h>

#include "../device_time.h"
#include "../hardware_uart.h"
#include "pins.h"
#include "rig/board.h"

namespace {

using namespace brov;
using namespace brov::rig;

constexpr std::uint32_t kBaud = 115200, kBusHz = 400000, kWatchdogS = 3;
// Twelve servos are 49 bytes: 1.2 ms.
constexpr std::uint16_t kBusTimeoutMs = 10;
constexpr HardwareUart::Buffers kBuffers{2048, 2048};

class RigBus final : public I2cBus {
 public:
  void begin() {
    Wire.begin(rig::pins::kSda, rig::pins::kScl, kBusHz);
    Wire.setTimeOut(kBusTimeoutMs);
  }
  bool write(std::uint8_t address, Bytes data) override {
    Wire.beginTransmission(address);
    Wire.write(data.data, data.size);
    return Wire.endTransmission() == 0;
  }
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override {
    if (Wire.requestFrom(address, count, true) != count) return false;
    for (std::size_t i = 0; i < count; ++i) into[i] = static_cast<std::uint8_t>(Wire.read());
    return true;
  }
  void recover() override {
    Wire.end();
    pinMode(rig::pins::kSda, OUTPUT_OPEN_DRAIN);
    pinMode(rig::pins::kScl, OUTPUT_OPEN_DRAIN);
    digitalWrite(rig::pins::kSda, HIGH);
    for (int i = 0; i < 9; ++i) {
      digitalWrite(rig::pins::kScl, LOW);
      delayMicroseconds(5);
      digitalWrite(rig::pins::kScl, HIGH);
      delayMicroseconds(5);
    }
    begin();
  }
};

class Machine final : private RigHal {
 public:
  Machine() : uart_(UART_NUM_0, rig::pins::kUsbRx, rig::pins::kUsbTx, kBuffers) {
    // The drivers' own messages would land in the middle of a frame.
    esp_log_level_set("*", ESP_LOG_NONE);
    for (const std::int8_t pin : rig::pins::kImuAddress) output(pin, HIGH);
    output(rig::pins::kLamp, LOW);
    pinMode(static_cast<std::uint8_t>(rig::pins::kButton), INPUT);
    bus_.begin();
    uart_.begin(kBaud);
    board_.reset(new RigBoard(*this));
    ESP_ERROR_CHECK(esp_task_wdt_init(kWatchdogS, true));
    ESP_ERROR_CHECK(esp_task_wdt_add(nullptr));
  }
  void pass() {
    std::uint8_t block[256];
    const std::size_t count = uart_.read(block, sizeof block);
    if (count != 0) board_->receive({block, count});
    board_->tick(device_us());
    esp_task_wdt_reset();
    vTaskDelay(1);
  }

 private:
  bool link_write(Bytes frame, std::uint64_t now_us) override {
    // The driver takes what fits its buffer without waiting; a frame that does not fit is not begun.
    const std::uint64_t free_us = free_us_ > now_us ? free_us_ : now_us;
    if ((free_us - now_us) * kBaud / 10000000 + frame.size > static_cast<std::size_t>(kBuffers.transmit)) return false;
    free_us_ = free_us + frame.size * 10000000 / kBaud;
    uart_.write(frame);
    return true;
  }
  I2cBus& i2c() override { return bus_; }
  void select_imu(std::uint8_t imu) override {
    for (std::uint8_t i = 0; i < sizeof rig::pins::kImuAddress; ++i) {
      digitalWrite(static_cast<std::uint8_t>(rig::pins::kImuAddress[i]), i == imu ? LOW : HIGH);
    }
  }
  bool button_down() override { return digitalRead(static_cast<std::uint8_t>(rig::pins::kButton)) == HIGH; }
  void set_lamp(bool lit) override { digitalWrite(static_cast<std::uint8_t>(rig::pins::kLamp), lit ? HIGH : LOW); }
  static void output(std::int8_t pin, std::uint8_t level) {
    digitalWrite(static_cast<std::uint8_t>(pin), level);
    pinMode(static_cast<std::uint8_t>(pin), OUTPUT);
  }

  HardwareUart uart_;
  RigBus bus_;
  std::uint64_t free_us_ = 0;
  std::unique_ptr<RigBoard> board_;
};

std::unique_ptr<Machine> machine;

}  // namespace

void setup() { machine = std::make_unique<Machine>(); }

void loop() { machine->pass(); }
