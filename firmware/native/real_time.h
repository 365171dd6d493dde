// The board in real time between pseudo terminals, FIFOs or serial devices.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace brov {

struct RealTimeOptions {
  std::string link;  // "auto" makes a pseudo terminal
  std::string sonar_a, sonar_b, imu, gps, ec;  // empty: nothing connected
  std::uint32_t baud = 115200;
  std::optional<double> pressure_pa;  // none: the sensor does not answer
  std::optional<double> temperature_degc;
};

// Until SIGINT or SIGTERM; counters on stderr at the end. Returns the exit code.
int run_real_time(const RealTimeOptions& options);

}  // namespace brov
