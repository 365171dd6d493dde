// The whole board at its own pace, on a line of its baud rate, under any bytes at any time: SENSORS is never late or lost.
#include "brov/board.h"
#include "brov/checksums.h"
#include "fuzz_input.h"
#include "native/paced_line.h"

using namespace brov;

namespace {

constexpr std::uint64_t kTickUs = 1000, kFirstSensorsUs = 50000;
constexpr int kMostTicks = 20000;
constexpr std::size_t kDeviceMsAt = 5;
// While the rate changes only acknowledgements go, for as long as commands come.
constexpr std::uint64_t kBaudChangeUs = 1000000;

// Looks at every SENSORS on its way out.
class PacedHal final : public Hal {
 public:
  PacedHal(FuzzInput& input, const Settings& settings)
      : bus_(input), line_(settings.baud), baud_(settings.baud), rate_mhz_(settings.sensors_rate_mhz) {}

  void link_write(Bytes frame, std::uint64_t now_us) override {
    require(whole_frame_for_the_host(frame));
    if (frame[2] == 0x01) take_sensors(frame, now_us);
    line_.write(frame.size, now_us);
  }
  std::uint32_t link_backlog(std::uint64_t now_us) override { return line_.backlog(now_us); }
  void link_set_baud(std::uint32_t baud, std::uint64_t now_us) override {
    require(baud == 115200 || baud == 921600);
    line_.set_baud(baud, now_us);
    baud_ = baud;
  }
  void port_write(Port port, Bytes data, std::uint64_t) override {
    require(port != Port::kHost && port != Port::kGps && data.size > 0 && data.size <= 263);
  }
  I2cBus& i2c() override { return bus_; }
  void save_settings(const Settings& settings) override {
    require(config_allowed(1, settings.sensors_rate_mhz) && config_allowed(2, settings.imu_rate_mhz) &&
            config_allowed(3, settings.decimation));
    if (settings.sensors_rate_mhz == rate_mhz_) return;
    rate_mhz_ = settings.sensors_rate_mhz;
    changed_us_ = now_us_;
    due_us_ = now_us_ + period_us();
  }
  void set_time(std::uint64_t now_us) { now_us_ = now_us; }
  void host_spoke() { host_until_us_ = now_us_ + kBaudChangeUs; }
  // Between two ticks: whether the next SENSORS should have come long ago.
  void check() const {
    if (now_us_ > host_until_us_) require(now_us_ <= due_us_ + kTickUs + window_us());
  }

 private:
  std::uint64_t period_us() const { return 1000000000u / rate_mhz_; }
  // The line's window of 552 bytes; of 230 at 115200 baud, where the longest other frame of a sonar, 273 bytes, is more.
  std::uint64_t window_us() const { return baud_ == 115200 ? 23700 : 6000; }

  void take_sensors(Bytes frame, std::uint64_t now_us) {
    const std::uint64_t built_us = get_u32(frame.data + kDeviceMsAt) * std::uint64_t{1000};
    require(built_us > built_us_ && built_us <= now_us);
    // In the first tick at or behind its time, which does not drift; what was built before the rate changed may follow.
    if (built_us > changed_us_) {
      require(built_us >= due_us_ && built_us < due_us_ + kTickUs);
      due_us_ += period_us();
    }
    built_us_ = built_us;
    if (now_us <= host_until_us_) return;
    const std::uint64_t starts_us = now_us + line_.backlog(now_us) * std::uint64_t{10000000} / baud_;
    require(starts_us <= built_us + window_us());
  }

  FuzzBus bus_;
  PacedLine line_;
  std::uint32_t baud_, rate_mhz_;
  std::uint64_t now_us_ = 0, due_us_ = kFirstSensorsUs;
  std::uint64_t built_us_ = 0, changed_us_ = 0, host_until_us_ = 0;
};

// A whole BB55 frame of a sonar, which bytes at random hardly ever are: charts, one behind another, or anything else.
void receive_frame(Board& board, FuzzInput& input) {
  const std::uint8_t choice = input.byte();
  const Port port = (choice & 1) != 0 ? Port::kSonarA : Port::kSonarB;
  const bool chart = (choice & 2) != 0;
  std::uint8_t frame[263] = {0xBB, 0x55, 0, 1, chart ? kKoggerChartId : choice, input.byte()};
  const std::size_t size = frame[5];
  const Bytes given = input.batch();
  for (std::size_t i = 0; i < size; ++i) frame[6 + i] = i < given.size ? given[i] : static_cast<std::uint8_t>(i * 37);
  for (int repeated = 1 + (choice >> 4); repeated > 0; --repeated) {
    const KoggerCheck check = kogger_mod256({frame + 2, size + 4});
    frame[6 + size] = check.c1;
    frame[7 + size] = check.c2;
    board.receive(port, {frame, size + 8});
    if (chart && size > 6) put_u16(frame + 6, static_cast<std::uint16_t>(get_u16(frame + 6) + size - 6));  // goes on
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  Settings settings;
  settings.baud = (input.byte() & 1) != 0 ? 115200 : 921600;
  settings.sensors_rate_mhz = 500u + input.word() % 19501u;
  settings.decimation = static_cast<std::uint8_t>(1 + input.byte() % 8);
  settings.coding = static_cast<Coding>(input.byte() % 3);
  PacedHal hal(input, settings);
  Board board(hal, settings, {0, 1, 1});
  std::uint64_t now_us = 0;
  for (int ticks = 0; !input.empty() && ticks < kMostTicks;) {
    const std::uint8_t what = input.byte();
    if (what < 128) {
      if (what % 6 == 0) hal.host_spoke();
      board.receive(static_cast<Port>(what % 6), input.batch());
    } else {
      receive_frame(board, input);
    }
    for (int pause = input.byte() % 128; pause >= 0; --pause, ++ticks) {
      now_us += kTickUs;
      hal.set_time(now_us);
      board.tick(now_us);
      hal.check();
    }
  }
  return 0;
}
