// The readers of the small sensors: bytes in, newest readings out. docs/firmware-core.md section 6.
#pragma once

#include <array>

#include "brov/hal.h"
#include "brov/i2c_device.h"
#include "brov/payloads.h"
#include "brov/settings.h"

namespace brov {

// When byte `index` of a batch of `count` bytes came, if the last one came at `now`.
constexpr std::uint64_t arrival_us(std::uint64_t now_us, std::uint64_t bytes_behind, std::uint32_t baud) {
  const std::uint64_t ago = bytes_behind * 10000000u / baud;
  return ago > now_us ? 0 : now_us - ago;
}

// Receives complete reports of the readers.
class ReportSink {
 public:
  virtual void imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count) = 0;
  virtual void gps_report(const GpsFields& report) = 0;

 protected:
  ~ReportSink() = default;
};

// A burst closes when (2 count + 1) periods reach 200 ms, so at 20 Hz and below no more than 2 gather.
constexpr std::uint8_t kMaxBurstSamples = 4;

class WitMotionReader {
 public:
  void start(std::uint64_t boot_us) { s_.configure_us = boot_us + 500000; }
  void feed(Bytes batch, std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink);
  // Configuration commands when they are due; at most one per tick.
  void configure(std::uint64_t now_us, std::uint32_t rate_mhz, Hal& hal);
  void rate_changed();
  // Writes roll, pitch, yaw, acceleration, counters and alive.
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  std::uint16_t errors() const { return errors_; }

 private:
  void packet(const std::uint8_t* packet, std::uint64_t time_us, std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink);
  void sample(const ImuSample& sample, std::uint32_t rate_mhz, ReportSink& sink);

  std::array<std::uint8_t, 11 + 256> buffer_{};
  std::size_t size_ = 0;
  // further state is the implementation's
  struct State {
    ImuSample open{};
    bool has_open = false, has_rate = false;
    std::array<ImuSample, kMaxBurstSamples> gathered{};
    std::uint8_t gathered_count = 0;
    std::uint64_t next_us = 0;
    std::int16_t angle_raw[3] = {0, 0, 0}, acceleration_raw[3] = {0, 0, 0};
    bool has_packet = false, has_angle = false, has_acceleration = false, has_sample = false;
    std::uint64_t packet_us = 0, angle_us = 0, acceleration_us = 0, sample_us = 0;
    std::uint8_t step = 0;
    bool configuring = false;
    std::uint64_t configure_us = 500000;
    std::uint32_t packets = 0;
  } s_;
  std::uint16_t errors_ = 0;
};

class NmeaReader {
 public:
  void feed(Bytes batch, std::uint64_t now_us, ReportSink& sink);
  void tick(std::uint64_t now_us, ReportSink& sink);  // reports that waited long enough for their other half
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  std::uint16_t errors() const { return errors_; }

 private:
  struct Parts;  // fields of one line, in the .cpp
  std::array<char, 101> line_{};
  std::size_t size_ = 0;
  bool in_line_ = false, too_long_ = false;
  std::uint64_t line_us_ = 0;
  struct State {
    GpsFields pending{};
    bool has_gga = false, has_rmc = false, altitude_known = false, rmc_valid = false;
    std::uint8_t quality = 0;
    std::array<char, 12> time{};
    std::uint64_t pending_since_us = 0;
    std::uint8_t gsa_mode = 0;
    std::uint64_t gsa_us = 0;
    bool has_gsa = false, has_good = false, has_report = false;
    std::uint64_t good_us = 0, report_us = 0;
    GpsFields report{};
  } s_;
  std::uint16_t errors_ = 0;
};

class EzoEcReader {
 public:
  void start(std::uint64_t boot_us) { configure_us_ = boot_us + 700000; }
  void feed(Bytes batch, std::uint64_t now_us);
  void configure(std::uint64_t now_us, Hal& hal);
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  bool alive(std::uint64_t now_us) const;
  std::uint32_t conductivity_dus() const { return conductivity_dus_; }
  std::uint16_t errors() const { return errors_; }

 private:
  std::array<char, 41> line_{};
  std::size_t size_ = 0;
  bool too_long_ = false;
  std::uint32_t conductivity_dus_ = 0;
  std::uint16_t salinity_cpsu_ = 0xFFFF, errors_ = 0;
  bool has_reading_ = false, configuring_ = false;
  std::uint64_t reading_us_ = 0, configure_us_ = 700000;
  std::uint8_t step_ = 0;
};

// MS5837-30BA. Source: TE datasheet, "Pressure and temperature calculation" with second-order compensation, CRC-4.
struct Ms5837Result {
  std::int64_t pressure_pa = 0;  // = 0.01 mbar
  std::int32_t temperature_cdegc = 0;
};
bool ms5837_prom_ok(const std::uint16_t (&prom)[7]);  // CRC-4 in the top bits of word 0
Ms5837Result ms5837_compute(const std::uint16_t (&prom)[7], std::uint32_t d1, std::uint32_t d2);

class Ms5837 {
 public:
  void start(std::uint64_t boot_us) { wait_until_us_ = boot_us + 10000; }
  void tick(std::uint64_t now_us, CountedBus& bus);
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  bool ok(std::uint64_t now_us) const;
  std::int64_t pressure_pa() const { return result_.pressure_pa; }

 private:
  void fail(std::uint64_t now_us);

  enum class Step : std::uint8_t { kReset, kProm, kConvert1, kRead1, kConvert2, kRead2 };
  Step step_ = Step::kReset;
  std::uint8_t word_ = 0;
  std::uint16_t prom_[7] = {};
  std::uint32_t d1_ = 0;
  std::uint64_t wait_until_us_ = 0, pair_started_us_ = 0, read_us_ = 0;
  bool has_reading_ = false;
  Ms5837Result result_{};
};

// TSYS01. Source: TE datasheet, temperature polynomial, PROM checksum.
bool tsys01_prom_ok(const std::uint16_t (&prom)[8]);
double tsys01_temperature_degc(const std::uint16_t (&prom)[8], std::uint32_t adc24);

class Tsys01 {
 public:
  void start(std::uint64_t boot_us) { wait_until_us_ = boot_us + 10000; }
  void tick(std::uint64_t now_us, CountedBus& bus);
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  bool ok(std::uint64_t now_us) const;
  double temperature_degc() const { return temperature_degc_; }

 private:
  void fail(std::uint64_t now_us);

  enum class Step : std::uint8_t { kReset, kProm, kConvert, kRead };
  Step step_ = Step::kReset;
  std::uint8_t word_ = 0;
  std::uint16_t prom_[8] = {};
  std::uint64_t wait_until_us_ = 0, started_us_ = 0, read_us_ = 0;
  bool has_reading_ = false;
  double temperature_degc_ = 0.0;
};

}  // namespace brov
