#include "machine.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "Arduino.h"
#include "src/pins.h"

namespace fake {

namespace {

Machine* the_current = nullptr;

std::uint64_t byte_ns(std::uint32_t baud) { return 10000000000u / baud; }

}  // namespace

void Uart::install(std::size_t receive_capacity, std::size_t transmit_capacity) {
  receive_capacity_ = receive_capacity;
  transmit_capacity_ = transmit_capacity;
}

void Uart::set_baud(std::uint32_t baud, std::uint64_t now_us) {
  baud_ = baud;
  std::size_t first = sent_.size() - in_fifo(now_us);
  if (shifting(now_us)) --first;
  if (first == sent_.size()) return;
  free_ns_ = sent_[first].start_ns;
  for (std::size_t i = first; i < sent_.size(); ++i) {
    sent_[i] = {free_ns_, baud, sent_[i].value};
    free_ns_ += byte_ns(baud);
  }
}

void Uart::arrive(const std::vector<std::uint8_t>& bytes, std::uint64_t from_us, std::uint32_t baud) {
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    coming_.push_back({from_us * 1000 + i * byte_ns(baud), baud, bytes[i]});
  }
}

std::size_t Uart::take(std::uint8_t* into, std::size_t most, std::uint64_t now_us) {
  std::size_t there = taken_;
  while (there < coming_.size() && coming_[there].start_ns + byte_ns(coming_[there].baud) <= now_us * 1000) ++there;
  if (there - taken_ > receive_capacity_) {
    const std::size_t too_many = there - taken_ - receive_capacity_;
    bytes_lost_ += too_many;
    coming_.erase(coming_.begin() + static_cast<std::ptrdiff_t>(there - too_many),
                  coming_.begin() + static_cast<std::ptrdiff_t>(there));
    there -= too_many;
  }
  const std::size_t count = std::min(most, there - taken_);
  for (std::size_t i = 0; i < count; ++i) {
    const WireByte& byte = coming_[taken_ + i];
    into[i] = byte.baud == baud_ ? byte.value : static_cast<std::uint8_t>(~byte.value);
  }
  taken_ += count;
  return count;
}

std::size_t Uart::in_fifo(std::uint64_t now_us) const {
  const auto waits = [now_us](const WireByte& byte) { return byte.start_ns > now_us * 1000; };
  return static_cast<std::size_t>(std::find_if_not(sent_.rbegin(), sent_.rend(), waits) - sent_.rbegin());
}

bool Uart::shifting(std::uint64_t now_us) const { return free_ns_ > now_us * 1000; }

std::uint64_t Uart::refill_us() const {
  if (sent_.size() <= kRefillAt) return 0;
  return (sent_[sent_.size() - 1 - kRefillAt].start_ns + 999) / 1000;
}

void Uart::push(std::uint8_t value, std::uint64_t now_us) {
  const std::uint64_t start_ns = std::max(free_ns_, now_us * 1000);
  sent_.push_back({start_ns, baud_, value});
  free_ns_ = start_ns + byte_ns(baud_);
}

Machine::Machine(Flash& flash, int reset_reason) : flash_(flash), reset_reason_(reset_reason) {
  tasks_.push_back(std::make_unique<Task>());
  running_ = tasks_.front().get();
  running_->name = "loop";
  i2c_.set_state(brov::BusState::kBothSilent);
  the_current = this;
}

Machine::~Machine() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ending_ = true;
    for (const auto& task : tasks_) task->turn_.notify_one();
  }
  for (const auto& task : tasks_) {
    if (task->thread_.joinable()) task->thread_.join();
  }
  the_current = nullptr;
}

Machine& Machine::current() {
  if (the_current == nullptr) std::abort();
  return *the_current;
}

Task* Machine::create_task(const char* name, int priority, int core, std::function<void()> run) {
  tasks_.push_back(std::make_unique<Task>());
  Task& task = *tasks_.back();
  task.name = name;
  task.priority = priority;
  task.core = core;
  task.wake_us_ = now_us_;
  task.thread_ = std::thread([this, &task, run = std::move(run)] { body(task, run); });
  return &task;
}

void Machine::body(Task& task, const std::function<void()>& run) {
  {
    std::unique_lock<std::mutex> lock(mutex_);
    task.turn_.wait(lock, [&] { return running_ == &task || ending_; });
    if (ending_) return;
  }
  try {
    run();
  } catch (const TaskEnded&) {
  }
}

// Everything runs in turn: the task that wakes first, of several the most urgent one.
void Machine::hand_over(std::unique_lock<std::mutex>& lock, Task& from) {
  const auto earlier = [](const std::unique_ptr<Task>& a, const std::unique_ptr<Task>& b) {
    return a->wake_us_ != b->wake_us_ ? a->wake_us_ < b->wake_us_ : a->priority > b->priority;
  };
  Task& next = **std::min_element(tasks_.begin(), tasks_.end(), earlier);
  now_us_ = std::max(now_us_, next.wake_us_);
  if (&next == &from) return;
  running_ = &next;
  next.turn_.notify_one();
  from.turn_.wait(lock, [&] { return running_ == &from || ending_; });
  if (ending_) throw TaskEnded();
}

void Machine::sleep_until(std::uint64_t us) {
  std::unique_lock<std::mutex> lock(mutex_);
  Task& self = *running_;
  self.wake_us_ = std::max(us, now_us_);
  hand_over(lock, self);
}

void Machine::notify(Task& task) {
  ++task.notices_;
  if (task.waits_for_notice_) task.wake_us_ = now_us_;
}

std::uint32_t Machine::take_notice(std::uint64_t until_us) {
  Task& self = *running_;
  if (self.notices_ == 0) {
    self.waits_for_notice_ = true;
    sleep_until(until_us);
    self.waits_for_notice_ = false;
  }
  return std::exchange(self.notices_, 0u);
}

void Machine::feed() {
  Task& self = *running_;
  longest_unfed_us_ = std::max(longest_unfed_us_, now_us_ - self.fed_us);
  self.fed_us = now_us_;
}

bool Machine::watchdog_bites() const {
  const auto unfed = [this](const std::unique_ptr<Task>& task) {
    return task->watched && now_us_ - task->fed_us > watchdog_us_;
  };
  return watchdog_us_ != 0 && std::any_of(tasks_.begin(), tasks_.end(), unfed);
}

void Machine::write_pin(int pin, bool high) {
  const auto before = levels_.find(pin);
  if (before == levels_.end() || before->second != high) edges_[pin].push_back({now_us_, high});
  const bool rises = before != levels_.end() && !before->second && high;
  levels_[pin] = high;
  // With SDA let go; the clock of a stop does not count.
  const bool clocks = pin == brov::pins::kScl && rises && mode(pin) == OUTPUT_OPEN_DRAIN && levels_[brov::pins::kSda];
  if (clocks && clocks_to_free_ > 0) --clocks_to_free_;
}

bool Machine::read_pin(int pin) const {
  if (pin == brov::pins::kSda) return !i2c_blocked();
  return true;  // pulled up
}

}  // namespace fake
