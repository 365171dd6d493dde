// TwoWire of the Arduino core for the ESP32, as far as src/ uses it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

class TwoWire {
 public:
  bool begin(int sda, int scl, std::uint32_t frequency = 0);
  bool end();
  void setTimeOut(std::uint16_t timeOutMillis) { timeout_ms_ = timeOutMillis; }
  void beginTransmission(std::uint8_t address);
  std::uint8_t endTransmission(bool sendStop = true);
  std::size_t requestFrom(std::uint8_t address, std::size_t size, bool sendStop);
  std::size_t write(const std::uint8_t* data, std::size_t size);
  int read();

 private:
  bool ready(std::size_t bytes);

  int sda_ = -1, scl_ = -1;
  std::uint32_t frequency_ = 0;
  bool begun_ = false;
  std::uint16_t timeout_ms_ = 50;
  std::uint8_t address_ = 0;
  std::vector<std::uint8_t> out_, in_;
  std::size_t read_ = 0;
};

extern TwoWire Wire;
