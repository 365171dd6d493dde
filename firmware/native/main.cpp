// brov-firmware: the core of the ESP32's firmware on this machine.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <string>

#include "lockstep.h"
#include "real_time.h"

namespace {

constexpr int kUsageError = 2;

constexpr char kUsage[] =
    "usage: brov-firmware --lockstep\n"
    "       brov-firmware --link PATH|auto [--a PATH] [--b PATH] [--imu PATH] [--gps PATH] [--ec PATH]\n"
    "                     [--baud 115200|921600] [--pressure-pa P] [--temperature-degc T]\n"
    "\n"
    "--lockstep   virtual time over stdin and stdout (docs/firmware-core.md, section 7)\n"
    "--link       where AA55 frames go and commands come from; auto makes a pseudo terminal and prints its name\n"
    "--a ... --ec ptys, FIFOs or serial devices of the two sonars and the sensors; what is not named is silent\n"
    "--pressure-pa, --temperature-degc\n"
    "             what the depth sensor (it needs both) and the temperature sensor read; without them they do not answer\n";

int usage_error(const std::string& what) {
  std::fprintf(stderr, "brov-firmware: %s\n%s", what.c_str(), kUsage);
  return kUsageError;
}

bool parse_number(const char* text, double& value) {
  char* end = nullptr;
  value = std::strtod(text, &end);
  return end != text && *end == '\0';
}

int run_with(int count, char** arguments) {
  brov::RealTimeOptions options;
  const std::map<std::string, std::string*> paths = {{"--link", &options.link}, {"--a", &options.sonar_a},
                                                     {"--b", &options.sonar_b}, {"--imu", &options.imu},
                                                     {"--gps", &options.gps},   {"--ec", &options.ec}};
  for (int i = 1; i < count; i += 2) {
    const std::string name = arguments[i];
    if (i + 1 == count) return usage_error(name + " needs a value");
    const char* value = arguments[i + 1];
    double number = 0.0;
    if (const auto path = paths.find(name); path != paths.end()) {
      *path->second = value;
    } else if (name == "--baud") {
      if (std::strcmp(value, "115200") != 0 && std::strcmp(value, "921600") != 0) return usage_error("no such baud rate");
      options.baud = static_cast<std::uint32_t>(std::atoi(value));
    } else if (name == "--pressure-pa" && parse_number(value, number)) {
      options.pressure_pa = number;
    } else if (name == "--temperature-degc" && parse_number(value, number)) {
      options.temperature_degc = number;
    } else {
      return usage_error("not understood: " + name + " " + value);
    }
  }
  if (options.link.empty()) return usage_error("--link is missing");
  if (options.pressure_pa && !options.temperature_degc) return usage_error("--pressure-pa needs --temperature-degc");
  return brov::run_real_time(options);
}

}  // namespace

int main(int count, char** arguments) {
  if (count == 2 && std::strcmp(arguments[1], "--lockstep") == 0) return brov::run_lockstep(stdin, stdout, stderr);
  if (count == 2 && std::strcmp(arguments[1], "--help") == 0) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  return run_with(count, arguments);
}
