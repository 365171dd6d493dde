// The two I2C sensors as their registers look from the bus. docs/firmware-core.md section 7.
#pragma once

#include <array>
#include <cstdint>

#include "brov/hal.h"

namespace brov {

constexpr std::uint8_t kMs5837Address = 0x76, kTsys01Address = 0x77;

// A sensor of this family: reset, PROM words, conversions that take their time, one result register.
class ConvertingSensor {
 public:
  struct Conversion {
    std::uint8_t command;
    std::uint32_t duration_us;  // the longest one of the datasheet
    std::uint32_t value = 0;    // 24 bits
  };

  ConvertingSensor(std::uint8_t prom_words, Conversion first, Conversion second)
      : prom_words_(prom_words), conversions_{first, second} {}

  void set_prom_word(std::size_t index, std::uint16_t word) { prom_[index] = word; }
  void set_value(std::size_t conversion, std::uint32_t value) { conversions_[conversion].value = value & 0xFFFFFF; }
  void forget_conversion() { running_ = nullptr; }

  void write(Bytes data, std::uint64_t now_us);
  void read(std::uint8_t* into, std::size_t count) const;

 private:
  void select(std::uint32_t value, std::size_t bytes);

  std::size_t prom_words_;
  std::array<std::uint16_t, 8> prom_{};
  std::array<Conversion, 2> conversions_;
  const Conversion* running_ = nullptr;
  std::uint64_t started_us_ = 0;
  std::array<std::uint8_t, 3> selected_{};
  std::size_t selected_bytes_ = 0;
};

// Who acknowledges. Numbers are those of the native program's protocol.
enum class BusState : std::uint8_t { kFine = 0, kMs5837Silent = 1, kTsys01Silent = 2, kBothSilent = 3, kHeldLow = 4 };

class I2cModels final : public I2cBus {
 public:
  class Listener {
   public:
    virtual void i2c_recovered() = 0;

   protected:
    ~Listener() = default;
  };

  explicit I2cModels(Listener& listener) : listener_(listener) {}

  void set_time(std::uint64_t now_us) { now_us_ = now_us; }
  void set_state(BusState state) { state_ = state; }
  ConvertingSensor& ms5837() { return ms5837_; }
  ConvertingSensor& tsys01() { return tsys01_; }
  // The board's timer starts anew: what was begun in the old time does not end in the new one.
  void time_restarts();

  bool write(std::uint8_t address, Bytes data) override;
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override;
  void recover() override { listener_.i2c_recovered(); }

 private:
  ConvertingSensor* acknowledging(std::uint8_t address);

  Listener& listener_;
  std::uint64_t now_us_ = 0;
  BusState state_ = BusState::kFine;
  // TE MS5837-30BA: oversampling 8192 takes at most 18.08 ms. TE TSYS01: at most 9.04 ms.
  ConvertingSensor ms5837_{7, {0x4A, 18080}, {0x5A, 18080}};
  ConvertingSensor tsys01_{8, {0x48, 9040}, {0x48, 9040}};
};

}  // namespace brov
