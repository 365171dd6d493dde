// WitMotion HWT905: packets of 11 bytes, its configuration, and bursts of raw samples. docs/firmware-core.md section 6.
#pragma once

#include <array>

#include "brov/readings.h"

namespace brov {

class WitMotionReader {
 public:
  void start(std::uint64_t boot_us) { command_us_ = boot_us + kFirstCommandUs; }
  void feed(Bytes batch, std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink);
  // Configuration commands when they are due; at most one per tick.
  void configure(std::uint64_t now_us, std::uint32_t rate_mhz, Hal& hal);
  void rate_changed();
  // Writes roll, pitch, yaw, acceleration, counters and alive.
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  std::uint16_t errors() const { return errors_; }

 private:
  static constexpr std::size_t kPacketBytes = 11;
  static constexpr std::uint64_t kFirstCommandUs = 500000;

  using Axes = std::array<std::int16_t, 3>;
  enum class Command : std::uint8_t { kNone, kUnlock, kOutputs, kRate, kSave };

  void search(std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink);
  void drop_to_next_sync();
  void packet(std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink);
  bool belongs_to_open(std::uint64_t time_us) const;
  void complete(std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink);
  void gather(const ImuSample& sample, std::uint64_t period_us, ReportSink& sink);
  void send_burst(std::uint64_t period_us, ReportSink& sink);
  bool delivers_as_set(std::uint64_t now_us, std::uint32_t rate_mhz) const;

  std::array<std::uint8_t, kPacketBytes> buffer_{};
  std::array<std::uint64_t, kPacketBytes> arrived_us_{};  // of every byte in the buffer
  std::size_t size_ = 0;
  std::uint32_t packets_ = 0;
  std::uint16_t errors_ = 0;

  Axes angle_{}, acceleration_{};
  Stamp packet_seen_, angle_seen_, acceleration_seen_, sample_seen_;

  ImuSample open_{};
  bool has_open_ = false, has_rate_ = false;
  std::uint64_t sample_us_ = 0, interval_us_ = 0;  // of the last complete sample; 0 = no interval known
  std::uint64_t next_us_ = 0;
  std::array<ImuSample, kMaxBurstSamples> gathered_{};
  std::uint8_t gathered_count_ = 0;

  Command command_ = Command::kUnlock;
  bool whole_set_ = true, looked_ = false, may_save_ = true;
  std::uint64_t command_us_ = kFirstCommandUs, set_us_ = 0;
};

}  // namespace brov
