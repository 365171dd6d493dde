// The sensor readers as a filter: timed batches in as text lines, everything they say out, to compare with Python.
//
//   start BOOT            a new board that booted then
//   imu NOW RATE HEX      bytes of the IMU               gps NOW HEX    ec NOW HEX
//   jobs NOW RATE         configuration of IMU and EC probe, GPS silence
//   rate                  the board was told another IMU rate
//   i2c NOW ANSWERS...    one tick of both devices; answers of the bus in order: A acknowledged, N not, hex bytes read
//   fill NOW              all fields of SENSORS, counters, and the bits of the TSYS01's double
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>

#include "brov/sensors.h"
#include "hex.h"

using namespace brov;

namespace {

class PrintingSink final : public ReportSink {
 public:
  void imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count) override {
    std::printf("burst %" PRIu32 " %" PRIu32, t0_us, dt_us);
    for (std::size_t i = 0; i < count; ++i) {
      for (const auto& axes : {samples[i].acceleration, samples[i].angular_rate, samples[i].magnetic_field}) {
        std::printf(" %d %d %d", axes[0], axes[1], axes[2]);
      }
    }
    std::printf("\n");
  }
  void gps_report(const GpsFields& r) override {
    std::printf("gps %" PRIu32 " %d %d %d %" PRId32 " %" PRId32 " %" PRId32 " %d %d %" PRIu64 "\n", r.t_us, r.fix,
                r.satellites, r.hdop_x100, r.latitude_e7, r.longitude_e7, r.altitude_mm, r.speed_cmps, r.course_cdeg,
                r.utc_ms);
  }
};

class ScriptedBus final : public I2cBus {
 public:
  void script(std::istream& answers) { answers_ = &answers; }
  bool write(std::uint8_t address, Bytes data) override {
    std::printf("write %d %s\n", address, to_hex(data).c_str());
    return next() == "A";
  }
  bool read(std::uint8_t address, std::uint8_t* into, std::size_t count) override {
    std::printf("read %d %zu\n", address, count);
    const std::string answer = next();
    if (answer == "N") {
      return false;
    }
    const Buffer bytes = unhex(answer);
    std::memcpy(into, bytes.data(), bytes.size() < count ? bytes.size() : count);
    return true;
  }
  void recover() override { std::printf("recover\n"); }

 private:
  std::string next() {
    std::string answer = "N";
    if (!(*answers_ >> answer)) {
      std::printf("no answer left\n");
    }
    return answer;
  }

  std::istream* answers_ = nullptr;
};

class PrintingHal final : public Hal {
 public:
  explicit PrintingHal(I2cBus& bus) : bus_(bus) {}
  void link_write(Bytes, std::uint64_t) override {}
  std::uint32_t link_backlog(std::uint64_t) override { return 0; }
  void link_set_baud(std::uint32_t, std::uint64_t) override {}
  void port_write(Port port, Bytes data, std::uint64_t now_us) override {
    std::printf("port %d %" PRIu64 " %s\n", static_cast<int>(port), now_us, to_hex(data).c_str());
  }
  I2cBus& i2c() override { return bus_; }
  void save_settings(const Settings&) override {}

 private:
  I2cBus& bus_;
};

struct Readers {
  explicit Readers(I2cBus& i2c, std::uint64_t boot_us) : bus(i2c) {
    imu.start(boot_us);
    ec.start(boot_us);
    depth.start(boot_us);
    celsius.start(boot_us);
  }
  WitMotionReader imu;
  NmeaReader gps;
  EzoEcReader ec;
  CountedBus bus;
  Ms5837 depth;
  Tsys01 celsius;
};

void print_fields(const Readers& readers, std::uint64_t now_us) {
  SensorFields f;
  readers.imu.fill(f, now_us);
  readers.gps.fill(f, now_us);
  readers.ec.fill(f, now_us);
  readers.depth.fill(f, now_us);
  readers.celsius.fill(f, now_us);
  fill_derived(f, readers.ec, readers.depth, readers.celsius, now_us);
  std::uint8_t payload[kSensorsBytes];
  pack_sensors(f, payload);
  std::uint64_t bits = 0;
  const double temperature_degc = readers.celsius.temperature_degc();
  std::memcpy(&bits, &temperature_degc, sizeof bits);
  std::printf("fields %s %d %d %d %d %016" PRIx64 "\n", to_hex({payload, sizeof payload}).c_str(), readers.imu.errors(),
              readers.gps.errors(), readers.ec.errors(), readers.bus.errors(), bits);
}

}  // namespace

int main() {
  PrintingSink sink;
  ScriptedBus bus;
  PrintingHal hal(bus);
  auto readers = std::make_unique<Readers>(bus, 0);
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string what, hex;
    std::uint64_t now_us = 0;
    std::uint32_t rate_mhz = 0;
    words >> what >> now_us;
    if (what == "start") {
      readers = std::make_unique<Readers>(bus, now_us);
    } else if (what == "imu") {
      words >> rate_mhz >> hex;
      const Buffer bytes = unhex(hex);
      readers->imu.feed(view(bytes), now_us, rate_mhz, sink);
    } else if (what == "gps") {
      words >> hex;
      const Buffer bytes = unhex(hex);
      readers->gps.feed(view(bytes), now_us, sink);
    } else if (what == "ec") {
      words >> hex;
      const Buffer bytes = unhex(hex);
      readers->ec.feed(view(bytes), now_us);
    } else if (what == "jobs") {
      words >> rate_mhz;
      readers->imu.configure(now_us, rate_mhz, hal);
      readers->ec.configure(now_us, hal);
      readers->gps.tick(now_us, sink);
    } else if (what == "rate") {
      readers->imu.rate_changed();
    } else if (what == "i2c") {
      bus.script(words);
      readers->depth.tick(now_us, readers->bus);
      readers->celsius.tick(now_us, readers->bus);
      if (words >> hex) {
        std::printf("answer not asked for\n");
      }
    } else if (what == "fill") {
      print_fields(*readers, now_us);
    } else {
      std::fprintf(stderr, "unknown: %s\n", line.c_str());
      return 1;
    }
  }
  return 0;
}
