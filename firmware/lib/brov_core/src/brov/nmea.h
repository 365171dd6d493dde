// NMEA 0183 of a GPS receiver: GGA, RMC and GSA joined to one report a second. docs/firmware-core.md section 6.
#pragma once

#include <array>

#include "brov/readings.h"

namespace brov {

class NmeaReader {
 public:
  void feed(Bytes batch, std::uint64_t now_us, ReportSink& sink);
  void tick(std::uint64_t now_us, ReportSink& sink);  // reports that waited long enough for their other half
  void fill(SensorFields& fields, std::uint64_t now_us) const;
  std::uint16_t errors() const { return errors_; }

 private:
  struct Sentence;  // the fields of one line, in the .cpp
  static constexpr std::size_t kMaxLineBytes = 100;
  static constexpr std::size_t kMaxTimeBytes = 12;

  // What GGA and RMC of one instant have said so far.
  struct Pending {
    bool has_gga = false, has_rmc = false;
    bool gga_valid = false, rmc_valid = false, has_position = false, has_altitude = false;
    std::array<std::uint8_t, kMaxTimeBytes> time{};
    std::size_t time_size = 0;
    std::uint64_t since_us = 0;
    GpsFields fields{};
  };

  void end_line(std::uint64_t now_us, ReportSink& sink);
  void sentence(Bytes text, std::uint64_t now_us, ReportSink& sink);
  void join(Bytes time, bool is_gga, std::uint64_t now_us, ReportSink& sink);
  void take_gga(const Sentence& sentence);
  void take_rmc(const Sentence& sentence);
  void send(std::uint64_t now_us, ReportSink& sink);

  std::array<std::uint8_t, kMaxLineBytes> line_{};
  std::size_t size_ = 0;
  bool in_line_ = false;
  std::uint64_t line_us_ = 0;
  std::uint16_t errors_ = 0;

  Pending pending_{};
  std::uint8_t gsa_mode_ = 0;
  GpsFields report_{};
  Stamp gsa_seen_, sentence_seen_, report_seen_;
};

}  // namespace brov
