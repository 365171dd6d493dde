// Depth sensor and thermometer on a bus that answers anything, and what follows from them and the conductivity probe.
#include "brov/sensors.h"
#include "fuzz_input.h"

using namespace brov;

namespace {

// Chance does not find a PROM whose check is good: these answers can be asked for.
constexpr std::uint16_t kDepthProm[7] = {0x3A2D, 34982, 36352, 20328, 22354, 26646, 26146};
constexpr std::uint16_t kCelsiusProm[8] = {0, 28446, 24926, 36016, 32791, 40781, 0x1A2B, 0x3C74};

class PromBus final : public I2cBus {
 public:
  explicit PromBus(FuzzInput& input) : input_(input), bus_(input) {}
  bool write(std::uint8_t address, Bytes data) override {
    code_ = data[0];
    return bus_.write(address, data);
  }
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override {
    if (code_ < 0xA0 || (input_.byte() & 63) == 63) {
      return bus_.read(address, into, count);
    }
    const std::size_t index = (code_ - 0xA0u) / 2;
    const std::uint16_t word = address == 0x76 ? kDepthProm[index] : kCelsiusProm[index];
    into[0] = static_cast<std::uint8_t>(word >> 8);
    into[1] = static_cast<std::uint8_t>(word);
    return true;
  }
  void recover() override {}

 private:
  FuzzInput& input_;
  FuzzBus bus_;
  std::uint8_t code_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  PromBus bus(input);
  CountedBus counted(bus);
  Ms5837 depth;
  Tsys01 celsius;
  EzoEcReader ec;
  depth.start(0);
  celsius.start(0);
  const std::uint8_t reading[] = {'*', 'O', 'K', '\r', '5', '3', '0', static_cast<std::uint8_t>('0' + input.byte() % 10), '0', '\r'};
  std::uint64_t now_us = 0;
  while (!input.empty()) {
    now_us += input.pause_us();
    ec.feed({reading, sizeof reading}, now_us);
    depth.tick(now_us, counted);
    celsius.tick(now_us, counted);
    SensorFields fields;
    depth.fill(fields, now_us);
    celsius.fill(fields, now_us);
    fill_derived(fields, ec, depth, celsius, now_us);
    require(fields.depth_ok == 0 || (fields.full_pressure_pa > 0 && fields.full_pressure_pa <= 3200000));
    require(fields.depth_ok == 1 || (fields.full_pressure_pa == 0xFFFFFF && fields.depth_cm == 0xFFFF));
    require(fields.depth_temperature_cdegc >= -2000 && fields.depth_temperature_cdegc <= 8500);
    require(fields.temperature_cdegc >= -4000 && fields.temperature_cdegc <= 12500);
    require(fields.sound_speed_dmps == 0xFFFF || (fields.sound_speed_dmps > 14000 && fields.sound_speed_dmps < 17000));
  }
  return 0;
}
