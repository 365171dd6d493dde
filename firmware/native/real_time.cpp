#include "real_time.h"

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <memory>
#include <poll.h>
#include <vector>

#include "brov/board.h"
#include "endpoint.h"
#include "fixed_readings.h"
#include "i2c_models.h"
#include "paced_line.h"

namespace brov {

namespace {

volatile std::sig_atomic_t stop_requested = 0;
void request_stop(int) { stop_requested = 1; }

std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1000000 + static_cast<std::uint64_t>(now.tv_nsec) / 1000;
}

// Catches SIGINT and SIGTERM, but only while the loop sleeps, so that none comes between looking and sleeping.
class StopSignals {
 public:
  StopSignals() {
    struct sigaction action {};
    action.sa_handler = request_stop;
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
    ::signal(SIGPIPE, SIG_IGN);
    sigset_t stops;
    ::sigemptyset(&stops);
    ::sigaddset(&stops, SIGINT);
    ::sigaddset(&stops, SIGTERM);
    ::sigprocmask(SIG_BLOCK, &stops, &while_sleeping_);
  }
  const sigset_t& while_sleeping() const { return while_sleeping_; }

 private:
  sigset_t while_sleeping_{};
};

// The link: what was handed over leaves at the pace of the baud rate, whether or not somebody reads it.
class PacedLink {
 public:
  PacedLink(const std::string& path, std::uint32_t baud)
      : endpoint_(path == "auto" ? "" : path, baud, Endpoint::Direction::kBoth), line_(baud) {}

  Endpoint& endpoint() { return endpoint_; }
  void hand_over(Bytes frame, std::uint64_t now_us) {
    line_.write(frame.size, now_us);
    waiting_.insert(waiting_.end(), frame.data, frame.data + frame.size);
  }
  std::uint32_t backlog(std::uint64_t now_us) const { return line_.backlog(now_us); }
  void set_baud(std::uint32_t baud, std::uint64_t now_us) {
    push(waiting_.size());
    line_.set_baud(baud, now_us);
    endpoint_.set_baud(baud);
  }
  void send_due(std::uint64_t now_us) {
    const std::size_t in_line = line_.backlog(now_us);
    if (in_line < waiting_.size()) push(waiting_.size() - in_line);
  }
  std::uint64_t bytes_lost() const { return bytes_lost_; }

 private:
  void push(std::size_t count) {
    bytes_lost_ += count - endpoint_.write(waiting_.data(), count);
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(count));
  }

  Endpoint endpoint_;
  PacedLine line_;
  std::vector<std::uint8_t> waiting_;
  std::uint64_t bytes_lost_ = 0;
};

class RealTime final : private Hal, private I2cModels::Listener {
 public:
  explicit RealTime(const RealTimeOptions& options)
      : link_(options.link, options.baud),
        sonar_a_(options.sonar_a, kSonarBaud, Endpoint::Direction::kIn),
        sonar_b_(options.sonar_b, kSonarBaud, Endpoint::Direction::kIn),
        imu_(options.imu, kSensorBaud, Endpoint::Direction::kIn),
        gps_(options.gps, kSensorBaud, Endpoint::Direction::kIn),
        ec_(options.ec, kSensorBaud, Endpoint::Direction::kIn),
        started_us_(monotonic_us()),
        board_(*this, settings_of(options), BootInfo{}) {
    set_fixed_readings(models_, options.pressure_pa, options.temperature_degc);
  }

  std::string make_pty() { return link_.endpoint().make_pty(); }
  void run(const StopSignals& signals);
  void report() const;

 private:
  static Settings settings_of(const RealTimeOptions& options) {
    Settings settings;
    settings.baud = options.baud;
    return settings;
  }
  std::uint64_t now_us() const { return monotonic_us() - started_us_; }
  Endpoint& endpoint(Port port) { return *endpoints_[static_cast<std::size_t>(port)]; }
  void take(Port port, std::uint64_t now_us);
  void sleep_until(std::uint64_t wanted_us, const StopSignals& signals);

  void link_write(Bytes frame, std::uint64_t now_us) override { link_.hand_over(frame, now_us); }
  std::uint32_t link_backlog(std::uint64_t now_us) override { return link_.backlog(now_us); }
  void link_set_baud(std::uint32_t baud, std::uint64_t now_us) override { link_.set_baud(baud, now_us); }
  void port_write(Port port, Bytes data, std::uint64_t) override { endpoint(port).write(data.data, data.size); }
  I2cBus& i2c() override { return models_; }
  void save_settings(const Settings&) override { ++settings_saved_; }
  void i2c_recovered() override { ++i2c_recoveries_; }

  PacedLink link_;
  Endpoint sonar_a_, sonar_b_, imu_, gps_, ec_;
  const std::array<Endpoint*, 6> endpoints_{&link_.endpoint(), &sonar_a_, &sonar_b_, &imu_, &gps_, &ec_};
  I2cModels models_{*this};
  std::uint64_t started_us_;
  std::uint64_t settings_saved_ = 0, i2c_recoveries_ = 0;
  std::array<std::uint64_t, 6> bytes_in_{};
  Board board_;
};

void RealTime::run(const StopSignals& signals) {
  while (stop_requested == 0) {
    const std::uint64_t now = now_us();
    for (Endpoint* input : endpoints_) input->open_if_due(now);
    for (std::size_t port = 0; port < endpoints_.size(); ++port) take(static_cast<Port>(port), now);
    models_.set_time(now);
    board_.tick(now);
    link_.send_due(now);
    sleep_until(board_.next_wanted_us(now), signals);
  }
}

void RealTime::take(Port port, std::uint64_t now_us) {
  std::uint8_t bytes[1024];
  const std::size_t count = endpoint(port).read(bytes, sizeof bytes, now_us);
  bytes_in_[static_cast<std::size_t>(port)] += count;
  if (count != 0) board_.receive(port, Bytes(bytes, count));
}

void RealTime::sleep_until(std::uint64_t wanted_us, const StopSignals& signals) {
  // Inputs need not wake the loop: no UART brings more in a millisecond than one read takes.
  const std::uint64_t now = now_us();
  const std::uint64_t left_us = wanted_us > now ? wanted_us - now : 0;
  const timespec timeout{static_cast<std::time_t>(left_us / 1000000), static_cast<long>(left_us % 1000000 * 1000)};
  ::ppoll(nullptr, 0, &timeout, &signals.while_sleeping());
}

void RealTime::report() const {
  const Transmitter& out = board_.transmitter();
  std::fprintf(stderr, "ran %.1f s; link at %u baud: %u bytes out, %llu of them not taken, %llu bytes in\n",
               static_cast<double>(now_us()) / 1e6, static_cast<unsigned>(out.baud()),
               static_cast<unsigned>(out.tx_bytes()), static_cast<unsigned long long>(link_.bytes_lost()),
               static_cast<unsigned long long>(bytes_in_[0]));
  for (const Channel channel : {Channel::kA, Channel::kB}) {
    const SonarPort& sonar = board_.sonar(channel);
    std::fprintf(stderr, "sonar %c: %u bytes, %u frames, %u bad, %u bytes lost, %u pings dropped\n",
                 channel == Channel::kA ? 'A' : 'B', static_cast<unsigned>(sonar.bytes()),
                 static_cast<unsigned>(sonar.packets()), static_cast<unsigned>(sonar.frame_errors()),
                 static_cast<unsigned>(sonar.overflow_bytes()), static_cast<unsigned>(out.queue().pings_dropped(channel)));
  }
  std::fprintf(stderr, "imu %llu bytes, gps %llu bytes, ec %llu bytes; %llu i2c recoveries, settings saved %llu times\n",
               static_cast<unsigned long long>(bytes_in_[3]), static_cast<unsigned long long>(bytes_in_[4]),
               static_cast<unsigned long long>(bytes_in_[5]), static_cast<unsigned long long>(i2c_recoveries_),
               static_cast<unsigned long long>(settings_saved_));
}

}  // namespace

int run_real_time(const RealTimeOptions& options) {
  const StopSignals signals;
  const auto real_time = std::make_unique<RealTime>(options);
  if (options.link == "auto") {
    const std::string name = real_time->make_pty();
    if (name.empty()) {
      std::perror("brov-firmware: no pseudo terminal");
      return 1;
    }
    std::printf("%s\n", name.c_str());
    std::fflush(stdout);
  }
  real_time->run(signals);
  real_time->report();
  return 0;
}

}  // namespace brov
