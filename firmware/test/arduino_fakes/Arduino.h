// Names and signatures of the Arduino core for the ESP32 (2.0.17), as far as src/ uses them.
#pragma once

#include <cstdint>

#include "esp_err.h"
#include "freertos/FreeRTOS.h"
#include "freertos/task.h"

#define LOW 0x0
#define HIGH 0x1
#define INPUT 0x01
#define OUTPUT 0x03
#define OUTPUT_OPEN_DRAIN 0x13

void pinMode(std::uint8_t pin, std::uint8_t mode);
void digitalWrite(std::uint8_t pin, std::uint8_t value);
int digitalRead(std::uint8_t pin);
void delayMicroseconds(std::uint32_t us);

// The sketch's own.
void setup();
void loop();
