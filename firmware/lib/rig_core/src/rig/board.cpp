#include "rig/board.h"

namespace brov::rig {

namespace {

constexpr std::uint64_t kBoardsRetryUs = 100000, kBoardsCheckUs = 500000;
constexpr std::uint64_t kImuPeriodUs = 10000, kImuWakesUs = 50000;
constexpr std::uint8_t kImuTries = 3;

void count(std::uint16_t& counter) {
  if (counter != UINT16_MAX) ++counter;
}

bool is_home(const SetPoints& set_points) { return set_points == SetPoints{}; }

}  // namespace

RigBoard::RigBoard(RigHal& hal) : hal_(hal), bus_(hal.i2c()) { hal_.set_lamp(false); }

void RigBoard::tick(std::uint64_t now_us) {
  take_input(now_us);
  look_at_button(now_us);
  look_after_boards(now_us);
  look_after_link(now_us);
  move(now_us);
  read_imu_when_due(now_us);
}

void RigBoard::take_input(std::uint64_t now_us) {
  while (const std::size_t size = input_.size()) {
    const Bytes block = input_.front(size < FrameDecoder::kMaxFeed ? size : FrameDecoder::kMaxFeed);
    decoder_.feed(block);
    for (FrameDecoder::Frame frame; decoder_.next(frame);) take_frame(frame, now_us);
    input_.consume(block.size);
  }
  const DecoderCounters& seen = decoder_.counters();
  const std::uint32_t bad = seen.checksum_errors + seen.length_errors;
  counters_.bad_frames = static_cast<std::uint16_t>(bad < UINT16_MAX ? bad : UINT16_MAX);
}

void RigBoard::take_frame(const FrameDecoder::Frame& frame, std::uint64_t now_us) {
  heard_us_ = now_us;
  answer(frame, frame.payload.first(frame.payload.size - kCrcBytes), now_us);
}

void RigBoard::answer(const FrameDecoder::Frame& frame, Bytes body, std::uint64_t now_us) {
  const auto type = static_cast<RigMessage>(frame.type);
  if (type == RigMessage::kWhere) {
    send_state(body[0], now_us);
    return;
  }
  if (type == RigMessage::kReadImu) {
    begin_imu(body, now_us);
    return;
  }
  const std::uint16_t crc = get_u16(body.data + body.size);
  RigAck ack = last_ack_;
  const bool repeated = last_known_ && crc == last_crc_ && ack.type == frame.type && ack.sequence == body[0];
  if (!repeated) {
    ack = obey(type, body, now_us);
    // A refused command may be right when it is said again.
    last_known_ = ack.result == Result::kOk;
    last_crc_ = crc;
    last_ack_ = ack;
    if (ack.result != Result::kOk) count(counters_.refused);
  }
  std::uint8_t encoded[kMaxRigFrame];
  hal_.link_write({encoded, encode_ack(ack, encoded)}, now_us);
}

RigAck RigBoard::obey(RigMessage type, Bytes body, std::uint64_t now_us) {
  switch (type) {
    case RigMessage::kMove: return obey_move(body, now_us);
    case RigMessage::kServos: return obey_servos(body, now_us);
    case RigMessage::kStop:
      // On its way home because of the button the rig is nobody's but the button's.
      if (mode_ == Mode::kMoving) stop(StopCause::kCommand);
      return {static_cast<std::uint8_t>(type), body[0], Result::kOk};
    default: return {static_cast<std::uint8_t>(type), body[0], Result::kUnknown};  // it came the wrong way
  }
}

RigAck RigBoard::obey_move(Bytes body, std::uint64_t now_us) {
  Move move{};
  RigAck ack{static_cast<std::uint8_t>(RigMessage::kMove), body[0], Result::kOk};
  if (!unpack_move(body, move)) {
    ack.result = Result::kBadContent;
    return ack;
  }
  if (mode_ != Mode::kReady && mode_ != Mode::kMoving) {
    ack.result = Result::kNotNow;
    return ack;
  }
  if (!boards_well_) {
    ack.result = Result::kServoBoard;
    return ack;
  }
  // Platforms that are not named go on to where they were going.
  SetPoints target = mode_ == Mode::kMoving ? target_ : held_;
  for (std::size_t p = 0; p < kPlatforms; ++p) {
    if ((move.platforms >> p & 1) == 0) continue;
    target[p] = move.set_points[p];
    if (within_axis_limits(target[p])) continue;
    ack.result = Result::kLimit;
    ack.platform = static_cast<std::uint8_t>(p);
    return ack;
  }
  if (!compute(target, ack)) return ack;
  moving_ = static_cast<std::uint8_t>(mode_ == Mode::kMoving ? moving_ | move.platforms : move.platforms);
  target_ = target;
  motion_.begin(held_, target, move.steps, now_us);
  mode_ = Mode::kMoving;
  return ack;
}

RigAck RigBoard::obey_servos(Bytes body, std::uint64_t now_us) {
  Servos servos{};
  RigAck ack{static_cast<std::uint8_t>(RigMessage::kServos), body[0], Result::kOk};
  if (!unpack_servos(body, servos)) {
    ack.result = Result::kBadContent;
    return ack;
  }
  if (mode_ == Mode::kMoving || mode_ == Mode::kHoming) {
    ack.result = Result::kNotNow;
    return ack;
  }
  PlatformCalibration& calibration = calibration_[servos.platform];
  const PlatformCalibration before = calibration;
  calibration = servos.calibration;
  if (mode_ != Mode::kStarting && !set(held_, ack, now_us)) calibration = before;
  return ack;
}

void RigBoard::look_at_button(std::uint64_t now_us) {
  if (!button_.pressed(hal_.button_down(), now_us)) return;
  count(counters_.presses);
  switch (mode_) {
    case Mode::kStarting:
    case Mode::kHoming: return;  // it is paused already
    case Mode::kWaiting:
      mode_ = Mode::kReady;
      break;
    case Mode::kReady:
    case Mode::kMoving:
      stopped_by_ = StopCause::kButton;
      last_known_ = false;
      go_home(now_us);
      break;
  }
  hal_.set_lamp(mode_ != Mode::kWaiting);
  send_state(0, now_us);
}

void RigBoard::go_home(std::uint64_t now_us) {
  moving_ = 0;
  for (std::size_t p = 0; p < kPlatforms; ++p) {
    if (held_[p] != SetPoint{}) moving_ = static_cast<std::uint8_t>(moving_ | 1 << p);
  }
  target_ = SetPoints{};
  mode_ = Mode::kHoming;
  motion_.begin(held_, target_, is_home(held_) ? std::uint16_t{1} : kHomingSteps, now_us);
}

void RigBoard::look_after_boards(std::uint64_t now_us) {
  if (now_us < boards_due_us_) return;
  if (!boards_well_) {
    boards_due_us_ = now_us + kBoardsRetryUs;
    for (Pca9685& board : boards_) {
      if (!board.begin(bus_, now_us)) return;
    }
    boards_well_ = true;  // and their counts in the next turn, when their oscillators run
    boards_due_us_ = now_us + 1000;
    return;
  }
  boards_due_us_ = now_us + kBoardsCheckUs;
  for (const Pca9685& board : boards_) {
    if (board.check(bus_, now_us) == Pca9685::State::kRuns) continue;
    boards_failed(now_us);
    return;
  }
  if (motion_.under_way()) return;  // the next step writes them
  RigAck problem{};
  if (!set(held_, problem, now_us)) return;
  if (mode_ == Mode::kStarting) {
    mode_ = Mode::kWaiting;
    send_state(0, now_us);
  } else if (mode_ == Mode::kHoming) {
    arrive(now_us);  // its last step had failed
  }
}

void RigBoard::boards_failed(std::uint64_t now_us) {
  if (boards_well_) count(counters_.servo_board_restarts);
  boards_well_ = false;
  boards_due_us_ = now_us;
  // On the way home too: the button's motion goes on by itself once the boards are back.
  if (mode_ == Mode::kMoving) {
    stop(StopCause::kServoBoard);
    send_state(0, now_us);
  }
}

void RigBoard::look_after_link(std::uint64_t now_us) {
  if (mode_ != Mode::kMoving || now_us - heard_us_ < kLinkSilenceUs) return;
  stop(StopCause::kLinkSilent);
  send_state(0, now_us);
}

void RigBoard::move(std::uint64_t now_us) {
  if (!boards_well_) return;
  SetPoints next{};
  if (!motion_.step(now_us, next)) return;
  RigAck problem{};
  if (!set(next, problem, now_us)) {
    if (problem.result == Result::kServoBoard) return;
    // Between two good places lies one that is none. Home is reached all the same, by its last step.
    if (mode_ == Mode::kMoving) {
      stop(StopCause::kUnreachable);
      send_state(0, now_us);
    }
    return;
  }
  if (!motion_.under_way()) arrive(now_us);
}

void RigBoard::arrive(std::uint64_t now_us) {
  if (mode_ == Mode::kHoming) {
    mode_ = Mode::kWaiting;
    hal_.set_lamp(false);
  } else {
    mode_ = Mode::kReady;
    stopped_by_ = StopCause::kArrived;
  }
  moving_ = 0;
  send_state(0, now_us);
}

void RigBoard::stop(StopCause cause) {
  motion_.end();
  moving_ = 0;
  mode_ = Mode::kReady;
  stopped_by_ = cause;
  last_known_ = false;  // the same command once more is a new one
}

bool RigBoard::set(const SetPoints& set_points, RigAck& problem, std::uint64_t now_us) {
  if (!compute(set_points, problem)) return false;
  held_ = set_points;
  angles_ = next_angles_;
  counts_ = next_counts_;
  if (write_counts(now_us)) return true;
  problem.result = Result::kServoBoard;
  boards_failed(now_us);
  return false;
}

bool RigBoard::compute(const SetPoints& set_points, RigAck& problem) {
  for (std::size_t p = 0; p < kPlatforms; ++p) {
    Result result = Result::kUnreachable;
    std::size_t servo = servo_angles(set_points[p], next_angles_[p]);
    if (servo == kReachable) {
      result = Result::kServoRange;
      servo = servo_counts(next_angles_[p], calibration_[p], next_counts_[p]);
    }
    if (servo == kReachable) continue;
    problem.result = result;
    problem.platform = static_cast<std::uint8_t>(p);
    problem.servo = static_cast<std::uint8_t>(servo);
    return false;
  }
  return true;
}

bool RigBoard::write_counts(std::uint64_t now_us) {
  for (std::size_t board = 0; board < 2; ++board) {
    std::uint16_t counts[kBoardServos];
    for (std::size_t i = 0; i < kBoardServos; ++i) counts[i] = counts_[2 * board + i / kServos][i % kServos];
    if (!boards_[board].write(counts, bus_, now_us)) return false;
  }
  return true;
}

void RigBoard::begin_imu(Bytes body, std::uint64_t now_us) {
  const std::uint8_t imu = body[1], wanted = body[2];
  if (imu >= kImus || wanted == 0 || wanted > kMaxReadings) {
    count(counters_.refused);
    std::uint8_t encoded[kMaxRigFrame];
    const RigAck ack{static_cast<std::uint8_t>(RigMessage::kReadImu), body[0], Result::kBadContent};
    hal_.link_write({encoded, encode_ack(ack, encoded)}, now_us);
    return;
  }
  if (imu_.open && imu_.sequence == body[0] && imu_.imu == imu) return;  // said again: it is under way
  imu_ = ImuRequest{};
  imu_.open = true;
  imu_.sequence = body[0];
  imu_.imu = imu;
  imu_.wanted = wanted;
  hal_.select_imu(imu);
  const bool awake = wake_imu(bus_, now_us);
  imu_.failures = awake ? 0 : kImuTries;
  imu_.due_us = now_us + (awake ? kImuWakesUs : 0);
}

void RigBoard::read_imu_when_due(std::uint64_t now_us) {
  if (!imu_.open || now_us < imu_.due_us) return;
  if (imu_.failures < kImuTries && imu_.sums.readings < imu_.wanted) {
    imu_.failures = read_imu(bus_, imu_.sums, now_us) ? std::uint8_t{0} : static_cast<std::uint8_t>(imu_.failures + 1);
    imu_.due_us = now_us + kImuPeriodUs;
    if (imu_.failures < kImuTries && imu_.sums.readings < imu_.wanted) return;
  }
  imu_.open = false;
  std::uint8_t encoded[kMaxRigFrame];
  hal_.link_write({encoded, encode_imu(imu_.sequence, imu_.imu, imu_.sums, encoded)}, now_us);
}

RigState RigBoard::state(std::uint64_t now_us) const {
  RigState state{};
  state.mode = mode_;
  state.stopped_by = stopped_by_;
  state.moving_platforms = moving_;
  state.steps_done = motion_.done();
  state.steps = motion_.steps();
  state.t_ms = static_cast<std::uint32_t>(now_us / 1000);
  state.known = mode_ != Mode::kStarting;
  state.set_points = held_;
  state.angles = angles_;
  state.counts = counts_;
  state.counters = counters_;
  state.counters.i2c_errors = bus_.errors();
  return state;
}

void RigBoard::send_state(std::uint8_t sequence, std::uint64_t now_us) {
  RigState now = state(now_us);
  now.sequence = sequence;
  std::uint8_t encoded[kMaxRigFrame];
  hal_.link_write({encoded, encode_state(now, encoded)}, now_us);
}

}  // namespace brov::rig
