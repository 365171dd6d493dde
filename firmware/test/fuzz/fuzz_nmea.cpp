// Any bytes at any times into the reader of the GPS; half of the batches as the inside of a line with a good checksum.
#include <array>

#include "brov/checksums.h"
#include "brov/sensors.h"
#include "fuzz_input.h"

using namespace brov;

namespace {

constexpr std::uint16_t kUnknown = 0xFFFF;

class CheckedReports final : public ReportSink {
 public:
  void imu_burst(std::uint32_t, std::uint32_t, const ImuSample*, std::uint8_t) override { require(false); }
  void gps_report(const GpsFields& report) override {
    require(report.fix == 0 || report.fix == 2 || report.fix == 3);
    require(report.latitude_e7 >= -900000000 && report.latitude_e7 <= 900000000);
    require(report.longitude_e7 >= -1800000000 && report.longitude_e7 <= 1800000000);
    require(report.course_cdeg < 36000 || report.course_cdeg == kUnknown);
    require(report.utc_ms < 4102444800000u + 61000u);  // the end of 2099, with a leap second
    require(report.fix != 0 || (report.latitude_e7 == 0 && report.longitude_e7 == 0 && report.altitude_mm == 0 &&
                                report.speed_cmps == kUnknown && report.course_cdeg == kUnknown));
  }
};

void say_checked(NmeaReader& reader, Bytes body, std::uint64_t now_us, ReportSink& sink) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::array<std::uint8_t, 260> line{};
  std::size_t size = 0;
  line[size++] = '$';
  for (std::size_t i = 0; i < body.size; ++i) {
    line[size++] = body[i];
  }
  const std::uint8_t check = xor8(body);
  line[size++] = '*';
  line[size++] = static_cast<std::uint8_t>(kDigits[check >> 4]);
  line[size++] = static_cast<std::uint8_t>(kDigits[check & 15]);
  line[size++] = '\r';
  reader.feed({line.data(), size}, now_us, sink);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  CheckedReports sink;
  NmeaReader reader;
  std::uint64_t now_us = 0;
  while (!input.empty()) {
    now_us += input.pause_us();
    const bool checked = (input.byte() & 1) != 0;
    const Bytes batch = input.batch();
    if (checked) {
      say_checked(reader, batch, now_us, sink);
    } else {
      reader.feed(batch, now_us, sink);
    }
    reader.tick(now_us, sink);
    SensorFields fields;
    reader.fill(fields, now_us);
    require(fields.latitude_e7 >= -900000000 && fields.latitude_e7 <= 900000000);
    require(fields.gps_alive <= 1);
  }
  return 0;
}
