// A pretended ESP32 for the host's tests: its clock, tasks, UARTs, pins, I2C bus, flash and watchdog, in virtual time.
// The other files here have the names and signatures of the framework's headers and speak to the machine.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "native/i2c_models.h"

namespace fake {

// What a reboot does not forget.
struct Flash {
  std::map<std::string, std::uint32_t> values;  // "namespace/key"
  bool broken = false;
};

// Bytes on a wire, each with the instant at which it began.
struct WireByte {
  std::uint64_t start_ns;
  std::uint32_t baud;
  std::uint8_t value;
};

// A UART with its driver, and the wires at it.
class Uart {
 public:
  static constexpr std::size_t kFifoBytes = 128, kRefillAt = 10;

  // What the test sees and does.
  const std::vector<WireByte>& sent() const { return sent_; }
  void arrive(const std::vector<std::uint8_t>& bytes, std::uint64_t from_us, std::uint32_t baud);
  std::size_t bytes_lost() const { return bytes_lost_; }
  std::uint32_t baud() const { return baud_; }

  // What the driver's functions do.
  void install(std::size_t receive_capacity, std::size_t transmit_capacity);
  void set_pins(int rx, int tx) { rx_pin = rx, tx_pin = tx; }
  // What is on its way when the rate changes goes on at the new one.
  void set_baud(std::uint32_t baud, std::uint64_t now_us);
  std::size_t take(std::uint8_t* into, std::size_t most, std::uint64_t now_us);
  std::size_t room_in_fifo(std::uint64_t now_us) const { return kFifoBytes - in_fifo(now_us); }
  std::size_t in_fifo(std::uint64_t now_us) const;
  bool shifting(std::uint64_t now_us) const;
  std::uint64_t refill_us() const;  // when no more than kRefillAt bytes are left
  void push(std::uint8_t value, std::uint64_t now_us);
  bool installed() const { return receive_capacity_ != 0; }
  std::size_t transmit_capacity() const { return transmit_capacity_; }

  int rx_pin = -1, tx_pin = -1;
  int rx_threshold = 120;
  int installed_on_core = -1;

 private:
  std::uint32_t baud_ = 0;
  std::size_t receive_capacity_ = 0, transmit_capacity_ = 0;
  std::vector<WireByte> sent_;
  std::uint64_t free_ns_ = 0;
  std::vector<WireByte> coming_;
  std::size_t taken_ = 0;
  std::size_t bytes_lost_ = 0;
};

struct TaskEnded {};

class Task {
 public:
  std::string name;
  int core = 1;
  int priority = 1;
  bool watched = false;
  std::uint64_t fed_us = 0;

 private:
  friend class Machine;
  std::thread thread_;
  std::condition_variable turn_;
  std::uint64_t wake_us_ = 0;
  bool waits_for_notice_ = false;
  std::uint32_t notices_ = 0;
};

// One at a time is the current one; its end ends its tasks. The thread that makes it is the loop's task.
class Machine final : private brov::I2cModels::Listener {
 public:
  explicit Machine(Flash& flash, int reset_reason = 1);
  ~Machine();
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;
  static Machine& current();

  std::uint64_t now_us() const { return now_us_; }
  void sleep_until(std::uint64_t us);
  void spend(std::uint64_t us) { sleep_until(now_us_ + us); }

  // Tasks.
  Task* create_task(const char* name, int priority, int core, std::function<void()> body);
  Task& running() { return *running_; }
  void notify(Task& task);
  std::uint32_t take_notice(std::uint64_t until_us);
  const std::vector<std::unique_ptr<Task>>& tasks() const { return tasks_; }

  // Watchdog.
  void watch(std::uint32_t timeout_s) { watchdog_us_ = std::uint64_t{timeout_s} * 1000000; }
  void feed();
  bool watchdog_bites() const;
  std::uint64_t longest_unfed_us() const { return longest_unfed_us_; }

  // Pins.
  void pin_mode(int pin, int mode) { modes_[pin] = mode; }
  void write_pin(int pin, bool high);
  bool read_pin(int pin) const;
  int mode(int pin) const { return modes_.count(pin) ? modes_.at(pin) : -1; }
  struct Edge {
    std::uint64_t at_us;
    bool high;
  };
  const std::vector<Edge>& edges(int pin) { return edges_[pin]; }

  // The I2C bus. A device that is in the middle of a byte holds SDA down until it has had so many clocks.
  brov::I2cModels& i2c() { return i2c_; }
  void hold_sda_for(int clocks) { clocks_to_free_ = clocks; }
  void set_i2c_hangs(bool hangs) { i2c_hangs_ = hangs; }  // the lines look free, but nothing ever ends
  bool i2c_blocked() const { return clocks_to_free_ > 0; }
  bool i2c_hangs() const { return i2c_hangs_; }

  Uart& uart(int number) { return uarts_[number]; }
  Uart& software_uart(int rx_pin) { return software_uarts_[rx_pin]; }
  Flash& flash() { return flash_; }
  int reset_reason() const { return reset_reason_; }

 private:
  void i2c_recovered() override {}
  void hand_over(std::unique_lock<std::mutex>& lock, Task& from);
  void body(Task& task, const std::function<void()>& run);

  Flash& flash_;
  int reset_reason_;
  std::uint64_t now_us_ = 250000;  // the boot loader took that long
  std::mutex mutex_;
  std::vector<std::unique_ptr<Task>> tasks_;
  Task* running_;
  bool ending_ = false;

  std::uint64_t watchdog_us_ = 0, longest_unfed_us_ = 0;
  std::map<int, int> modes_;
  std::map<int, bool> levels_;
  std::map<int, std::vector<Edge>> edges_;
  int clocks_to_free_ = 0;
  bool i2c_hangs_ = false;
  brov::I2cModels i2c_{*this};
  std::map<int, Uart> uarts_, software_uarts_;
};

}  // namespace fake
