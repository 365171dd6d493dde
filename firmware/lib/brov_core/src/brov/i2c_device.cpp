#include "brov/i2c_device.h"

namespace brov {

namespace {

constexpr std::uint8_t kFailuresBeforeRecovery = 5;
constexpr std::uint64_t kRecoveryGapUs = 1000000;

}  // namespace

bool CountedBus::write(std::uint8_t address, Bytes data, std::uint64_t now_us) {
  return note(bus_.write(address, data), now_us);
}

bool CountedBus::read(std::uint8_t address, std::uint8_t* into, std::size_t count, std::uint64_t now_us) {
  return note(bus_.read(address, into, count), now_us);
}

bool CountedBus::command(std::uint8_t address, std::uint8_t code, std::uint64_t now_us) {
  return write(address, {&code, 1}, now_us);
}

bool CountedBus::read_answer(std::uint8_t address, std::uint8_t code, std::uint8_t* into, std::size_t count,
                             std::uint64_t now_us) {
  return command(address, code, now_us) && read(address, into, count, now_us);
}

bool CountedBus::note(bool ok, std::uint64_t now_us) {
  if (ok) {
    failed_in_a_row_ = 0;
    return true;
  }
  ++errors_;
  if (failed_in_a_row_ < kFailuresBeforeRecovery) {
    ++failed_in_a_row_;
  }
  if (failed_in_a_row_ == kFailuresBeforeRecovery && !recovered_.within(now_us, kRecoveryGapUs - 1)) {
    bus_.recover();
    recovered_.set(now_us);
    failed_in_a_row_ = 0;
  }
  return false;
}

}  // namespace brov
