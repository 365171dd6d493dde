#include "lockstep.h"

#include <algorithm>
#include <array>
#include <deque>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "brov/board.h"
#include "i2c_models.h"
#include "paced_line.h"

namespace brov {

namespace {

constexpr std::uint64_t kTickUs = 1000;
constexpr int kMalformed = 2;
constexpr std::size_t kPorts = 6;

enum class Sink : std::uint8_t { kLink = 0, kLinkBaud = 16, kSettings = 17, kI2cRecovery = 18 };

// Outputs of the board as messages, gathered until the run is over.
class Outputs {
 public:
  void put(std::uint8_t sink, std::uint64_t at_us, Bytes data) {
    number('O', 1);
    number(sink, 1);
    number(at_us, 8);
    number(data.size, 2);
    buffer_.insert(buffer_.end(), data.data, data.data + data.size);
    ends_run_ = ends_run_ || sink != static_cast<std::uint8_t>(Sink::kLink);
  }
  // Whether anything but frames for the host came since the last call.
  bool take_ends_run() {
    const bool ends = ends_run_;
    ends_run_ = false;
    return ends;
  }
  void done(std::uint64_t reached_us, std::FILE* out) {
    number('D', 1);
    number(reached_us, 8);
    std::fwrite(buffer_.data(), 1, buffer_.size(), out);
    std::fflush(out);
    buffer_.clear();
  }

 private:
  void number(std::uint64_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) buffer_.push_back(static_cast<std::uint8_t>(value >> 8 * i));
  }

  std::vector<std::uint8_t> buffer_;
  bool ends_run_ = false;
};

class LockstepHal final : public Hal, private I2cModels::Listener {
 public:
  void restart(std::uint32_t baud, std::uint64_t now_us) {
    line_.set_baud(baud, now_us);
    models_.time_restarts();
  }
  void set_time(std::uint64_t now_us) {
    now_us_ = now_us;
    models_.set_time(now_us);
  }
  I2cModels& models() { return models_; }
  Outputs& outputs() { return outputs_; }

  void link_write(Bytes frame, std::uint64_t now_us) override {
    line_.write(frame.size, now_us);
    put(Sink::kLink, frame);
  }
  std::uint32_t link_backlog(std::uint64_t now_us) override { return line_.backlog(now_us); }
  void link_set_baud(std::uint32_t baud, std::uint64_t now_us) override {
    line_.set_baud(baud, now_us);
    std::uint8_t bytes[4];
    put_u32(bytes, baud);
    put(Sink::kLinkBaud, Bytes(bytes, sizeof bytes));
  }
  void port_write(Port port, Bytes data, std::uint64_t) override {
    outputs_.put(static_cast<std::uint8_t>(port), now_us_, data);
  }
  I2cBus& i2c() override { return models_; }
  void save_settings(const Settings& settings) override {
    std::uint8_t bytes[9];
    put_u32(bytes, settings.sensors_rate_mhz);
    put_u32(bytes + 4, settings.imu_rate_mhz);
    bytes[8] = settings.decimation;
    put(Sink::kSettings, Bytes(bytes, sizeof bytes));
  }

 private:
  void i2c_recovered() override { put(Sink::kI2cRecovery, {}); }
  void put(Sink sink, Bytes data) { outputs_.put(static_cast<std::uint8_t>(sink), now_us_, data); }

  PacedLine line_{kRomBaud};
  I2cModels models_{*this};
  Outputs outputs_;
  std::uint64_t now_us_ = 0;
};

// Bytes that arrive, and news for the I2C devices, each at its time.
struct Feed {
  std::uint64_t at_us;
  std::vector<std::uint8_t> bytes;
};
struct I2cNews {
  std::uint64_t at_us;
  std::uint8_t what;
  std::vector<std::uint8_t> bytes;
};

// What the messages are about, without their encoding.
class Lockstep {
 public:
  bool booted() const { return board_.has_value(); }
  void boot(const Settings& settings, const BootInfo& info);
  bool feed(Port port, std::uint64_t at_us, std::vector<std::uint8_t> bytes);
  bool tell_i2c(std::uint8_t what, std::uint64_t at_us, std::vector<std::uint8_t> bytes);
  void run(std::uint64_t until_us, std::FILE* out);

 private:
  void tick(std::uint64_t now_us);
  void apply(const I2cNews& news);

  LockstepHal hal_;
  std::optional<Board> board_;
  std::uint64_t next_tick_us_ = 0;
  std::array<std::deque<Feed>, kPorts> feeds_;
  std::array<std::uint64_t, kPorts> fed_us_{};
  std::deque<I2cNews> news_;
};

void Lockstep::boot(const Settings& settings, const BootInfo& info) {
  for (const I2cNews& news : news_) apply(news);  // their times belong to the timer that ends here
  news_.clear();
  for (auto& waiting : feeds_) waiting.clear();
  fed_us_ = {};
  hal_.restart(settings.baud, info.boot_us);
  next_tick_us_ = (info.boot_us / kTickUs + 1) * kTickUs;
  board_.emplace(hal_, settings, info);
}

bool Lockstep::feed(Port port, std::uint64_t at_us, std::vector<std::uint8_t> bytes) {
  const auto index = static_cast<std::size_t>(port);
  if (at_us < fed_us_[index]) return false;
  fed_us_[index] = at_us;
  feeds_[index].push_back({at_us, std::move(bytes)});
  return true;
}

bool Lockstep::tell_i2c(std::uint8_t what, std::uint64_t at_us, std::vector<std::uint8_t> bytes) {
  static constexpr std::size_t kSizes[] = {14, 16, 8, 4, 1};
  if (what >= std::size(kSizes) || bytes.size() != kSizes[what]) return false;
  if (what == 4 && bytes[0] > static_cast<std::uint8_t>(BusState::kHeldLow)) return false;
  const auto later = [](std::uint64_t at, const I2cNews& news) { return at < news.at_us; };
  const auto place = std::upper_bound(news_.begin(), news_.end(), at_us, later);
  news_.insert(place, I2cNews{at_us, what, std::move(bytes)});
  return true;
}

void Lockstep::run(std::uint64_t until_us, std::FILE* out) {
  std::uint64_t reached_us = until_us;
  while (next_tick_us_ <= until_us) {
    const std::uint64_t now_us = next_tick_us_;
    next_tick_us_ += kTickUs;
    tick(now_us);
    if (hal_.outputs().take_ends_run()) {
      reached_us = now_us;
      break;
    }
  }
  hal_.outputs().done(reached_us, out);
}

void Lockstep::tick(std::uint64_t now_us) {
  hal_.set_time(now_us);
  for (; !news_.empty() && news_.front().at_us <= now_us; news_.pop_front()) apply(news_.front());
  for (std::size_t port = 0; port < kPorts; ++port) {
    auto& waiting = feeds_[port];
    for (; !waiting.empty() && waiting.front().at_us <= now_us; waiting.pop_front()) {
      const std::vector<std::uint8_t>& bytes = waiting.front().bytes;
      board_->receive(static_cast<Port>(port), Bytes(bytes.data(), bytes.size()));
    }
  }
  board_->tick(now_us);
}

void Lockstep::apply(const I2cNews& news) {
  I2cModels& models = hal_.models();
  const std::uint8_t* bytes = news.bytes.data();
  switch (news.what) {
    case 0:
      for (std::size_t i = 0; i < 7; ++i) models.ms5837().set_prom_word(i, get_u16(bytes + 2 * i));
      break;
    case 1:
      for (std::size_t i = 0; i < 8; ++i) models.tsys01().set_prom_word(i, get_u16(bytes + 2 * i));
      break;
    case 2:
      for (std::size_t i = 0; i < 2; ++i) models.ms5837().set_value(i, get_u32(bytes + 4 * i));
      break;
    case 3: models.tsys01().set_value(0, get_u32(bytes)); break;
    default: models.set_state(static_cast<BusState>(bytes[0])); break;
  }
}

// Fields of a message, one behind the other; `ok` is false from the first one that is cut off.
class Fields {
 public:
  explicit Fields(std::FILE* in) : in_(in) {}
  bool ok() const { return ok_; }
  template <typename Integer>
  Integer number() {
    const std::vector<std::uint8_t> raw = bytes(sizeof(Integer));
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < raw.size(); ++i) value |= std::uint64_t{raw[i]} << 8 * i;
    return static_cast<Integer>(value);
  }
  std::vector<std::uint8_t> bytes(std::size_t count) {
    std::vector<std::uint8_t> read(count);
    ok_ = ok_ && std::fread(read.data(), 1, count, in_) == count;
    return read;
  }

 private:
  std::FILE* in_;
  bool ok_ = true;
};

// Each takes one message; an explanation of what is wrong with it, or null.
const char* take_boot(Fields& fields, Lockstep& lockstep) {
  Settings settings;
  BootInfo info;
  info.boot_us = fields.number<std::uint64_t>();
  info.boot_count = fields.number<std::uint16_t>();
  info.reset_reason = fields.number<std::uint8_t>();
  settings.baud = fields.number<std::uint32_t>();
  settings.sensors_rate_mhz = fields.number<std::uint32_t>();
  settings.imu_rate_mhz = fields.number<std::uint32_t>();
  settings.decimation = fields.number<std::uint8_t>();
  const auto coding = fields.number<std::uint8_t>();
  if (!fields.ok()) return nullptr;
  const std::uint32_t values[] = {settings.sensors_rate_mhz, settings.imu_rate_mhz, settings.decimation, settings.baud};
  for (std::uint8_t key = 1; key <= std::size(values); ++key) {
    if (!config_allowed(key, values[key - 1])) return "a setting out of its range";
  }
  if (coding > static_cast<std::uint8_t>(Coding::kCoded)) return "no such coding";
  settings.coding = static_cast<Coding>(coding);
  lockstep.boot(settings, info);
  return nullptr;
}

const char* take_feed(Fields& fields, Lockstep& lockstep) {
  const auto port = fields.number<std::uint8_t>();
  const auto at_us = fields.number<std::uint64_t>();
  std::vector<std::uint8_t> bytes = fields.bytes(fields.number<std::uint16_t>());
  if (!fields.ok()) return nullptr;
  if (port >= kPorts) return "no such port";
  return lockstep.feed(static_cast<Port>(port), at_us, std::move(bytes)) ? nullptr : "time went back";
}

const char* take_i2c(Fields& fields, Lockstep& lockstep) {
  const auto what = fields.number<std::uint8_t>();
  const auto at_us = fields.number<std::uint64_t>();
  std::vector<std::uint8_t> bytes = fields.bytes(fields.number<std::uint8_t>());
  if (!fields.ok()) return nullptr;
  return lockstep.tell_i2c(what, at_us, std::move(bytes)) ? nullptr : "no such I2C news of this length";
}

const char* take_run(Fields& fields, Lockstep& lockstep, std::FILE* out) {
  const auto until_us = fields.number<std::uint64_t>();
  if (!fields.ok()) return nullptr;
  if (!lockstep.booted()) return "not booted yet";
  lockstep.run(until_us, out);
  return nullptr;
}

}  // namespace

int run_lockstep(std::FILE* in, std::FILE* out, std::FILE* errors) {
  const auto lockstep = std::make_unique<Lockstep>();
  for (int letter; (letter = std::fgetc(in)) != EOF;) {
    Fields fields(in);
    const char* wrong = nullptr;
    switch (letter) {
      case 'B': wrong = take_boot(fields, *lockstep); break;
      case 'F': wrong = take_feed(fields, *lockstep); break;
      case 'I': wrong = take_i2c(fields, *lockstep); break;
      case 'R': wrong = take_run(fields, *lockstep, out); break;
      default: wrong = "no such message";
    }
    if (!fields.ok()) wrong = "cut off";
    if (wrong != nullptr) {
      std::fprintf(errors, "brov-firmware: message 0x%02x: %s\n", static_cast<unsigned>(letter), wrong);
      return kMalformed;
    }
  }
  return 0;
}

}  // namespace brov
