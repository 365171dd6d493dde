#include <doctest/doctest.h>

#include <memory>

#include "brov/send_queue.h"
#include "hex.h"

using namespace brov;

namespace {

constexpr std::uint32_t kSlowLine = 11520;  // bytes per second; 15 % of it are 1728 bytes
constexpr std::uint32_t kFastLine = 92160;  // 13 824 bytes

class Queue {
 public:
  // A ping of frames of these payload sizes; the first payload byte tells it apart.
  void ping(Channel channel, std::uint8_t name, std::initializer_list<std::size_t> sizes, std::uint32_t line = kSlowLine) {
    queue_->begin_ping(channel);
    for (const std::size_t size : sizes) {
      Buffer payload(size, static_cast<std::uint8_t>(channel));
      payload[0] = name;
      queue_->ping_payload(MessageType::kKoggerCompressed, view(payload));
    }
    queue_->end_ping(line);
  }
  void put(Urgency urgency, MessageType type, std::uint8_t name, std::size_t size) {
    const Buffer payload(size, name);
    queue_->put(urgency, type, view(payload));
  }
  // Name of the next frame, 0 for none.
  int take(bool acks_only = false) {
    const std::size_t length = queue_->next_length(acks_only);
    if (length == 0) return 0;
    std::uint8_t frame[SendQueue::kMaxFrame];
    CHECK(queue_->take(acks_only, frame) == length);
    Buffer again(length);
    CHECK(encode_frame(static_cast<MessageType>(frame[2]), Bytes(frame + 5, length - 6), again.data()) == length);
    CHECK(again == Buffer(frame, frame + length));
    return frame[5];
  }
  std::vector<int> take_all() {
    std::vector<int> names;
    while (const int name = take()) names.push_back(name);
    return names;
  }
  std::uint32_t dropped(Channel channel) const { return queue_->pings_dropped(channel); }
  SendQueue& operator*() { return *queue_; }

 private:
  std::unique_ptr<SendQueue> queue_ = std::make_unique<SendQueue>();
};

using Names = std::vector<int>;

}  // namespace

TEST_CASE("The more urgent goes first, within one urgency the older") {
  Queue queue;
  queue.ping(Channel::kA, 10, {100});
  queue.put(Urgency::kSonarOther, MessageType::kKoggerRawA, 9, 20);
  queue.put(Urgency::kReports, MessageType::kStatus, 7, 62);
  queue.put(Urgency::kReports, MessageType::kGps, 8, 32);
  queue.put(Urgency::kAcks, MessageType::kCommandAck, 5, 3);
  queue.put(Urgency::kAcks, MessageType::kCommandAck, 6, 3);
  queue.put(Urgency::kSensors, MessageType::kSensors, 4, 76);
  CHECK(queue.take_all() == Names{4, 5, 6, 7, 8, 9, 10});
}

TEST_CASE("During a change of the baud rate only acknowledgements are given out") {
  Queue queue;
  queue.put(Urgency::kSensors, MessageType::kSensors, 1, 76);
  CHECK(queue.take(true) == 0);
  queue.put(Urgency::kAcks, MessageType::kCommandAck, 2, 3);
  CHECK(queue.take(true) == 2);
  CHECK((*queue).acks_empty());
  CHECK(queue.take_all() == Names{1});
}

TEST_CASE("A full queue loses its oldest frame") {
  Queue queue;
  for (std::uint8_t i = 1; i <= 6; ++i) queue.put(Urgency::kSensors, MessageType::kSensors, i, 76);
  for (std::uint8_t i = 11; i <= 45; ++i) queue.put(Urgency::kAcks, MessageType::kCommandAck, i, 3);
  for (std::uint8_t i = 51; i <= 85; ++i) queue.put(Urgency::kReports, MessageType::kStatus, i, 62);
  for (std::uint8_t i = 101; i <= 135; ++i) queue.put(Urgency::kSonarOther, MessageType::kKoggerRawA, i, 12);
  Names expected;
  for (int i = 3; i <= 6; ++i) expected.push_back(i);
  for (int i = 14; i <= 45; ++i) expected.push_back(i);
  for (int i = 54; i <= 85; ++i) expected.push_back(i);
  for (int i = 104; i <= 135; ++i) expected.push_back(i);
  CHECK(queue.take_all() == expected);
}

TEST_CASE("Other sonar frames are limited in bytes too, and lost ones counted for their channel") {
  Queue queue;
  // 16 frames of 500 + 6 + 2 bytes are 8128.
  for (std::uint8_t i = 1; i <= 8; ++i) queue.put(Urgency::kSonarOther, MessageType::kKoggerRawA, i, 500);
  for (std::uint8_t i = 9; i <= 16; ++i) queue.put(Urgency::kSonarOther, MessageType::kKoggerRawB, i, 500);
  CHECK((*queue).lost_sonar_bytes(Channel::kA) == 0);
  for (std::uint8_t i = 17; i <= 26; ++i) queue.put(Urgency::kSonarOther, MessageType::kKoggerRawB, i, 500);
  CHECK((*queue).lost_sonar_bytes(Channel::kA) == 8 * 500);
  CHECK((*queue).lost_sonar_bytes(Channel::kB) == 2 * 500);
  CHECK(queue.take() == 11);
}

TEST_CASE("Pings go in the order in which they ended, whole ones, of both channels") {
  Queue queue;
  queue.ping(Channel::kB, 1, {100, 100});
  queue.ping(Channel::kA, 2, {100});
  queue.ping(Channel::kA, 3, {100, 100, 100});
  queue.ping(Channel::kB, 4, {50});
  CHECK(queue.take_all() == Names{1, 1, 2, 3, 3, 3, 4});
  CHECK(queue.dropped(Channel::kA) + queue.dropped(Channel::kB) == 0);
}

TEST_CASE("A ping that was begun is finished before other pings, but passed by more urgent frames") {
  Queue queue;
  queue.ping(Channel::kB, 1, {100, 100});
  queue.ping(Channel::kA, 2, {100});
  CHECK(queue.take() == 1);
  queue.put(Urgency::kSonarOther, MessageType::kKoggerRawA, 9, 20);
  CHECK(queue.take_all() == Names{9, 1, 2});
}

TEST_CASE("Nothing of a ping is given out before it is complete") {
  Queue queue;
  (*queue).begin_ping(Channel::kA);
  const Buffer payload(100, 1);
  (*queue).ping_payload(MessageType::kKoggerCompressed, view(payload));
  CHECK((*queue).next_length(false) == 0);
  (*queue).end_ping(kSlowLine);
  CHECK((*queue).next_length(false) == 106);
}

TEST_CASE("Too many waiting bytes: whole pings are dropped, the channels in turn, A first") {
  Queue queue;
  queue.ping(Channel::kA, 9, {418});  // the next to go
  queue.ping(Channel::kA, 1, {418});
  queue.ping(Channel::kB, 2, {418});
  queue.ping(Channel::kA, 3, {418});
  queue.ping(Channel::kB, 4, {418});  // 4 x 424 = 1696 bytes
  CHECK(queue.dropped(Channel::kA) + queue.dropped(Channel::kB) == 0);
  queue.ping(Channel::kA, 5, {418});
  CHECK(queue.dropped(Channel::kA) == 1);
  queue.ping(Channel::kB, 6, {418});
  CHECK(queue.dropped(Channel::kB) == 1);
  queue.ping(Channel::kB, 7, {418});
  CHECK(queue.dropped(Channel::kA) == 2);
  CHECK(queue.dropped(Channel::kB) == 1);
  CHECK(queue.take_all() == Names{9, 4, 5, 6, 7});
}

TEST_CASE("The other channel loses a ping where the one in turn has none, and that counts as its turn") {
  Queue queue;
  queue.ping(Channel::kB, 9, {418});  // the next to go
  for (std::uint8_t i = 1; i <= 6; ++i) queue.ping(Channel::kB, i, {418});
  CHECK(queue.dropped(Channel::kB) == 2);
  queue.ping(Channel::kA, 7, {418});  // after a drop of B it is A's turn: its only one goes
  CHECK(queue.dropped(Channel::kA) == 1);
  queue.ping(Channel::kA, 8, {418});
  CHECK(queue.dropped(Channel::kB) == 3);
  CHECK(queue.take_all() == Names{9, 4, 5, 6, 8});
}

TEST_CASE("After one drop of B for want of A it is A's turn still") {
  Queue queue;
  queue.ping(Channel::kB, 9, {418});  // the next to go
  for (std::uint8_t i = 1; i <= 5; ++i) queue.ping(Channel::kB, i, {418});
  CHECK(queue.dropped(Channel::kB) == 1);
  queue.ping(Channel::kA, 6, {418});
  CHECK(queue.dropped(Channel::kA) == 1);
  CHECK(queue.dropped(Channel::kB) == 1);
}

TEST_CASE("A single waiting ping stays, however long it is") {
  Queue queue;
  queue.ping(Channel::kA, 1, {500, 500, 500, 500});
  CHECK(queue.take_all() == Names{1, 1, 1, 1});
  CHECK(queue.dropped(Channel::kA) == 0);
}

TEST_CASE("The limit follows the line: 15 % of its bytes per second") {
  Queue slow, fast;
  for (std::uint8_t i = 0; i <= 8; ++i) {  // 0 is the next to go
    slow.ping(Channel::kA, i, {210}, kSlowLine);  // 216 bytes each: 8 are exactly 1728
    fast.ping(Channel::kA, i, {210}, kFastLine);
  }
  CHECK(slow.dropped(Channel::kA) == 0);
  slow.ping(Channel::kA, 9, {210}, kSlowLine);
  fast.ping(Channel::kA, 9, {210}, kFastLine);
  CHECK(slow.dropped(Channel::kA) == 1);
  CHECK(fast.dropped(Channel::kA) == 0);
}

TEST_CASE("Two pings that end together on an idle line both go, however long they are") {
  Queue queue;
  queue.ping(Channel::kA, 1, {500, 500, 500, 500});
  queue.ping(Channel::kB, 2, {500, 500, 500, 500});  // 2024 bytes wait, more than the limit
  CHECK(queue.dropped(Channel::kA) + queue.dropped(Channel::kB) == 0);
  CHECK(queue.take_all() == Names{1, 1, 1, 1, 2, 2, 2, 2});
}

TEST_CASE("The ping being sent is neither counted as waiting nor dropped") {
  Queue queue;
  queue.ping(Channel::kA, 1, {500, 500, 500});
  CHECK(queue.take() == 1);
  queue.ping(Channel::kA, 2, {400, 400});
  CHECK(queue.dropped(Channel::kA) == 0);  // 1012 still to send and 812 waiting
  queue.ping(Channel::kA, 3, {500, 500});
  CHECK(queue.dropped(Channel::kA) == 1);
  CHECK(queue.take_all() == Names{1, 1, 3, 3});
}

TEST_CASE("Dropping behind the ping being sent keeps every byte of the others") {
  Queue queue;
  for (std::uint8_t round = 1; round <= 200; ++round) {  // so that the ring wraps in all places
    const std::size_t odd = 300 + round;
    queue.ping(Channel::kA, 1, {odd, odd, 200});
    CHECK(queue.take() == 1);
    queue.ping(Channel::kA, 2, {odd, 499});
    queue.ping(Channel::kA, 3, {odd + 1, 512});
    queue.ping(Channel::kA, 4, {511});
    // 2 goes when 3 comes, 3 when 4 comes unless both fit.
    const Names rest = queue.take_all();
    REQUIRE(rest.size() >= 3);
    CHECK(rest[0] == 1);
    CHECK(rest[1] == 1);
    CHECK(rest.back() == 4);
  }
}

TEST_CASE("A ping that does not fit its channel's store is dropped, others stay") {
  Queue queue;
  const auto fill = {std::size_t{504}, std::size_t{504}, std::size_t{504}, std::size_t{504}, std::size_t{504},
                     std::size_t{504}, std::size_t{504}, std::size_t{504}};  // 8 x 512 = 4096 with the lengths
  queue.ping(Channel::kA, 1, fill, 1000000);
  queue.ping(Channel::kA, 2, fill, 1000000);
  queue.ping(Channel::kA, 3, fill, 1000000);  // 12 288: full to the byte
  CHECK(queue.dropped(Channel::kA) == 0);
  queue.ping(Channel::kA, 4, {10}, 1000000);
  CHECK(queue.dropped(Channel::kA) == 1);
  queue.ping(Channel::kB, 5, {10}, 1000000);
  CHECK(queue.dropped(Channel::kB) == 0);
  CHECK(queue.take() == 1);
  queue.ping(Channel::kA, 6, {504}, 1000000);  // the frame that was taken made room for this one
  CHECK(queue.dropped(Channel::kA) == 1);
  queue.ping(Channel::kA, 7, {10, 504, 504}, 1000000);  // part of it was written already
  CHECK(queue.dropped(Channel::kA) == 2);
  Names expected(7, 1);
  expected.insert(expected.end(), 8, 2);
  expected.insert(expected.end(), 8, 3);
  expected.insert(expected.end(), {5, 6});
  CHECK(queue.take_all() == expected);
}

TEST_CASE("What was written of a ping that did not fit leaves nothing behind") {
  Queue queue;
  for (int round = 0; round < 30; ++round) {  // so that the ring wraps
    for (std::uint8_t i = 1; i <= 3; ++i) queue.ping(Channel::kA, i, {512, 512, 512, 512, 512, 512, 512}, 1000000);
    CHECK(queue.take() == 1);
    queue.ping(Channel::kA, 4, {500, 512, 512, 512}, 1000000);  // its last frame finds no room
    queue.ping(Channel::kA, 5, {500}, 1000000);
    CHECK(queue.dropped(Channel::kA) == static_cast<std::uint32_t>(round + 1));
    Names expected(6, 1);
    expected.insert(expected.end(), 7, 2);
    expected.insert(expected.end(), 7, 3);
    expected.push_back(5);
    CHECK(queue.take_all() == expected);
  }
}

TEST_CASE("Sonar data can be lost as a whole, and are counted; the rest stays") {
  Queue queue;
  queue.put(Urgency::kReports, MessageType::kStatus, 9, 62);
  queue.ping(Channel::kA, 1, {100, 100});
  queue.ping(Channel::kB, 2, {100});
  queue.ping(Channel::kB, 3, {100});
  CHECK(queue.take() == 9);
  CHECK(queue.take() == 1);
  queue.put(Urgency::kSonarOther, MessageType::kKoggerRawB, 7, 30);
  queue.put(Urgency::kAcks, MessageType::kCommandAck, 8, 3);
  (*queue).drop_sonar_data();
  CHECK(queue.dropped(Channel::kA) == 1);
  CHECK(queue.dropped(Channel::kB) == 2);
  CHECK((*queue).lost_sonar_bytes(Channel::kB) == 30);
  queue.ping(Channel::kB, 4, {100});
  CHECK(queue.take_all() == Names{8, 4});
}

TEST_CASE("A channel holds 16 pings, the one being sent included") {
  Queue queue;
  for (std::uint8_t i = 1; i <= 17; ++i) queue.ping(Channel::kA, i, {10, 10});
  CHECK(queue.dropped(Channel::kA) == 1);
  CHECK(queue.take() == 1);
  queue.ping(Channel::kA, 18, {10});
  CHECK(queue.dropped(Channel::kA) == 2);
  CHECK(queue.take() == 1);
  queue.ping(Channel::kA, 19, {10});
  CHECK(queue.dropped(Channel::kA) == 2);
}
