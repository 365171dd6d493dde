// Preferences of the Arduino core for the ESP32, as far as src/ uses it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

class Preferences {
 public:
  bool begin(const char* name, bool readOnly = false);
  void end() { name_.clear(); }
  std::size_t putUInt(const char* key, std::uint32_t value);
  std::size_t putUShort(const char* key, std::uint16_t value);
  std::uint32_t getUInt(const char* key, std::uint32_t defaultValue = 0);
  std::uint16_t getUShort(const char* key, std::uint16_t defaultValue = 0);

 private:
  bool put(const char* key, std::uint32_t value);

  std::string name_;
  bool read_only_ = true;
};
