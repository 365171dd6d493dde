#include "status_led.h"

#include <Arduino.h>

#include "boot.h"
#include "pins.h"

namespace brov {

namespace {

// Long enough for every sensor to have been heard once; the GPS and the EC probe talk once a second.
constexpr std::uint64_t kStartingUs = 4000000;
constexpr std::uint64_t kRestartShownUs = 10000000;
constexpr std::uint64_t kSilentUs = 3000000;
constexpr std::uint32_t kFlashUs = 120000, kFlashPeriodUs = 360000, kFastUs = 100000;

}  // namespace

LedMoment led_moment(LedPattern pattern, std::uint32_t since_us) {
  if (pattern == LedPattern::kSteady) return {true, kLedPeriodUs};
  if (pattern == LedPattern::kRestarted) {
    const std::uint32_t halves = since_us / kFastUs;
    return {halves % 2 == 0, (halves + 1) * kFastUs};
  }
  const std::uint32_t flash = since_us / kFlashPeriodUs;
  if (flash >= static_cast<std::uint32_t>(pattern)) return {false, kLedPeriodUs};
  const std::uint32_t start_us = flash * kFlashPeriodUs;
  const bool lit = since_us < start_us + kFlashUs;
  return {lit, start_us + (lit ? kFlashUs : kFlashPeriodUs)};
}

StatusLed::StatusLed(const Board& board, std::uint8_t reset_reason, std::uint64_t boot_us)
    : board_(board), restarted_by_fault_(is_fault(reset_reason)), boot_us_(boot_us), period_us_(boot_us) {
  pinMode(pins::kLed, OUTPUT);
  pattern_ = choose(boot_us);
}

std::uint64_t StatusLed::run(std::uint64_t now_us) {
  if (now_us - period_us_ >= kLedPeriodUs) {
    period_us_ = now_us;
    pattern_ = choose(now_us);
  }
  const LedMoment moment = led_moment(pattern_, static_cast<std::uint32_t>(now_us - period_us_));
  digitalWrite(pins::kLed, moment.lit ? HIGH : LOW);
  return period_us_ + moment.until_us;
}

LedPattern StatusLed::choose(std::uint64_t now_us) {
  const bool a_silent = sonar_silent(Channel::kA, now_us), b_silent = sonar_silent(Channel::kB, now_us);
  if (restarted_by_fault_ && now_us - boot_us_ < kRestartShownUs) return LedPattern::kRestarted;
  if (now_us - boot_us_ < kStartingUs) return LedPattern::kSteady;
  if (a_silent || b_silent) return LedPattern::kSonarSilent;
  const SensorFields readings = board_.readings(now_us);
  if (readings.depth_ok == 0 || readings.temperature_ok == 0) return LedPattern::kI2cSilent;
  if (readings.imu_alive == 0 || readings.ec_alive == 0 || readings.gps_alive == 0) return LedPattern::kSerialSilent;
  return LedPattern::kAllWell;
}

bool StatusLed::sonar_silent(Channel channel, std::uint64_t now_us) {
  const auto i = static_cast<std::size_t>(channel);
  const std::uint32_t packets = board_.sonar(channel).packets();
  if (packets != packets_[i]) packet_seen_[i].set(now_us);
  packets_[i] = packets;
  return !packet_seen_[i].within(now_us, kSilentUs);
}

}  // namespace brov
