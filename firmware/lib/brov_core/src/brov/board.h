// The board: inputs, jobs and transmitter, tick by tick. docs/firmware-core.md.
#pragma once

#include <array>

#include "brov/byte_ring.h"
#include "brov/hal.h"
#include "brov/host_commands.h"
#include "brov/i2c_device.h"
#include "brov/payloads.h"
#include "brov/sensors.h"
#include "brov/settings.h"
#include "brov/sonar_traffic.h"
#include "brov/transmitter.h"

namespace brov {

constexpr std::uint8_t kFirmwareVersion[3] = {0, 2, 0};

struct BootInfo {
  std::uint64_t boot_us = 0;  // device time now
  std::uint16_t boot_count = 0;
  std::uint8_t reset_reason = 1;  // the ESP-IDF's numbers
};

// When something periodic is due next; it does not catch up on what a held-up board missed.
class Periodic {
 public:
  explicit Periodic(std::uint64_t first_us) : due_us_(first_us) {}
  bool due(std::uint64_t now_us, std::uint64_t period_us) {
    if (now_us < due_us_) return false;
    due_us_ += period_us;
    if (due_us_ <= now_us) due_us_ = now_us + period_us;
    return true;
  }
  void restart(std::uint64_t due_us) { due_us_ = due_us; }

 private:
  std::uint64_t due_us_;
};

class Board final : private ReportSink, private HostCommands::Listener {
 public:
  Board(Hal& hal, const Settings& settings, const BootInfo& boot);
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;

  // Room for bytes of this input (sonar rings 16 384); what does not fit is dropped and counted.
  // May be called from another context than tick() for one port at a time: the rings are single-producer single-consumer.
  void receive(Port port, Bytes data);
  void tick(std::uint64_t now_us);
  // No later than this the next tick has something to do (for a loop that may sleep). Inputs may wake it earlier.
  std::uint64_t next_wanted_us(std::uint64_t now_us) const;

  const Transmitter& transmitter() const { return transmitter_; }
  const SonarPort& sonar(Channel channel) const { return sonars_.port(channel); }
  // What SENSORS would say now.
  SensorFields readings(std::uint64_t now_us) const;

 private:
  void imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count) override;
  void gps_report(const GpsFields& report) override;
  void time_sync(std::uint64_t host_us, std::uint64_t now_us) override;
  void settings_changed(const Settings& before, std::uint64_t now_us) override;

  void take_inputs(std::uint64_t now_us);
  void run_jobs(std::uint64_t now_us);
  void send_sensors(std::uint64_t now_us);
  void send_status(std::uint64_t now_us, std::uint64_t echoed_host_us, std::uint32_t echo_device_us);
  std::uint64_t sensors_period_us() const { return 1000000000u / settings_.sensors_rate_mhz; }
  std::uint32_t overflow_bytes(Channel channel) const;

  Hal& hal_;
  Settings settings_;
  BootInfo boot_;
  Transmitter transmitter_;
  SonarTraffic sonars_;
  HostCommands host_;

  ByteRing<512> imu_ring_, gps_ring_, ec_ring_;
  WitMotionReader imu_;
  NmeaReader gps_;
  EzoEcReader ec_;
  CountedBus bus_;
  Ms5837 depth_;
  Tsys01 celsius_;

  Periodic sensors_job_, status_job_;
};

static_assert(sizeof(Board) <= 96 * 1024, "all of the board's memory but the stack");

}  // namespace brov
