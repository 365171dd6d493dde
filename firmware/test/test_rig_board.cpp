// The rig's board on models of its servo boards and IMUs, in virtual time.
#include <doctest/doctest.h>

#include <cmath>
#include <cstring>

#include "hex.h"
#include "native/rig/models.h"
#include "rig/board.h"
#include "rig/trigonometry.h"

using namespace brov;
using namespace brov::rig;

namespace {

constexpr std::uint64_t kMs = 1000;
constexpr double kPi = 3.14159265358979;

struct Frame {
  std::uint8_t type;
  Buffer body;
};

class World final : public RigHal {
 public:
  World() : board(*this) {}

  bool link_write(Bytes frame, std::uint64_t) override {
    if (line_full) return false;
    decoder.feed(frame.first(frame.size < FrameDecoder::kMaxFeed ? frame.size : FrameDecoder::kMaxFeed));
    if (frame.size > FrameDecoder::kMaxFeed) {
      FrameDecoder::Frame none;
      REQUIRE(!decoder.next(none));
      decoder.feed(frame.from(FrameDecoder::kMaxFeed));
    }
    for (FrameDecoder::Frame found; decoder.next(found);) {
      frames.push_back({found.type, Buffer(found.payload.data, found.payload.data + found.payload.size - kCrcBytes)});
    }
    return true;
  }
  I2cBus& i2c() override { return models; }
  void select_imu(std::uint8_t imu) override { models.selected_imu = imu; }
  bool button_down() override { return down; }
  void set_lamp(bool lit) override { lamp = lit; }

  void run(std::uint64_t ms) {
    for (const std::uint64_t end = now_us + ms * kMs; now_us < end;) board.tick(now_us += kMs);
  }
  void press() {
    down = true;
    run(50);
    down = false;
    run(50);
  }
  void start() {
    run(200);
    press();
    REQUIRE(board.mode() == Mode::kReady);
  }
  void say(RigMessage type, Buffer body) {
    const auto number = static_cast<std::uint8_t>(type);
    const std::uint16_t crc = message_crc(number, view(body));
    body.push_back(static_cast<std::uint8_t>(crc));
    body.push_back(static_cast<std::uint8_t>(crc >> 8));
    Buffer frame(body.size() + kFrameOverhead);
    encode_frame(static_cast<MessageType>(number), view(body), frame.data());
    board.receive(view(frame));
    run(1);
  }
  // The same for all platforms that are named.
  void move(std::uint8_t sequence, const SetPoint& set_point, std::uint16_t steps, std::uint8_t platforms = 15) {
    Buffer body(kMoveBytes);
    body[0] = sequence, body[1] = platforms;
    put_u16(body.data() + 2, steps);
    for (std::size_t i = 0; i < 24; ++i) {
      const double nano = std::round(static_cast<double>(set_point[i % 6]) * (i % 6 < 3 ? 1e6 : 1e9));
      put_u32(body.data() + 4 + 4 * i, static_cast<std::uint32_t>(static_cast<std::int32_t>(nano)));
    }
    say(RigMessage::kMove, body);
  }
  // Result of the newest acknowledgement.
  Result result() const {
    for (std::size_t i = frames.size(); i-- > 0;) {
      if (frames[i].type == static_cast<std::uint8_t>(RigMessage::kAck)) return static_cast<Result>(frames[i].body[2]);
    }
    FAIL("no acknowledgement");
    return Result::kUnknown;
  }
  RigState state() const { return board.state(now_us); }
  std::uint16_t pulse(std::size_t platform, std::size_t servo) const {
    return models.boards[platform / 2].pulse_counts(platform % 2 * 6 + servo);
  }
  void keep_alive() { say(RigMessage::kWhere, {1}); }

  RigModels models;
  FrameDecoder decoder{kRigFrames};
  std::vector<Frame> frames;
  bool down = false, lamp = true, line_full = false;
  std::uint64_t now_us = 0;
  RigBoard board;
};

constexpr SetPoint kHome{}, kRaised{0, 0, 10, 0, 0, 0};

}  // namespace

TEST_CASE("Sine, cosine and arc tangent are right to single precision") {
  float worst = 0.0f;
  for (int i = -1000; i <= 1000; ++i) {
    const float x = static_cast<float>(i) * 1e-3f;
    const double exact = static_cast<double>(x);
    worst = std::fmax(worst, std::fabs(sine(x) - static_cast<float>(std::sin(exact))));
    worst = std::fmax(worst, std::fabs(cosine(x) - static_cast<float>(std::cos(exact))));
  }
  CHECK(worst < 2e-7f);
  worst = 0.0f;
  for (int i = -3600; i <= 3600; ++i) {
    const double angle = i * kPi / 3600.0;
    for (const double length : {1e-3, 1.0, 4.7e5}) {
      const auto y = static_cast<float>(length * std::sin(angle)), x = static_cast<float>(length * std::cos(angle));
      const double exact = std::atan2(static_cast<double>(y), static_cast<double>(x));
      worst = std::fmax(worst, std::fabs(arc_tangent(y, x) - static_cast<float>(exact)));
    }
  }
  CHECK(worst < 5e-7f);
  CHECK(arc_tangent(0.0f, 0.0f) == 0.0f);
  CHECK(arc_tangent(0.0f, -1.0f) == doctest::Approx(kPi));
}

TEST_CASE("All servos are at 23.0 degrees at home and at 0.4 where the gauge wants them level") {
  ServoAngles angles{};
  REQUIRE(servo_angles(kHome, angles) == kReachable);
  for (const float angle : angles) CHECK(angle * 180.0 / kPi == doctest::Approx(23.0).epsilon(0.002));
  REQUIRE(servo_angles(kRaised, angles) == kReachable);
  for (const float angle : angles) CHECK(angle * 180.0 / kPi == doctest::Approx(0.42).epsilon(0.02));
}

TEST_CASE("What cannot be reached names a servo, and NaN is never an angle") {
  ServoAngles angles{};
  CHECK(servo_angles({0, 0, 60, 0, 0, 0}, angles) < kServos);
  CHECK(servo_angles({std::nanf(""), 0, 0, 0, 0, 0}, angles) < kServos);
  CHECK(!within_axis_limits({std::nanf(""), 0, 0, 0, 0, 0}));
  CHECK(within_axis_limits({5, -5, 16, 0.26179939f, -0.26179939f, 0.08726646f}));
  CHECK(!within_axis_limits({0, 0, 0, 0, 0, 0.0873f}));
}

TEST_CASE("Servo boards are set up register by register") {
  World world;
  for (const Pca9685Model& board : world.models.boards) CHECK(board.pulse_counts(0) == 0);
  world.run(10);
  for (const Pca9685Model& board : world.models.boards) {
    CHECK(board.reg(0x00) == 0x20);  // awake, auto-increment, no all-call
    CHECK(board.reg(0x01) == 0x04);
    CHECK(board.reg(0xFE) == 121);
    CHECK(board.frequency_hz() == doctest::Approx(50.0).epsilon(0.001));
    CHECK(board.reg(0x06) == 0);  // a pulse begins at 0
    CHECK(board.reg(0x07) == 0);
    for (std::uint8_t channel = 12; channel < 16; ++channel) CHECK(board.pulse_counts(channel) == 0);
  }
  CHECK(world.board.mode() == Mode::kWaiting);
}

TEST_CASE("Counts are 300 +- 127.3 per radian and the published offsets, each on its own channel") {
  World world;
  world.run(200);
  // 23.04 degrees are 51.2 counts; servos of an even number turn the other way.
  const int offsets[4][6] = {
      {2, -1, 0, -19, -4, 1}, {6, -12, 1, 14, -4, 11}, {16, -11, -12, 9, -5, -16}, {-8, 7, 8, -2, -2, -17}};
  for (std::size_t p = 0; p < 4; ++p) {
    for (std::size_t s = 0; s < 6; ++s) CHECK(world.pulse(p, s) == 300 + (s % 2 == 0 ? -51 : 51) + offsets[p][s]);
  }
  CHECK(world.state().counts[3][5] == world.pulse(3, 5));
}

TEST_CASE("Counts end at 100 and 500") {
  const PlatformCalibration calibration = published_calibration()[0];
  Counts counts{};
  ServoAngles angles{};
  angles[1] = static_cast<float>(kPi / 2.0 + 1.4 / 127.324);  // its offset is -1
  CHECK(servo_counts(angles, calibration, counts) == kReachable);
  CHECK(counts[1] == 500);
  angles[1] = static_cast<float>(kPi / 2.0 + 1.6 / 127.324);
  CHECK(servo_counts(angles, calibration, counts) == 1);
  angles[1] = std::nanf("");
  CHECK(servo_counts(angles, calibration, counts) == 1);
}

TEST_CASE("A board that still runs keeps its pulses when only the processor has started anew") {
  World world;
  world.start();
  world.move(1, kRaised, 1);
  world.run(60);
  const std::uint16_t before = world.pulse(0, 0);
  World after;
  after.models.boards = world.models.boards;
  bool slept = false;
  for (int i = 0; i < 100; ++i) {
    after.run(1);
    slept = slept || after.models.boards[0].pulse_counts(0) == 0;
  }
  CHECK(!slept);
  CHECK(before != after.pulse(0, 0));  // and then goes home
}

TEST_CASE("A motion takes a step every 50 ms and ends at the set point itself") {
  World world;
  world.start();
  world.move(1, kRaised, 16);
  CHECK(world.result() == Result::kOk);
  for (int step = 1; step <= 16; ++step) {
    world.run(25);
    world.keep_alive();
    world.run(24);
    CHECK(world.state().steps_done == step);
    CHECK(world.state().set_points[2][2] == doctest::Approx(10.0 * step / 16));
  }
  CHECK(world.board.mode() == Mode::kReady);
  CHECK(world.state().set_points[0] == kRaised);
  CHECK(world.state().stopped_by == StopCause::kArrived);
}

TEST_CASE("A new motion begins where the one under way is; platforms not named go on") {
  World world;
  world.start();
  world.move(1, kRaised, 10, 0b0001);
  world.run(210);
  const float reached = world.state().set_points[0][2];
  CHECK(reached == doctest::Approx(4.0));
  world.move(2, kRaised, 4, 0b0010);
  world.run(51);
  CHECK(world.state().set_points[0][2] == doctest::Approx(4.0 + 6.0 / 4.0));
  CHECK(world.state().set_points[1][2] == doctest::Approx(10.0 / 4.0));
  CHECK(world.state().moving_platforms == 3);
  CHECK(world.state().set_points[2] == kHome);
}

TEST_CASE("The button: start, pause on the way, home in twenty steps, go on") {
  World world;
  CHECK(!world.lamp);
  world.run(200);
  world.move(1, kRaised, 4);
  CHECK(world.result() == Result::kNotNow);
  world.press();
  CHECK(world.lamp);
  world.move(2, kRaised, 4);
  CHECK(world.result() == Result::kOk);
  world.run(110);
  world.press();
  CHECK(world.board.mode() == Mode::kHoming);
  CHECK(world.lamp);
  world.press();  // once more changes nothing
  CHECK(world.board.mode() == Mode::kHoming);
  world.say(RigMessage::kStop, {9});
  CHECK(world.board.mode() == Mode::kHoming);
  world.run(20 * 50);  // without a word from the computer
  CHECK(world.board.mode() == Mode::kWaiting);
  CHECK(!world.lamp);
  CHECK(world.state().set_points[3] == kHome);
  CHECK(world.state().steps == 20);
  CHECK(world.state().stopped_by == StopCause::kButton);
  world.move(3, kRaised, 4);
  CHECK(world.result() == Result::kNotNow);
  world.press();
  world.move(4, kRaised, 4);
  CHECK(world.result() == Result::kOk);
  CHECK(world.state().counters.presses == 4);
}

TEST_CASE("A contact that bounces, or a glitch, is one press or none") {
  World world;
  world.run(200);
  for (int i = 0; i < 12; ++i) {
    world.down = i % 2 == 0;
    world.run(5);
  }
  world.down = false;
  world.run(100);
  CHECK(world.state().counters.presses == 0);
  for (const bool down : {true, false, true, false, true}) {
    world.down = down;
    world.run(10);
  }
  world.run(500);  // held
  world.down = false;
  world.run(100);
  CHECK(world.state().counters.presses == 1);
  CHECK(world.board.mode() == Mode::kReady);
}

TEST_CASE("A silent link stops a motion after half a second; damaged frames do not count as words") {
  World world;
  world.start();
  world.move(1, kRaised, 100);
  for (int i = 0; i < 10; ++i) {
    world.run(90);
    world.keep_alive();
  }
  CHECK(world.board.mode() == Mode::kMoving);
  const Buffer noise = unhex("aa5532000301beefaa");
  std::uint64_t silent_ms = 0;
  for (; world.board.mode() == Mode::kMoving && silent_ms < 2000; ++silent_ms) {
    world.board.receive(view(noise));
    world.run(1);
  }
  CHECK(silent_ms == doctest::Approx(500).epsilon(0.01));
  const SetPoint stopped = world.state().set_points[0];
  CHECK(stopped[2] > 2.0f);
  CHECK(stopped[2] < 4.0f);
  world.run(1000);
  CHECK(world.state().set_points[0] == stopped);
  CHECK(world.state().stopped_by == StopCause::kLinkSilent);
  CHECK(world.state().counters.bad_frames > 100);
}

TEST_CASE("A repeated command is acknowledged again and obeyed once, a refused one is tried again") {
  World world;
  world.start();
  world.move(1, kRaised, 10);
  world.run(260);
  const auto done = world.state().steps_done;
  world.move(1, kRaised, 10);
  CHECK(world.result() == Result::kOk);
  CHECK(world.state().steps_done == done);
  world.move(1, kHome, 10);  // another one that has the same number
  CHECK(world.state().steps_done == 0);
  world.press();
  world.move(7, kRaised, 1);
  CHECK(world.result() == Result::kNotNow);
  world.run(1100);
  world.press();
  world.move(7, kRaised, 1);
  CHECK(world.result() == Result::kOk);
}

TEST_CASE("A way on which a step has no angles ends at the step before it") {
  World world;
  world.start();
  // Both ends are good; in the middle servo 1 has no angle (a pair found with the Python kinematics).
  const SetPoint from{-2.5f, -5.0f, 14.4f, -0.1308997f, -0.1308997f, -0.04363323f};
  const SetPoint to{-4.5f, 0.0f, 14.4f, -0.26179939f, 0.1308997f, -0.04363323f};
  world.move(1, from, 1);
  CHECK(world.result() == Result::kOk);
  world.run(60);
  world.move(2, to, 2);
  CHECK(world.result() == Result::kOk);
  world.run(60);
  CHECK(world.state().stopped_by == StopCause::kUnreachable);
  CHECK(world.state().set_points[0][1] == doctest::Approx(from[1]));
  CHECK(world.board.mode() == Mode::kReady);
}

TEST_CASE("A servo board that lost its supply is noticed, set up again and given its counts") {
  World world;
  world.start();
  world.move(1, kRaised, 1);
  world.run(60);
  const std::uint16_t before = world.pulse(2, 3);
  world.models.boards[1].power_on();
  CHECK(world.pulse(2, 3) == 0);
  world.run(700);
  CHECK(world.pulse(2, 3) == before);
  CHECK(world.state().counters.servo_board_restarts == 1);
}

TEST_CASE("A servo board that is silent stops the motion; where the plates are is known until then and unknown at the start") {
  World silent;
  silent.models.board_answers[1] = false;
  silent.run(2000);
  CHECK(silent.board.mode() == Mode::kStarting);
  CHECK(!silent.state().known);
  CHECK(silent.state().counters.i2c_errors > 0);
  silent.keep_alive();
  const Frame& state = silent.frames.back();
  CHECK(get_u32(state.body.data() + 12) == 0x80000000);
  CHECK(get_u16(state.body.data() + 12 + 192) == 0xFFFF);
  silent.press();
  silent.models.board_answers[1] = true;
  silent.run(200);
  CHECK(silent.board.mode() == Mode::kWaiting);

  World world;
  world.start();
  world.move(1, kRaised, 100);
  world.run(120);
  world.models.board_answers[0] = false;
  world.run(60);
  CHECK(world.board.mode() == Mode::kReady);
  CHECK(world.state().stopped_by == StopCause::kServoBoard);
  world.move(2, kHome, 1);
  CHECK(world.result() == Result::kServoBoard);
}

TEST_CASE("Going home survives a servo board that fails at any of its steps") {
  for (std::uint64_t fail_ms = 0; fail_ms < 1100; fail_ms += 10) {
    World world;
    world.start();
    world.move(1, kRaised, 1);
    world.run(60);
    world.press();
    world.run(fail_ms);
    world.models.board_answers[0] = false;
    world.run(120);
    world.models.board_answers[0] = true;
    world.models.boards[0].power_on();
    world.run(2000);
    CAPTURE(fail_ms);
    CHECK(world.board.mode() == Mode::kWaiting);
    CHECK(world.state().set_points[0] == kHome);
    CHECK(world.pulse(0, 0) == 251);
  }
}

TEST_CASE("IMUs: the mean of the readings of the chosen one; asleep, absent or of another kind is none") {
  World world;
  world.models.imus[3].set_raw({100, -200, 16384, 340, 131, 0, -262});
  world.models.imus[2] = Mpu6050Model(0x70);  // a clone by another maker
  world.models.imu_answers[1] = false;
  world.run(200);
  const auto ask = [&](std::uint8_t imu) {
    world.frames.clear();
    world.say(RigMessage::kReadImu, {5, imu, 4});
    world.run(300);
    REQUIRE(world.frames.size() == 1);
    return world.frames[0].body;
  };
  const Buffer good = ask(3);
  CHECK(good[2] == 4);
  CHECK(static_cast<std::int32_t>(get_u32(good.data() + 3 + 8)) == 9806650);
  CHECK(static_cast<std::int32_t>(get_u32(good.data() + 3 + 4)) == -119710);
  CHECK(static_cast<std::int32_t>(get_u32(good.data() + 15)) == 17453);
  CHECK(static_cast<std::int32_t>(get_u32(good.data() + 15 + 8)) == -34907);
  CHECK(get_u16(good.data() + 27) == 3753);
  for (const std::uint8_t imu : {std::uint8_t{1}, std::uint8_t{2}}) {
    const Buffer none = ask(imu);
    CHECK(none[2] == 0);
    CHECK(get_u32(none.data() + 3) == 0x80000000);
    CHECK(get_u16(none.data() + 27) == 0x8000);
  }
  world.frames.clear();
  world.say(RigMessage::kReadImu, {6, 5, 4});
  CHECK(world.result() == Result::kBadContent);
}

TEST_CASE("Frames of every kind that come cut anywhere, damaged or endless do not move anything") {
  World world;
  world.start();
  std::uint32_t seed = 1;
  const auto random = [&seed] { return (seed = seed * 1664525u + 1013904223u) >> 16; };
  for (int block = 0; block < 3000; ++block) {
    Buffer noise;
    for (std::uint32_t left = random() % 64; left != 0; --left) noise.push_back(static_cast<std::uint8_t>(random()));
    if (block % 3 == 0) append(noise, unhex("aa553000660d0f0100"));
    world.board.receive(view(noise));
    world.run(1);
  }
  CHECK(world.state().set_points[0] == kHome);
  CHECK(world.state().counters.bad_frames > 0);
  CHECK(world.board.mode() == Mode::kReady);
}

TEST_CASE("A line without room loses answers, not the board") {
  World world;
  world.start();
  world.line_full = true;
  world.move(1, kRaised, 2);
  world.run(150);
  CHECK(world.board.mode() == Mode::kReady);
  CHECK(world.state().set_points[0] == kRaised);
}
