// The status register of the ESP32's UARTs. Technical reference manual, UART_STATUS_REG.
#pragma once

#define REG_UART_BASE(i) (0x3FF40000u + static_cast<std::uint32_t>(i) * 0x10000u + ((i) > 1 ? 0xE000u : 0u))
#define UART_STATUS_REG(i) (REG_UART_BASE(i) + 0x1Cu)
#define UART_ST_UTX_OUT_V 0xFu
#define UART_ST_UTX_OUT_S 24
#define UART_TXFIFO_CNT_V 0xFFu
#define UART_TXFIFO_CNT_S 16
