// What the tests of the readers stand on: a sink that keeps reports, a machine that keeps what was written, a bus that
// can be told what to answer.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "brov/sensors.h"
#include "hex.h"

inline brov::Bytes bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

struct Burst {
  std::uint32_t t0_us, dt_us;
  std::vector<brov::ImuSample> samples;
};

class KeptReports final : public brov::ReportSink {
 public:
  void imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const brov::ImuSample* samples,
                 std::uint8_t count) override {
    bursts.push_back({t0_us, dt_us, {samples, samples + count}});
  }
  void gps_report(const brov::GpsFields& report) override { gps.push_back(report); }

  std::vector<Burst> bursts;
  std::vector<brov::GpsFields> gps;
};

// Devices with registers: a command selects what the next read gives. Everything is written down.
class FakeBus final : public brov::I2cBus {
 public:
  bool write(std::uint8_t address, brov::Bytes data) override {
    selected_[address] = data[0];
    commands.push_back(data[0]);
    return acknowledges(address);
  }
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override {
    if (!acknowledges(address)) {
      return false;
    }
    const Buffer& answer = answers[address][selected_[address]];
    for (std::size_t i = 0; i < count; ++i) {
      into[i] = i < answer.size() ? answer[i] : std::uint8_t{0};
    }
    return true;
  }
  void recover() override { ++recoveries; }

  void set_word(std::uint8_t address, std::size_t index, std::uint16_t word) {
    answers[address][static_cast<std::uint8_t>(0xA0 + 2 * index)] = {static_cast<std::uint8_t>(word >> 8),
                                                                     static_cast<std::uint8_t>(word)};
  }
  void set_adc(std::uint8_t address, std::uint32_t adc) {
    answers[address][0x00] = {static_cast<std::uint8_t>(adc >> 16), static_cast<std::uint8_t>(adc >> 8),
                              static_cast<std::uint8_t>(adc)};
  }

  std::map<std::uint8_t, std::map<std::uint8_t, Buffer>> answers;
  std::vector<std::uint8_t> commands;
  int fail_transaction = -1;  // the one with this number, from 0, is not acknowledged
  bool held_low = false;
  int recoveries = 0;

 private:
  bool acknowledges(std::uint8_t) { return transactions_++ != fail_transaction && !held_low; }

  std::map<std::uint8_t, std::uint8_t> selected_;
  int transactions_ = 0;
};

class KeptWrites final : public brov::Hal {
 public:
  struct Write {
    brov::Port port;
    std::uint64_t at_us;
    std::string hex;
  };

  void link_write(brov::Bytes, std::uint64_t) override {}
  std::uint32_t link_backlog(std::uint64_t) override { return 0; }
  void link_set_baud(std::uint32_t, std::uint64_t) override {}
  void port_write(brov::Port port, brov::Bytes data, std::uint64_t now_us) override {
    writes.push_back({port, now_us, to_hex(data)});
  }
  brov::I2cBus& i2c() override { return bus; }
  void save_settings(const brov::Settings&) override {}

  std::vector<Write> writes;
  FakeBus bus;
};
