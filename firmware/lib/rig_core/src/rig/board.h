// The rig's board: link, button, motion and servos, tick by tick. docs/rig-firmware.md.
#pragma once

#include "brov/byte_ring.h"
#include "rig/button.h"
#include "rig/messages.h"
#include "rig/motion.h"
#include "rig/pca9685.h"

namespace brov::rig {

// What the rig needs from the machine it runs on.
class RigHal {
 public:
  // Hand over one whole frame; false when there is no room for it now.
  virtual bool link_write(Bytes frame, std::uint64_t now_us) = 0;
  virtual I2cBus& i2c() = 0;
  // This IMU answers at kImuAddress from now on, the others do not.
  virtual void select_imu(std::uint8_t imu) = 0;
  virtual bool button_down() = 0;
  virtual void set_lamp(bool lit) = 0;

 protected:
  ~RigHal() = default;
};

constexpr std::uint64_t kLinkSilenceUs = 500000;
constexpr std::uint16_t kHomingSteps = 20;

class RigBoard {
 public:
  explicit RigBoard(RigHal& hal);
  RigBoard(const RigBoard&) = delete;
  RigBoard& operator=(const RigBoard&) = delete;

  // Bytes from the computer; may be called from another context than tick().
  void receive(Bytes data) { input_.write(data); }
  void tick(std::uint64_t now_us);

  Mode mode() const { return mode_; }
  RigState state(std::uint64_t now_us) const;

 private:
  struct ImuRequest {
    bool open = false;
    std::uint8_t sequence = 0, imu = 0, wanted = 0;
    ImuSums sums;
    std::uint64_t due_us = 0;
    std::uint8_t failures = 0;
  };

  void take_input(std::uint64_t now_us);
  void take_frame(const FrameDecoder::Frame& frame, std::uint64_t now_us);
  void answer(const FrameDecoder::Frame& frame, Bytes body, std::uint64_t now_us);
  RigAck obey(RigMessage type, Bytes body, std::uint64_t now_us);
  RigAck obey_move(Bytes body, std::uint64_t now_us);
  RigAck obey_servos(Bytes body, std::uint64_t now_us);
  void begin_imu(Bytes body, std::uint64_t now_us);
  void look_at_button(std::uint64_t now_us);
  void look_after_boards(std::uint64_t now_us);
  void look_after_link(std::uint64_t now_us);
  void move(std::uint64_t now_us);
  void read_imu_when_due(std::uint64_t now_us);
  void send_state(std::uint8_t sequence, std::uint64_t now_us);

  void go_home(std::uint64_t now_us);
  void arrive(std::uint64_t now_us);
  void stop(StopCause cause);
  // Computes and writes; nothing changes where a platform has no angles. Fills result, platform and servo of `problem`.
  bool set(const SetPoints& set_points, RigAck& problem, std::uint64_t now_us);
  bool compute(const SetPoints& set_points, RigAck& problem);
  bool write_counts(std::uint64_t now_us);
  void boards_failed(std::uint64_t now_us);

  RigHal& hal_;
  ByteRing<2048> input_;
  FrameDecoder decoder_{kRigFrames};
  CountedBus bus_;
  Pca9685 boards_[2] = {Pca9685(kFirstServoBoard), Pca9685(kFirstServoBoard + 1)};
  StackCalibration calibration_ = published_calibration();
  Button button_;
  Motion motion_;
  ImuRequest imu_;

  Mode mode_ = Mode::kStarting;
  StopCause stopped_by_ = StopCause::kNone;
  std::uint8_t moving_ = 0;
  SetPoints held_{}, target_{};
  std::array<ServoAngles, kPlatforms> angles_{}, next_angles_{};
  std::array<Counts, kPlatforms> counts_{}, next_counts_{};
  bool boards_well_ = false;
  std::uint64_t boards_due_us_ = 0;
  std::uint64_t heard_us_ = 0;
  RigCounters counters_;
  // The last command that was obeyed, so that a repeated one is not obeyed again.
  bool last_known_ = false;
  std::uint16_t last_crc_ = 0;
  RigAck last_ack_{};
};

}  // namespace brov::rig
