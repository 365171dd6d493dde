// The rig's I2C devices as their registers look from the bus: two servo boards and five IMUs that share an address.
#pragma once

#include <array>
#include <cstdint>

#include "brov/hal.h"

namespace brov::rig {

// A device with a pointer to one of 256 registers, set by the first byte of a write.
class RegisterDevice {
 public:
  virtual ~RegisterDevice() = default;
  void write(Bytes data);
  void read(std::uint8_t* into, std::size_t count);
  std::uint8_t reg(std::uint8_t number) const { return registers_[number]; }

 protected:
  virtual bool writable(std::uint8_t number) const = 0;
  virtual bool increments() const = 0;
  virtual std::uint8_t value(std::uint8_t number) const { return registers_[number]; }

  std::array<std::uint8_t, 256> registers_{};

 private:
  std::uint8_t pointer_ = 0;
};

class Pca9685Model final : public RegisterDevice {
 public:
  Pca9685Model() { power_on(); }
  void power_on();
  // What comes out of a channel: counts from the pulse's start to its end; 0 while the board sleeps.
  std::uint16_t pulse_counts(std::size_t channel) const;
  double frequency_hz() const;  // by its prescaler and 25 MHz

 private:
  bool writable(std::uint8_t number) const override;
  bool increments() const override { return (registers_[0] & 0x20) != 0; }
};

class Mpu6050Model final : public RegisterDevice {
 public:
  explicit Mpu6050Model(std::uint8_t identity = 0x68);
  // Accelerometer, temperature, gyroscope, in the order of its registers; seen once it is awake.
  void set_raw(const std::array<std::int16_t, 7>& raw) { raw_ = raw; }

 private:
  bool writable(std::uint8_t number) const override { return number == 0x6B || (number >= 0x19 && number <= 0x1C); }
  bool increments() const override { return true; }
  std::uint8_t value(std::uint8_t number) const override;

  std::array<std::int16_t, 7> raw_{};
};

class RigModels final : public I2cBus {
 public:
  static constexpr std::size_t kBoards = 2, kImus = 5;

  std::array<Pca9685Model, kBoards> boards;
  std::array<Mpu6050Model, kImus> imus;
  std::array<bool, kBoards> board_answers{true, true};
  std::array<bool, kImus> imu_answers{true, true, true, true, true};
  std::size_t selected_imu = 0;
  std::uint32_t writes = 0, recoveries = 0;

  bool write(std::uint8_t address, Bytes data) override;
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override;
  void recover() override { ++recoveries; }

 private:
  RegisterDevice* acknowledging(std::uint8_t address);
};

}  // namespace brov::rig
