// The fuzzer's bytes cut into what a board sees: pauses and batches. Violations of what must always hold abort.
#pragma once

#include <cstdint>
#include <cstdlib>

#include "brov/hal.h"
#include "brov/settings.h"

class FuzzInput {
 public:
  FuzzInput(const std::uint8_t* data, std::size_t size) : rest_(data, size) {}

  bool empty() const { return rest_.size == 0; }
  std::uint8_t byte() { return empty() ? std::uint8_t{0} : take(1)[0]; }
  std::uint16_t word() {
    const std::uint8_t high = byte();
    return static_cast<std::uint16_t>(high << 8 | byte());
  }
  // Most pauses are short, some are minutes: 0 to 127 ms, or the next byte's seconds.
  std::uint64_t pause_us() {
    const std::uint8_t code = byte();
    return code < 128 ? code * 1000u : byte() * 1000000u;
  }
  // A batch of up to 255 bytes.
  brov::Bytes batch() { return take(byte()); }

 private:
  brov::Bytes take(std::size_t count) {
    const brov::Bytes taken = rest_.first(count < rest_.size ? count : rest_.size);
    rest_ = rest_.from(taken.size);
    return taken;
  }

  brov::Bytes rest_;
};

inline void require(bool holds) {
  if (!holds) {
    std::abort();
  }
}

// One AA55 frame of a type and a size that the board sends, with the right check.
inline bool whole_frame_for_the_host(brov::Bytes frame) {
  if (frame.size < 6 || frame.size > 518 || frame[0] != 0xAA || frame[1] != 0x55) return false;
  const std::uint8_t type = frame[2];
  if (!((type >= 0x01 && type <= 0x07) || type == 0x0B)) return false;
  if (static_cast<std::size_t>(frame[3] << 8 | frame[4]) != frame.size - 6) return false;
  std::uint8_t check = 0;
  for (std::size_t i = 2; i < frame.size; ++i) check = static_cast<std::uint8_t>(check ^ frame[i]);
  return check == 0;
}

// A machine nobody is connected to.
template <typename Bus>
class FuzzHal final : public brov::Hal {
 public:
  explicit FuzzHal(Bus& bus) : bus_(bus) {}
  void link_write(brov::Bytes frame, std::uint64_t) override { require(whole_frame_for_the_host(frame)); }
  std::uint32_t link_backlog(std::uint64_t) override { return backlog; }
  void link_set_baud(std::uint32_t baud, std::uint64_t) override { require(baud == 115200 || baud == 921600); }
  void port_write(brov::Port, brov::Bytes data, std::uint64_t) override { require(data.size > 0 && data.size <= 263); }
  brov::I2cBus& i2c() override { return bus_; }
  void save_settings(const brov::Settings&) override {}

  std::uint32_t backlog = 0;

 private:
  Bus& bus_;
};

// Acknowledges and answers as the fuzzer says.
class FuzzBus final : public brov::I2cBus {
 public:
  explicit FuzzBus(FuzzInput& input) : input_(input) {}
  bool write(std::uint8_t address, brov::Bytes data) override {
    require((address == 0x76 || address == 0x77) && data.size == 1);
    return (input_.byte() & 15) != 15;
  }
  bool read(std::uint8_t, std::uint8_t* into, std::size_t count) override {
    require(count == 2 || count == 3);
    for (std::size_t i = 0; i < count; ++i) {
      into[i] = input_.byte();
    }
    return (input_.byte() & 15) != 15;
  }
  void recover() override {}

 private:
  FuzzInput& input_;
};
