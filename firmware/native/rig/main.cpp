// brov-rig: the rig's firmware core on this machine, in real time, on models of its servo boards and IMUs.
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <memory>
#include <poll.h>
#include <string>

#include "../endpoint.h"
#include "models.h"
#include "rig/board.h"

namespace {

using namespace brov;
using namespace brov::rig;

constexpr int kUsageError = 2;
constexpr std::uint64_t kTickUs = 1000, kPressUs = 100000;
constexpr std::uint32_t kBaud = 115200;

constexpr char kUsage[] =
    "usage: brov-rig --link PATH|auto [--imus MASK]\n"
    "\n"
    "--link   where frames go and come from (docs/rig-link.md); auto makes a pseudo terminal and prints its name\n"
    "--imus   which of the five IMUs answer, bit 0 the base's; default 31. Each reads 1 g on Z, up, and 25 degC\n"
    "SIGUSR1  is a press of the button. The rig starts paused and waits for one.\n"
    "SIGUSR2  cuts the servo boards' supply; once more: they come up as after power-on.\n";

volatile std::sig_atomic_t stop_requested = 0, presses = 0, supply_changes = 0;
void on_signal(int number) {
  if (number == SIGUSR1) {
    presses = presses + 1;
  } else if (number == SIGUSR2) {
    supply_changes = supply_changes + 1;
  } else {
    stop_requested = 1;
  }
}

std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1000000 + static_cast<std::uint64_t>(now.tv_nsec) / 1000;
}

class Machine final : private RigHal {
 public:
  Machine(const std::string& link, unsigned imus) : link_(link == "auto" ? "" : link, kBaud, Endpoint::Direction::kBoth) {
    for (std::size_t i = 0; i < RigModels::kImus; ++i) {
      models_.imu_answers[i] = (imus >> i & 1) != 0;
      models_.imus[i].set_raw({0, 0, -16384, -3920, 0, 0, 0});
    }
  }
  std::string make_pty() { return link_.make_pty(); }
  void run() {
    const std::uint64_t start_us = monotonic_us();
    while (stop_requested == 0) {
      const std::uint64_t now_us = monotonic_us() - start_us;
      link_.open_if_due(now_us);
      std::uint8_t bytes[1024];
      const std::size_t count = link_.read(bytes, sizeof bytes, now_us);
      if (count != 0) board_.receive({bytes, count});
      change_supply();
      press(now_us);
      board_.tick(now_us);
      pollfd input{link_.fd(), POLLIN, 0};
      ::poll(&input, link_.fd() >= 0 ? 1 : 0, kTickUs / 1000);
    }
  }

 private:
  bool link_write(Bytes frame, std::uint64_t) override { return link_.write(frame.data, frame.size) == frame.size; }
  I2cBus& i2c() override { return models_; }
  void select_imu(std::uint8_t imu) override { models_.selected_imu = imu; }
  bool button_down() override { return down_; }
  void set_lamp(bool lit) override {
    std::fprintf(stderr, "lamp %s\n", lit ? "on" : "off");
    std::fflush(stderr);
  }
  void press(std::uint64_t now_us) {
    if (down_ && now_us >= until_us_) {
      down_ = false;
      until_us_ = now_us + kPressUs;
    } else if (!down_ && now_us >= until_us_ && pressed_ != presses) {
      down_ = true;
      pressed_ = pressed_ + 1;
      until_us_ = now_us + kPressUs;
    }
  }
  void change_supply() {
    if (changed_ == supply_changes) return;
    changed_ = changed_ + 1;
    const bool on = changed_ % 2 == 0;
    models_.board_answers = {on, on};
    for (Pca9685Model& board : models_.boards) board.power_on();
  }

  Endpoint link_;
  RigModels models_;
  bool down_ = false;
  std::uint64_t until_us_ = 0;
  std::sig_atomic_t pressed_ = 0, changed_ = 0;
  RigBoard board_{*this};
};

int usage_error(const std::string& what) {
  std::fprintf(stderr, "brov-rig: %s\n%s", what.c_str(), kUsage);
  return kUsageError;
}

}  // namespace

int main(int count, char** arguments) {
  std::string link;
  unsigned imus = 31;
  if (count == 2 && std::strcmp(arguments[1], "--help") == 0) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  for (int i = 1; i < count; i += 2) {
    const std::string name = arguments[i];
    if (i + 1 == count) return usage_error(name + " needs a value");
    if (name == "--link") {
      link = arguments[i + 1];
    } else if (name != "--imus" || std::sscanf(arguments[i + 1], "%u", &imus) != 1 || imus > 31) {
      return usage_error("not understood: " + name + " " + arguments[i + 1]);
    }
  }
  if (link.empty()) return usage_error("--link is missing");
  struct sigaction action {};
  action.sa_handler = on_signal;
  for (const int number : {SIGINT, SIGTERM, SIGUSR1, SIGUSR2}) ::sigaction(number, &action, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  const auto machine = std::make_unique<Machine>(link, imus);
  if (link == "auto") {
    const std::string name = machine->make_pty();
    if (name.empty()) {
      std::perror("brov-rig: no pseudo terminal");
      return 1;
    }
    std::printf("%s\n", name.c_str());
    std::fflush(stdout);
  }
  machine->run();
  return 0;
}
