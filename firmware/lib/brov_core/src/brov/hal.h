// What the core needs from the machine it runs on. The ESP32, the native program and the tests each bring their own.
#pragma once

#include <cstdint>

#include "brov/bytes.h"

namespace brov {

enum class Channel : std::uint8_t { kA = 0, kB = 1 };

// Inputs of the board, in the order in which a tick takes them. Numbers are those of the native program's protocol.
enum class Port : std::uint8_t { kHost = 0, kSonarA = 1, kSonarB = 2, kImu = 3, kGps = 4, kEc = 5 };

constexpr std::uint32_t kSonarBaud = 921600;
constexpr std::uint32_t kSensorBaud = 9600;
constexpr std::uint32_t kRomBaud = 115200;

// Transactions are short and never wait for a device longer than a few milliseconds; false = not acknowledged, time-out
// or bus held low.
class I2cBus {
 public:
  virtual bool write(std::uint8_t address, Bytes data) = 0;
  virtual bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) = 0;
  virtual void recover() = 0;  // nine clocks and a stop

 protected:
  ~I2cBus() = default;
};

class Hal {
 public:
  // The USB serial line: hand over one whole frame (there is room: the transmitter asked for the backlog first).
  virtual void link_write(Bytes frame, std::uint64_t now_us) = 0;
  // Bytes handed over that have not left the board yet.
  virtual std::uint32_t link_backlog(std::uint64_t now_us) = 0;
  virtual void link_set_baud(std::uint32_t baud, std::uint64_t now_us) = 0;
  // Bytes for a sensor's own UART: sonar commands, IMU and EC configuration.
  virtual void port_write(Port port, Bytes data, std::uint64_t now_us) = 0;
  virtual I2cBus& i2c() = 0;
  // Keep what survives power-off (rates, decimation); called at most once per CONFIG.
  virtual void save_settings(const struct Settings& settings) = 0;

 protected:
  ~Hal() = default;
};

}  // namespace brov
