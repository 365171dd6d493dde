// Messages between the rig and a computer, on AA55 frames with types of their own. docs/rig-link.md section 1.
#pragma once

#include "brov/aa55.h"
#include "rig/mpu6050.h"
#include "rig/servos.h"

namespace brov::rig {

enum class RigMessage : std::uint8_t {
  kState = 0x10,
  kAck = 0x11,
  kImu = 0x12,
  kMove = 0x30,
  kStop = 0x31,
  kWhere = 0x32,
  kReadImu = 0x33,
  kServos = 0x34,
};

enum class Mode : std::uint8_t { kStarting = 0, kWaiting = 1, kReady = 2, kMoving = 3, kHoming = 4 };

enum class StopCause : std::uint8_t {
  kNone = 0,
  kArrived = 1,
  kCommand = 2,
  kButton = 3,
  kLinkSilent = 4,
  kUnreachable = 5,
  kServoBoard = 6,
};

enum class Result : std::uint8_t {
  kOk = 0,
  kBadContent = 1,
  kUnknown = 2,
  kLimit = 3,
  kUnreachable = 4,
  kServoRange = 5,
  kNotNow = 6,
  kServoBoard = 7,
};

constexpr std::size_t kCrcBytes = 2;
constexpr std::size_t kMoveBytes = 4 + 4 * 6 * 4, kSequenceBytes = 1, kReadImuBytes = 3, kServosBytes = 2 + 6 * 8;
constexpr std::size_t kStateBytes = 12 + 24 * 4 + 24 * 4 + 24 * 2 + 10, kRigAckBytes = 5, kImuBytes = 3 + 6 * 4 + 2;
constexpr std::size_t kMaxRigFrame = kStateBytes + kCrcBytes + kFrameOverhead;
constexpr std::uint16_t kMaxSteps = 1200;
constexpr std::size_t kImus = 5;
constexpr std::uint8_t kMaxReadings = 64;
constexpr std::uint8_t kNobody = 0xFF;
constexpr std::int32_t kUnknown32 = INT32_MIN;
constexpr std::int16_t kUnknown16 = INT16_MIN;
constexpr std::uint16_t kUnknownCounts = 0xFFFF;

// CRC-16/CCITT-FALSE of a type and its body. Check: "123456789" gives 29B1.
std::uint16_t message_crc(std::uint8_t type, Bytes body);
// What is a frame on this link.
extern const FrameRules kRigFrames;

struct Move {
  std::uint8_t sequence, platforms;
  std::uint16_t steps;
  SetPoints set_points;
};
// False where platforms or steps are out of their range.
bool unpack_move(Bytes body, Move& move);

struct Servos {
  std::uint8_t sequence, platform;
  PlatformCalibration calibration;
};
bool unpack_servos(Bytes body, Servos& servos);

struct RigAck {
  std::uint8_t type, sequence;
  Result result;
  std::uint8_t platform = kNobody, servo = kNobody;
};

struct RigCounters {
  std::uint16_t bad_frames = 0, refused = 0, i2c_errors = 0, servo_board_restarts = 0, presses = 0;
};

struct RigState {
  std::uint8_t sequence;
  Mode mode;
  StopCause stopped_by;
  std::uint8_t moving_platforms;
  std::uint16_t steps_done, steps;
  std::uint32_t t_ms;
  bool known;  // where the plates are
  SetPoints set_points;
  std::array<ServoAngles, kPlatforms> angles;
  std::array<Counts, kPlatforms> counts;
  RigCounters counters;
};

// Each writes one whole frame of at most kMaxRigFrame bytes and returns its length.
std::size_t encode_ack(const RigAck& ack, std::uint8_t* into);
std::size_t encode_state(const RigState& state, std::uint8_t* into);
std::size_t encode_imu(std::uint8_t sequence, std::uint8_t imu, const ImuSums& sums, std::uint8_t* into);

}  // namespace brov::rig
