// The UART driver of ESP-IDF 4.4, as far as src/ uses it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "esp_err.h"
#include "freertos/FreeRTOS.h"

using uart_port_t = int;
using QueueHandle_t = void*;
#define UART_NUM_0 (0)
#define UART_NUM_1 (1)
#define UART_NUM_2 (2)
#define UART_PIN_NO_CHANGE (-1)

typedef enum { UART_DATA_8_BITS = 3 } uart_word_length_t;
typedef enum { UART_STOP_BITS_1 = 1 } uart_stop_bits_t;
typedef enum { UART_PARITY_DISABLE = 0 } uart_parity_t;
typedef enum { UART_HW_FLOWCTRL_DISABLE = 0 } uart_hw_flowcontrol_t;
typedef enum { UART_SCLK_APB = 0 } uart_sclk_t;

typedef struct {
  int baud_rate;
  uart_word_length_t data_bits;
  uart_parity_t parity;
  uart_stop_bits_t stop_bits;
  uart_hw_flowcontrol_t flow_ctrl;
  std::uint8_t rx_flow_ctrl_thresh;
  uart_sclk_t source_clk;
} uart_config_t;

esp_err_t uart_driver_install(uart_port_t number, int rx_buffer_size, int tx_buffer_size, int queue_size,
                              QueueHandle_t* queue, int intr_alloc_flags);
esp_err_t uart_param_config(uart_port_t number, const uart_config_t* config);
esp_err_t uart_set_pin(uart_port_t number, int tx, int rx, int rts, int cts);
esp_err_t uart_set_baudrate(uart_port_t number, std::uint32_t baud);
esp_err_t uart_set_rx_full_threshold(uart_port_t number, int threshold);
esp_err_t uart_set_rx_timeout(uart_port_t number, std::uint8_t symbols);
int uart_read_bytes(uart_port_t number, void* into, std::uint32_t length, TickType_t ticks_to_wait);
int uart_write_bytes(uart_port_t number, const void* from, std::size_t size);
