#include "usb_link.h"

#include <esp_task_wdt.h>
#include <soc/soc.h>
#include <soc/uart_reg.h>

#include "device_time.h"
#include "pins.h"

namespace brov {

namespace {

constexpr int kReceiveBufferBytes = 2048;
// No transmit buffer in the driver: of several items in it the driver tells the size of one only, and the transmitter
// must know exactly how much SENSORS would have to wait for.
constexpr HardwareUart::Buffers kBuffers{kReceiveBufferBytes, 0};

constexpr std::uint32_t kLongestDrainUs = 30000;  // more than a window takes at 115200 baud

std::uint32_t bytes_in_hardware(uart_port_t number) {
  const std::uint32_t status = REG_READ(UART_STATUS_REG(number));
  const std::uint32_t in_fifo = status >> UART_TXFIFO_CNT_S & UART_TXFIFO_CNT_V;
  const bool shifting = (status >> UART_ST_UTX_OUT_S & UART_ST_UTX_OUT_V) != 0;
  return in_fifo + (shifting ? 1 : 0);
}

}  // namespace

UsbLink::UsbLink(std::uint32_t baud) : uart_(UART_NUM_0, pins::kUsbRx, pins::kUsbTx, kBuffers), baud_(baud) {}

void UsbLink::run_writer() {
  ESP_ERROR_CHECK(esp_task_wdt_add(nullptr));
  for (;;) {
    while (const std::size_t size = waiting_.size()) {
      const Bytes piece = waiting_.front(size < kPieceBytes ? size : kPieceBytes);
      uart_.write(piece);
      waiting_.consume(piece.size);
    }
    esp_task_wdt_reset();
    ulTaskNotifyTake(pdTRUE, pdMS_TO_TICKS(500));
  }
}

void UsbLink::write(Bytes data) {
  waiting_.write(data);
  if (const TaskHandle_t writer = writer_.load()) xTaskNotifyGive(writer);
}

std::uint32_t UsbLink::backlog() const {
  // In this order: a piece that moves on in between is counted twice, never lost.
  const auto waiting = static_cast<std::uint32_t>(waiting_.size());
  return waiting + bytes_in_hardware(uart_.number());
}

void UsbLink::set_baud(std::uint32_t baud) {
  const std::uint64_t give_up_us = device_us() + kLongestDrainUs;
  while (backlog() != 0 && device_us() < give_up_us) vTaskDelay(1);
  uart_.set_baud(baud);
}

}  // namespace brov
