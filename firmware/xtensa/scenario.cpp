#include "scenario.h"

#include <new>

#include "brov/board.h"
#include "crc32.h"
#include "line.h"
#include "machine.h"
#include "native/i2c_models.h"
#include "native/paced_line.h"

using namespace brov;

namespace {

constexpr std::uint64_t kTickUs = 1000;
constexpr std::size_t kOutputBytes = 16384;

// Keeps a tick's output until the tick has been measured.
class RunnerHal final : public Hal, private I2cModels::Listener {
 public:
  void restart(std::uint32_t baud) {
    line_.set_baud(baud, 0);
    models_.time_restarts();
    crc_ = Crc32();
    frames_ = writes_ = saves_ = 0;
    bytes_ = 0;
  }
  I2cModels& models() { return models_; }

  void link_write(Bytes frame, std::uint64_t now_us) override {
    line_.write(frame.size, now_us);
    ++frames_;
    bytes_ += frame.size;
    keep(frame);
  }
  std::uint32_t link_backlog(std::uint64_t now_us) override { return line_.backlog(now_us); }
  void link_set_baud(std::uint32_t baud, std::uint64_t now_us) override { line_.set_baud(baud, now_us); }
  void port_write(Port port, Bytes data, std::uint64_t) override {
    ++writes_;
    const auto number = static_cast<std::uint8_t>(port);
    keep({&number, 1});
    keep(data);
  }
  I2cBus& i2c() override { return models_; }
  void save_settings(const Settings&) override { ++saves_; }

  // The tick is over: its output, and when it was, into the checksum.
  void end_tick(std::uint64_t now_us) {
    if (kept_ == 0) return;
    std::uint8_t at[8];
    put_u64(at, now_us);
    crc_.add({at, sizeof at});
    crc_.add({output_, kept_});
    kept_ = 0;
  }
  void print(const char* name, std::uint64_t now_us) const {
    Line line;
    line.text(name).text(" at ").number(now_us / 1000).text(" ms: frames ").number(frames_).text(" bytes ").number(bytes_);
    line.text(" writes ").number(writes_).text(" saved ").number(saves_).text(" crc ").hex(crc_.value()).print();
  }

 private:
  void i2c_recovered() override {}
  void keep(Bytes data) {
    for (std::size_t i = 0; i < data.size && kept_ < kOutputBytes; ++i) output_[kept_++] = data[i];
  }

  PacedLine line_{kRomBaud};
  I2cModels models_{*this};
  Crc32 crc_;
  std::uint64_t bytes_ = 0;
  std::uint32_t frames_ = 0, writes_ = 0, saves_ = 0;
  std::uint8_t output_[kOutputBytes];
  std::size_t kept_ = 0;
};

// Instructions of the loop's passes in one scenario. A pass is a tick: what arrives is put into the rings elsewhere.
class Passes {
 public:
  void begin() { started_ = machine::instructions(); }
  void end(std::uint64_t now_us) {
    const std::uint32_t taken = machine::instructions() - started_;
    sum_ += taken;
    ++count_;
    if (taken <= worst_) return;
    worst_ = taken;
    worst_us_ = now_us;
  }
  void print(const char* name) const {
    Line line;
    line.text("passes ").text(name).text(" ").number(count_).text(" sum ").number(sum_).text(" worst ").number(worst_);
    line.text(" at_ms ").number(worst_us_ / 1000).text(" stack ").number(machine::stack_used()).print_measure();
  }

 private:
  std::uint32_t started_ = 0, worst_ = 0, count_ = 0;
  std::uint64_t sum_ = 0, worst_us_ = 0;
};

class Records {
 public:
  bool ok() const { return ok_; }
  int letter() {
    std::uint8_t byte;
    return machine::read_scenario(&byte, 1) == 1 ? byte : -1;
  }
  void bytes(std::uint8_t* into, std::size_t count) { ok_ = ok_ && machine::read_scenario(into, count) == count; }
  std::uint8_t u8() {
    std::uint8_t value = 0;
    bytes(&value, 1);
    return value;
  }
  std::uint16_t u16() {
    std::uint8_t value[2] = {};
    bytes(value, 2);
    return get_u16(value);
  }
  std::uint32_t u32() {
    std::uint8_t value[4] = {};
    bytes(value, 4);
    return get_u32(value);
  }

 private:
  bool ok_ = true;
};

void tell_i2c(I2cModels& models, std::uint8_t what, const std::uint8_t* bytes) {
  switch (what) {
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

// What happens now is measured but for reading records and checking output.
class Runner {
 public:
  void name(Records& records) {
    finish();
    const std::uint8_t size = records.u8();
    std::uint8_t text[256] = {};
    records.bytes(text, size);
    for (std::size_t i = 0; i < sizeof name_; ++i) name_[i] = static_cast<char>(i + 1 < sizeof name_ ? text[i] : 0);
  }
  void boot(Records& records) {
    Settings settings;
    settings.baud = records.u32();
    settings.decimation = records.u8();
    settings.coding = static_cast<Coding>(records.u8());
    if (board_ != nullptr) board_->~Board();
    hal_.restart(settings.baud);
    board_ = new (memory_) Board(hal_, settings, BootInfo{0, 7, 4});
    now_us_ = 0;
    passes_ = Passes();
    machine::mark_stack();
  }
  void feed(Records& records) {
    const auto port = static_cast<Port>(records.u8());
    const std::uint16_t size = records.u16();
    records.bytes(block_, size);
    if (records.ok()) board_->receive(port, {block_, size});
  }
  void i2c(Records& records) {
    const std::uint8_t what = records.u8();
    const std::uint8_t size = records.u8();
    std::uint8_t bytes[256];
    records.bytes(bytes, size);
    if (records.ok()) tell_i2c(hal_.models(), what, bytes);
  }
  void tick() {
    now_us_ += kTickUs;
    hal_.models().set_time(now_us_);
    passes_.begin();
    board_->tick(now_us_);
    passes_.end(now_us_);
    hal_.end_tick(now_us_);
    if (now_us_ % 500000 == 0) hal_.print(name_, now_us_);
  }
  void finish() {
    if (board_ == nullptr) return;
    hal_.print(name_, now_us_);
    passes_.print(name_);
  }
  bool booted() const { return board_ != nullptr; }

 private:
  char name_[64] = {};
  RunnerHal hal_;
  alignas(Board) unsigned char memory_[sizeof(Board)];
  Board* board_ = nullptr;
  std::uint64_t now_us_ = 0;
  Passes passes_;
  std::uint8_t block_[0x10000];
};

// How many of the counter's steps 200 000 instructions take.
void calibrate() {
  const std::uint32_t started = machine::instructions();
#ifdef __xtensa__
  std::uint32_t turns = 100000;
  asm volatile("1: addi.n %0, %0, -1\n bnez %0, 1b" : "+a"(turns));
#endif
  Line().text("steps_of_200000 ").number(machine::instructions() - started).print_measure();
  Line().text("board_bytes ").number(sizeof(Board)).print_measure();
}

Runner runner;

}  // namespace

bool run_scenarios() {
  calibrate();
  Records records;
  for (int letter; (letter = records.letter()) >= 0;) {
    if (letter != 'N' && letter != 'B' && !runner.booted()) return false;
    switch (letter) {
      case 'N': runner.name(records); break;
      case 'B': runner.boot(records); break;
      case 'F': runner.feed(records); break;
      case 'I': runner.i2c(records); break;
      case 'T': runner.tick(); break;
      default: return false;
    }
    if (!records.ok()) return false;
  }
  runner.finish();
  return runner.booted();
}
