#include <doctest/doctest.h>

#include "brov/transmitter.h"
#include "rig.h"

using namespace brov;

namespace {

struct Line {
  explicit Line(std::uint32_t baud, std::uint64_t boot_us = 0)
      : hal(baud), transmitter(std::make_unique<Transmitter>(hal, baud, boot_us)), now_us(boot_us) {}

  void put(Urgency urgency, MessageType type, std::size_t size) {
    const Buffer payload(size, 0x11);
    transmitter->queue().put(urgency, type, view(payload));
  }
  void other(std::size_t frame_bytes) { put(Urgency::kSonarOther, MessageType::kKoggerRawA, frame_bytes - kFrameOverhead); }
  void ack() { put(Urgency::kAcks, MessageType::kCommandAck, kAckBytes); }
  void run_for(std::uint64_t us) {
    for (const std::uint64_t until = now_us + us; now_us < until;) {
      now_us += 1000;
      transmitter->tick(now_us);
    }
  }
  std::vector<int> types() const {
    std::vector<int> types;
    for (const SentFrame& frame : hal.link) types.push_back(frame.type);
    return types;
  }

  TestHal hal;
  std::unique_ptr<Transmitter> transmitter;
  std::uint64_t now_us;
};

using Types = std::vector<int>;

}  // namespace

TEST_CASE("No more than a window of bytes lies in the line, and it is filled to the byte") {
  for (const auto& [rate, window] : {std::pair{115200u, 230u}, std::pair{921600u, 552u}}) {
    const auto baud = rate;  // CAPTURE is a lambda, into which clang lets no structured binding
    CAPTURE(baud);
    Line line(baud);
    line.other(window - 100);
    line.other(100);
    line.other(20);
    line.run_for(1000);
    CHECK(line.hal.link.size() == 2);

    Line over(baud);
    over.other(window - 100);
    over.other(101);
    over.run_for(1000);
    CHECK(over.hal.link.size() == 1);
  }
}

TEST_CASE("A frame longer than the window goes when the line is empty") {
  Line line(115200);
  line.other(100);
  line.other(273);
  line.run_for(1000);
  CHECK(line.hal.link.size() == 1);
  line.run_for(7000);  // 100 bytes take 8.68 ms
  CHECK(line.hal.link.size() == 1);
  line.run_for(2000);
  CHECK(line.hal.link.size() == 2);
}

TEST_CASE("What is less urgent never passes a frame that waits for room") {
  Line line(115200);
  line.other(200);
  line.run_for(1000);
  line.put(Urgency::kSensors, MessageType::kSensors, kSensorsBytes);  // 82 bytes do not fit behind 189
  line.ack();                                                        // 9 bytes would
  line.run_for(1000);
  CHECK(line.types() == Types{0x02});
  line.run_for(20000);
  CHECK(line.types() == Types{0x02, 0x01, 0x07});
}

TEST_CASE("Changed baud rate: behind its acknowledgement, when the line is empty, other frames wait") {
  Line line(115200);
  line.other(200);
  line.run_for(1000);
  line.ack();
  line.other(50);
  line.put(Urgency::kSensors, MessageType::kSensors, kSensorsBytes);
  line.transmitter->request_baud(921600);
  line.run_for(1000);
  CHECK(line.types() == Types{0x02, 0x07});
  CHECK(line.hal.baud_changes.empty());
  line.run_for(30000);
  REQUIRE(line.hal.baud_changes.size() == 1);
  CHECK(line.hal.baud_changes[0].baud == 921600);
  // 209 bytes from 1 ms on are out at 19.14 ms; the next tick changes and sends in one go.
  CHECK(line.hal.baud_changes[0].at_us == 20000);
  CHECK(line.types() == Types{0x02, 0x07, 0x01, 0x02});
  CHECK(line.hal.link[2].at_us == 20000);
  CHECK(line.transmitter->payload_limit() == 512);
}

TEST_CASE("A rate on trial falls back after 5 s of silence, at once, with the line as it is") {
  Line line(115200);
  line.transmitter->request_baud(921600);
  line.run_for(1000);
  REQUIRE(line.hal.baud_changes.size() == 1);
  line.run_for(4999000);
  CHECK(line.hal.baud_changes.size() == 1);
  line.other(518);
  line.other(518);
  line.run_for(1000);
  REQUIRE(line.hal.baud_changes.size() == 2);
  CHECK(line.hal.baud_changes[1].baud == 115200);
  CHECK(line.hal.baud_changes[1].at_us == 5001000);
  CHECK(line.transmitter->baud() == 115200);
  line.run_for(20000000);
  CHECK(line.hal.baud_changes.size() == 2);
}

TEST_CASE("A rate at which the host is heard stays") {
  Line line(115200);
  line.transmitter->request_baud(921600);
  line.run_for(4000000);
  line.transmitter->host_heard();
  line.run_for(10000000);
  CHECK(line.hal.baud_changes.size() == 1);
  CHECK(line.transmitter->baud() == 921600);
  // And the next change falls back to it.
  line.transmitter->request_baud(115200);
  line.run_for(6000000);
  REQUIRE(line.hal.baud_changes.size() == 3);
  CHECK(line.transmitter->baud() == 921600);
}

TEST_CASE("The present rate cancels a change that still waits") {
  Line line(115200);
  line.other(200);
  line.run_for(1000);
  line.transmitter->request_baud(921600);
  line.run_for(1000);
  line.transmitter->request_baud(115200);
  line.other(50);
  line.run_for(100000);
  CHECK(line.hal.baud_changes.empty());
  CHECK(line.hal.link.size() == 2);
}

TEST_CASE("The load is measured over at least half a second and rounds half up") {
  Line line(115200);
  CHECK(line.transmitter->other_bytes_per_s() == 1500);
  line.other(230);
  line.ack();
  line.run_for(499000);
  line.transmitter->measure(line.now_us);
  CHECK(line.transmitter->load_percent() == 0);
  CHECK(line.transmitter->other_bytes_per_s() == 1500);
  line.run_for(1000);
  line.transmitter->measure(line.now_us);
  CHECK(line.transmitter->load_percent() == 4);  // 239 of 5760 bytes: 4.15 %
  CHECK(line.transmitter->other_bytes_per_s() == 18);  // the acknowledgement
  for (int i = 0; i < 4; ++i) line.other(216);
  line.run_for(1000000);
  line.transmitter->measure(line.now_us);
  CHECK(line.transmitter->load_percent() == 8);  // 864 of 11520 bytes: 7.5 %
  CHECK(line.transmitter->other_bytes_per_s() == 0);
  CHECK(line.transmitter->tx_bytes() == 239 + 864);
}

TEST_CASE("The paced line counts exactly, up to the wraps of the millisecond counter") {
  PacedLine line(115200);
  line.write(1, 0);
  CHECK(line.backlog(0) == 1);
  CHECK(line.backlog(86) == 1);  // a byte takes 86.8 us
  CHECK(line.backlog(87) == 0);
  const std::uint64_t late_us = (std::uint64_t{1} << 32) * 1000;
  line.write(11520, late_us);
  CHECK(line.backlog(late_us + 999999) == 1);
  CHECK(line.backlog(late_us + 1000000) == 0);
  line.write(100, late_us + 1000000);
  line.set_baud(921600, late_us + 1000000);
  CHECK(line.backlog(late_us + 1000000) == 0);
}
