// Any bytes at any times into the reader of the IMU.
#include "brov/sensors.h"
#include "fuzz_input.h"

using namespace brov;

namespace {

class CheckedBursts final : public ReportSink {
 public:
  void imu_burst(std::uint32_t, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count) override {
    require(count >= 1 && count <= kMaxBurstSamples);
    for (std::size_t i = 1; i < count; ++i) {
      require(samples[i].time_us > samples[i - 1u].time_us);
    }
    require(count == 1 || (samples[count - 1u].time_us - samples[0].time_us) / (count - 1u) == dt_us);
  }
  void gps_report(const GpsFields&) override { require(false); }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  FuzzBus bus(input);
  FuzzHal<FuzzBus> hal(bus);
  CheckedBursts sink;
  WitMotionReader reader;
  const std::uint32_t rate_mhz = 1000u + input.word() % 19001u;
  reader.start(0);
  std::uint64_t now_us = 0;
  while (!input.empty()) {
    now_us += input.pause_us();
    reader.feed(input.batch(), now_us, rate_mhz, sink);
    reader.configure(now_us, rate_mhz, hal);
    SensorFields fields;
    reader.fill(fields, now_us);
    require(fields.roll_cdeg >= -18000 && fields.roll_cdeg <= 18000);
    require(fields.acceleration_mg[2] >= -16000 && fields.acceleration_mg[2] <= 16000);
  }
  return 0;
}
