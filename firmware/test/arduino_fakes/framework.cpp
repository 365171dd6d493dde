// The framework's functions, on the current machine.
#include "Arduino.h"
#include "Preferences.h"
#include "SoftwareSerial.h"
#include "Wire.h"
#include "driver/uart.h"
#include "esp_log.h"
#include "esp_system.h"
#include "esp_task_wdt.h"
#include "esp_timer.h"
#include "machine.h"
#include "soc/soc.h"
#include "soc/uart_reg.h"

namespace {

fake::Machine& machine() { return fake::Machine::current(); }
fake::Uart& uart(int number) { return machine().uart(number); }

std::uint64_t after_ticks(TickType_t ticks) { return (machine().now_us() / 1000 + ticks) * 1000; }

}  // namespace

void pinMode(std::uint8_t pin, std::uint8_t mode) { machine().pin_mode(pin, mode); }
void digitalWrite(std::uint8_t pin, std::uint8_t value) { machine().write_pin(pin, value != LOW); }
int digitalRead(std::uint8_t pin) { return machine().read_pin(pin) ? HIGH : LOW; }
void delayMicroseconds(std::uint32_t us) { machine().spend(us); }

std::int64_t esp_timer_get_time() { return static_cast<std::int64_t>(machine().now_us()); }
void esp_log_level_set(const char*, esp_log_level_t) {}
esp_reset_reason_t esp_reset_reason() { return static_cast<esp_reset_reason_t>(machine().reset_reason()); }

esp_err_t esp_task_wdt_init(std::uint32_t timeout, bool) {
  machine().watch(timeout);
  return ESP_OK;
}
esp_err_t esp_task_wdt_add(TaskHandle_t handle) {
  fake::Task& task = handle != nullptr ? *static_cast<fake::Task*>(handle) : machine().running();
  task.watched = true;
  task.fed_us = machine().now_us();
  return ESP_OK;
}
esp_err_t esp_task_wdt_reset() {
  if (!machine().running().watched) return ESP_FAIL;
  machine().feed();
  return ESP_OK;
}

BaseType_t xTaskCreatePinnedToCore(TaskFunction_t code, const char* name, std::uint32_t, void* argument,
                                   UBaseType_t priority, TaskHandle_t* created, BaseType_t core) {
  fake::Task* task = machine().create_task(name, static_cast<int>(priority), core, [=] { code(argument); });
  if (created != nullptr) *created = task;
  return pdPASS;
}
void vTaskDelay(TickType_t ticks) { machine().sleep_until(after_ticks(ticks)); }
BaseType_t xTaskNotifyGive(TaskHandle_t task) {
  machine().notify(*static_cast<fake::Task*>(task));
  return pdPASS;
}
std::uint32_t ulTaskNotifyTake(BaseType_t, TickType_t ticks) { return machine().take_notice(after_ticks(ticks)); }

esp_err_t uart_driver_install(uart_port_t number, int rx_buffer_size, int tx_buffer_size, int, QueueHandle_t*, int) {
  const bool sizes_ok = rx_buffer_size > 128 && (tx_buffer_size == 0 || tx_buffer_size > 128);
  if (uart(number).installed() || !sizes_ok) return ESP_FAIL;
  uart(number).install(static_cast<std::size_t>(rx_buffer_size), static_cast<std::size_t>(tx_buffer_size));
  uart(number).installed_on_core = machine().running().core;
  return ESP_OK;
}
esp_err_t uart_param_config(uart_port_t number, const uart_config_t* config) {
  uart(number).set_baud(static_cast<std::uint32_t>(config->baud_rate), machine().now_us());
  return ESP_OK;
}
esp_err_t uart_set_pin(uart_port_t number, int tx, int rx, int, int) {
  uart(number).set_pins(rx, tx);
  return ESP_OK;
}
esp_err_t uart_set_baudrate(uart_port_t number, std::uint32_t baud) {
  uart(number).set_baud(baud, machine().now_us());
  return ESP_OK;
}
esp_err_t uart_set_rx_full_threshold(uart_port_t number, int threshold) {
  uart(number).rx_threshold = threshold;
  return ESP_OK;
}
esp_err_t uart_set_rx_timeout(uart_port_t, std::uint8_t) { return ESP_OK; }
int uart_read_bytes(uart_port_t number, void* into, std::uint32_t length, TickType_t) {
  if (!uart(number).installed()) return -1;
  return static_cast<int>(uart(number).take(static_cast<std::uint8_t*>(into), length, machine().now_us()));
}
int uart_write_bytes(uart_port_t number, const void* from, std::size_t size) {
  fake::Uart& to = uart(number);
  if (!to.installed()) return -1;
  const auto* bytes = static_cast<const std::uint8_t*>(from);
  for (std::size_t i = 0; i < size;) {
    // Without a transmit buffer the caller waits for the interrupt that says the FIFO is nearly empty.
    if (to.transmit_capacity() == 0 && to.room_in_fifo(machine().now_us()) == 0) machine().sleep_until(to.refill_us());
    to.push(bytes[i++], machine().now_us());
  }
  return static_cast<int>(size);
}

std::uint32_t fake_register(std::uint32_t address) {
  for (int number = 0; number < 3; ++number) {
    if (address != UART_STATUS_REG(number)) continue;
    const std::uint64_t now_us = machine().now_us();
    const auto in_fifo = static_cast<std::uint32_t>(uart(number).in_fifo(now_us));
    return in_fifo << UART_TXFIFO_CNT_S | (uart(number).shifting(now_us) ? 5u << UART_ST_UTX_OUT_S : 0u);
  }
  std::abort();
}

void EspSoftwareSerial::UART::begin(std::uint32_t baud, Config, std::int8_t rxPin, std::int8_t txPin, bool,
                                    int bufCapacity, int) {
  rx_pin_ = rxPin;
  fake::Uart& wires = machine().software_uart(rxPin);
  wires.install(static_cast<std::size_t>(bufCapacity), 0);
  wires.set_pins(rxPin, txPin);
  wires.set_baud(baud, machine().now_us());
  wires.installed_on_core = machine().running().core;
}
int EspSoftwareSerial::UART::read(std::uint8_t* buffer, std::size_t size) {
  return static_cast<int>(machine().software_uart(rx_pin_).take(buffer, size, machine().now_us()));
}
std::size_t EspSoftwareSerial::UART::write(std::uint8_t byte) {
  fake::Uart& wires = machine().software_uart(rx_pin_);
  wires.push(byte, machine().now_us());
  machine().spend(10000000 / wires.baud() + 1);
  return 1;
}

TwoWire Wire;

bool TwoWire::begin(int sda, int scl, std::uint32_t frequency) {
  if (begun_) return false;
  sda_ = sda;
  scl_ = scl;
  frequency_ = frequency;
  machine().pin_mode(sda, OUTPUT_OPEN_DRAIN | 0x100);  // the peripheral's, no longer the pin's own
  machine().pin_mode(scl, OUTPUT_OPEN_DRAIN | 0x100);
  return begun_ = true;
}
bool TwoWire::end() {
  begun_ = false;
  return true;
}
void TwoWire::beginTransmission(std::uint8_t address) {
  address_ = address;
  out_.clear();
}
std::size_t TwoWire::write(const std::uint8_t* data, std::size_t size) {
  out_.insert(out_.end(), data, data + size);
  return size;
}
// Spends the time of a transfer, or of the time-out.
bool TwoWire::ready(std::size_t bytes) {
  if (!begun_) return false;
  if (machine().i2c_blocked() || machine().i2c_hangs()) {
    machine().spend(timeout_ms_ * 1000u);
    return false;
  }
  machine().spend((1 + bytes) * 9 * 1000000 / frequency_ + 20);
  machine().i2c().set_time(machine().now_us());
  return true;
}
std::uint8_t TwoWire::endTransmission(bool) {
  if (!begun_) return 4;
  if (!ready(out_.size())) return 5;
  return machine().i2c().write(address_, brov::Bytes(out_.data(), out_.size())) ? 0 : 2;
}
std::size_t TwoWire::requestFrom(std::uint8_t address, std::size_t size, bool) {
  in_.assign(size, 0);
  read_ = 0;
  if (!ready(size) || !machine().i2c().read(address, in_.data(), size)) in_.clear();
  return in_.size();
}
int TwoWire::read() { return read_ < in_.size() ? in_[read_++] : -1; }

bool Preferences::begin(const char* name, bool readOnly) {
  const fake::Flash& flash = machine().flash();
  const std::string prefix = std::string(name) + "/";
  const auto first = flash.values.lower_bound(prefix);
  const bool exists = first != flash.values.end() && first->first.compare(0, prefix.size(), prefix) == 0;
  if (prefix.size() > 16 || flash.broken || (readOnly && !exists)) return false;
  name_ = prefix;
  read_only_ = readOnly;
  return true;
}
bool Preferences::put(const char* key, std::uint32_t value) {
  if (name_.empty() || read_only_ || std::string(key).size() > 15) return false;
  machine().flash().values[name_ + key] = value;
  return true;
}
std::size_t Preferences::putUInt(const char* key, std::uint32_t value) { return put(key, value) ? sizeof value : 0; }
std::size_t Preferences::putUShort(const char* key, std::uint16_t value) { return put(key, value) ? sizeof value : 0; }
std::uint32_t Preferences::getUInt(const char* key, std::uint32_t defaultValue) {
  const auto& values = machine().flash().values;
  const auto found = values.find(name_ + key);
  return name_.empty() || found == values.end() ? defaultValue : found->second;
}
std::uint16_t Preferences::getUShort(const char* key, std::uint16_t defaultValue) {
  return static_cast<std::uint16_t>(getUInt(key, defaultValue));
}
