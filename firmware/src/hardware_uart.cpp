#include "hardware_uart.h"

namespace brov {

namespace {

// The receive FIFO has 128 bytes, which 921 600 baud fill in 1.4 ms. The driver's own threshold of 120 would leave an
// interrupt 87 us to be late; this one leaves 0.7 ms.
constexpr int kFifoThreshold = 64;
// What came stays in the FIFO no longer than this many byte times after the line fell silent.
constexpr std::uint8_t kSilenceThreshold = 2;

}  // namespace

void HardwareUart::begin(std::uint32_t baud) {
  uart_config_t config = {};
  config.baud_rate = static_cast<int>(baud);
  config.data_bits = UART_DATA_8_BITS;
  config.parity = UART_PARITY_DISABLE;
  config.stop_bits = UART_STOP_BITS_1;
  config.flow_ctrl = UART_HW_FLOWCTRL_DISABLE;
  config.source_clk = UART_SCLK_APB;
  ESP_ERROR_CHECK(uart_driver_install(number_, buffers_.receive, buffers_.transmit, 0, nullptr, 0));
  ESP_ERROR_CHECK(uart_param_config(number_, &config));
  ESP_ERROR_CHECK(uart_set_pin(number_, tx_pin_, rx_pin_, UART_PIN_NO_CHANGE, UART_PIN_NO_CHANGE));
  ESP_ERROR_CHECK(uart_set_rx_full_threshold(number_, kFifoThreshold));
  ESP_ERROR_CHECK(uart_set_rx_timeout(number_, kSilenceThreshold));
}

std::size_t HardwareUart::read(std::uint8_t* into, std::size_t most) {
  const int count = uart_read_bytes(number_, into, static_cast<std::uint32_t>(most), 0);
  return count > 0 ? static_cast<std::size_t>(count) : 0;
}

}  // namespace brov
