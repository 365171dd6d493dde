// One lamp that tells what is wrong to somebody without a computer. docs/firmware.md has the table.
#pragma once

#include "brov/board.h"
#include "job.h"

namespace brov {

enum class LedPattern : std::uint8_t {
  kSteady = 0,  // starting
  kAllWell = 1,  // the number of flashes every two seconds
  kSonarSilent = 2,
  kI2cSilent = 3,
  kSerialSilent = 4,  // IMU, EC or GPS
  kRestarted = 5,     // fast: nobody asked for this start
};

// Whether the lamp is lit so long after its pattern began, and after how long it changes.
struct LedMoment {
  bool lit;
  std::uint32_t until_us;
};
LedMoment led_moment(LedPattern pattern, std::uint32_t since_us);
constexpr std::uint32_t kLedPeriodUs = 2000000;

class StatusLed final : public Job {
 public:
  StatusLed(const Board& board, std::uint8_t reset_reason, std::uint64_t boot_us);
  std::uint64_t run(std::uint64_t now_us) override;

 private:
  LedPattern choose(std::uint64_t now_us);
  bool sonar_silent(Channel channel, std::uint64_t now_us);

  const Board& board_;
  bool restarted_by_fault_;
  std::uint64_t boot_us_, period_us_;
  LedPattern pattern_ = LedPattern::kSteady;
  std::uint32_t packets_[2] = {0, 0};
  Stamp packet_seen_[2];
};

}  // namespace brov
