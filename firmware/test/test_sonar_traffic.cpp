#include <doctest/doctest.h>

#include "rig.h"

using namespace brov;

namespace {

// The BB55 frames in all KOGGER_RAW payloads of a type.
Buffer raw_bytes(const Rig& rig, std::uint8_t type) {
  Buffer bytes;
  for (const SentFrame& frame : rig.sent(type)) bytes.insert(bytes.end(), frame.payload.begin() + 4, frame.payload.end());
  return bytes;
}

std::uint32_t t_us_of_raw(const SentFrame& frame) { return get_u32(frame.payload.data()); }

// One KOGGER_COMPRESSED payload's header.
struct Bundle {
  int channel, flags, decimation, chunks, number;
  std::uint32_t t_us;
  int first_offset, samples;
  bool last() const { return (flags & 0x40) != 0; }
  bool mark() const { return (flags & 0x20) != 0; }
  int version() const { return flags >> 2 & 7; }
};

std::vector<Bundle> bundles(const Rig& rig) {
  std::vector<Bundle> all;
  for (const SentFrame& frame : rig.sent(0x04)) {
    const Buffer& p = frame.payload;
    REQUIRE(p.size() > 16);
    all.push_back({p[0], p[1], p[2], p[3], p[4], get_u32(p.data() + 5), get_u16(p.data() + 9), 0});
    std::size_t at = 9;
    for (int i = 0; i < p[3]; ++i) {
      const int samples = p[at + 6];
      all.back().samples += samples;
      const int first = (samples + 1) / 2, second = samples / 2, d = p[2];
      at += 7 + static_cast<std::size_t>(all.back().version() == 0 ? (samples + d - 1) / d
                                                                  : (first + d - 1) / d + (second + d - 1) / d);
    }
    CHECK(at == p.size());
  }
  return all;
}

// Samples of every compressed ping, by ping number.
std::vector<int> ping_samples(const Rig& rig) {
  std::vector<int> samples;
  int open = 0;
  for (const Bundle& bundle : bundles(rig)) {
    open += bundle.samples;
    if (bundle.last()) {
      samples.push_back(open);
      open = 0;
    }
  }
  CHECK(open == 0);
  return samples;
}

using Samples = std::vector<int>;

}  // namespace

TEST_CASE("A ping ends 8 ms after its last chunk and carries the time of its first byte") {
  Rig rig;
  rig.send(Port::kSonarA, ping(1000), 10000);  // 1070 bytes: 11.61 ms
  rig.run_until(29000);
  CHECK(rig.sent(0x04).empty());  // the last chunk came in the tick at 22 ms
  rig.run_until(30000);
  const auto sent = bundles(rig);
  REQUIRE(sent.size() == 1);  // two payloads; the line takes the second one when the first is out
  rig.run_until(100000);
  const auto all = bundles(rig);
  REQUIRE(all.size() == 2);
  CHECK(all[0].channel == 0);
  CHECK(all[0].number == 1);
  CHECK(all[0].decimation == 4);
  CHECK(!all[0].last());
  CHECK(all[1].last());
  CHECK(all[0].t_us == all[1].t_us);
  // Times of bytes are known to a tick and the rest of the batch.
  CHECK(all[0].t_us > 10000 - 1000);
  CHECK(all[0].t_us <= 10000 + 1000);
  CHECK(ping_samples(rig) == Samples{1000});
}

TEST_CASE("The time of a first byte counts all bytes behind it, those of other ticks too") {
  Rig rig;
  rig.run_until(100000);
  Buffer chunk = chart(0, Buffer(200, 1));  // 214 bytes
  rig.send_at_once(Port::kSonarB, Buffer(chunk.begin(), chunk.begin() + 100));
  rig.run_for(1000);
  rig.send_at_once(Port::kSonarB, Buffer(chunk.begin() + 100, chunk.end()));
  rig.run_for(50000);
  const auto all = bundles(rig);
  REQUIRE(all.size() == 1);
  CHECK(all[0].channel == 1);
  CHECK(all[0].t_us == 102000 - 213 * 10000000u / 921600);
}

TEST_CASE("What ends a ping at once") {
  struct Case {
    const char* what;
    Buffer second;
  };
  const Buffer part(100, 50);
  const Case cases[] = {{"offset goes back", chart(0, part)},
                        {"offset overlaps", chart(99, part)},
                        {"other resolution", chart(100, part, {}, 31)},
                        {"other first sample", chart(100, part, {}, 30, 5)},
                        {"other version", chart(100, part, {1, 1})}};
  for (const Case& c : cases) {
    CAPTURE(c.what);
    Rig rig;
    rig.send(Port::kSonarA, chart(0, part));
    rig.send(Port::kSonarA, c.second);
    rig.run_until(60000);
    CHECK(ping_samples(rig) == Samples{100, 100});
  }
  Rig rig;
  rig.send(Port::kSonarA, chart(0, part));
  rig.send(Port::kSonarA, chart(100, part));
  rig.send(Port::kSonarA, chart(250, part));  // a gap does not end it
  rig.run_until(60000);
  CHECK(ping_samples(rig) == Samples{300});
}

TEST_CASE("A ping's MARK is that of its first frame") {
  Rig rig;
  rig.send(Port::kSonarA, chart(0, Buffer(100, 1), {1, 0, true}));
  rig.send(Port::kSonarA, chart(100, Buffer(100, 1)));
  rig.send(Port::kSonarA, chart(0, Buffer(100, 1)));
  rig.send(Port::kSonarA, chart(100, Buffer(100, 1), {1, 0, true}));
  rig.run_until(80000);
  const auto all = bundles(rig);
  REQUIRE(all.size() == 2);
  CHECK(all[0].mark());
  CHECK(!all[1].mark());
}

TEST_CASE("A ping that would outgrow its room ends before the frame that does not fit") {
  SUBCASE("frames") {
    Rig rig;
    rig.send(Port::kSonarA, ping(85 * 10, 0, {}, 10));
    rig.run_until(400000);
    CHECK(ping_samples(rig) == Samples{800, 50});
  }
  SUBCASE("bytes") {
    Rig rig;
    rig.send(Port::kSonarA, ping(8000, 0, {}, 200));  // 40 frames of 214 bytes; 38 fit 8192
    rig.run_until(400000);
    CHECK(ping_samples(rig) == Samples{7600, 400});
  }
}

TEST_CASE("Chart frames that break a rule are dropped, what is no chart is passed on untouched") {
  Rig rig;
  const Buffer no_samples = kogger_frame(3, {0, 0, 30, 0, 0, 0});
  const Buffer no_resolution = chart(0, Buffer(20, 1), {}, 0);
  const Buffer too_far = chart(19900, Buffer(100, 1));
  for (const Buffer& bad : {no_samples, no_resolution, too_far}) rig.send(Port::kSonarA, bad);
  rig.run_until(50000);
  CHECK(rig.sent(0x02).empty());
  CHECK(rig.sent(0x04).empty());

  Buffer others;
  append(others, kogger_frame(3, {1, 2, 3}, {1, 0, false, true}));  // a result, not an echo
  append(others, chart(0, Buffer(30, 1), {1, 7}));                 // raw charts
  append(others, kogger_frame(5, {0x10, 0x05}));
  rig.send(Port::kSonarA, others);
  rig.send(Port::kSonarA, chart(19899, Buffer(100, 1)));  // the last one that is allowed
  rig.run_until(100000);
  CHECK(raw_bytes(rig, 0x02) == others);
  CHECK(ping_samples(rig) == Samples{100});
  CHECK(rig.board->sonar(Channel::kA).packets() == 7);
}

TEST_CASE("Other frames of one batch share a payload as far as the limit goes") {
  Rig rig;
  Buffer others;
  for (int i = 0; i < 40; ++i) append(others, kogger_frame(5, {static_cast<std::uint8_t>(i), 0x05}));  // 10 bytes each
  rig.run_until(10000);
  rig.send_at_once(Port::kSonarB, others);
  rig.run_until(100000);
  const auto sent = rig.sent(0x03);
  REQUIRE(sent.size() == 2);
  CHECK(sent[0].payload.size() == 224);
  CHECK(sent[1].payload.size() == 184);
  CHECK(raw_bytes(rig, 0x03) == others);
  CHECK(t_us_of_raw(sent[0]) == 11000 - 399ull * 10000000u / 921600);
  CHECK(t_us_of_raw(sent[1]) == 11000 - 179ull * 10000000u / 921600);
}

TEST_CASE("A frame beyond the payload limit still goes, alone") {
  Rig rig;
  const Buffer large = kogger_frame(0x40, Buffer(255, 7));
  rig.send_at_once(Port::kSonarA, kogger_frame(5, {1, 2}));
  rig.send_at_once(Port::kSonarA, large);
  rig.run_until(100000);
  const auto sent = rig.sent(0x02);
  REQUIRE(sent.size() == 2);
  CHECK(Buffer(sent[1].payload.begin() + 4, sent[1].payload.end()) == large);
}

TEST_CASE("At 921600 whole pings travel untouched once their rate is known") {
  Rig rig(921600);
  Buffer expected;
  for (int i = 0; i < 20; ++i) {
    const Buffer one = ping(1000, static_cast<std::uint8_t>(i));
    rig.send(Port::kSonarA, one, 100000u * static_cast<std::uint64_t>(i));
    if (i > 0) append(expected, one);
  }
  rig.run_until(2200000);
  CHECK(ping_samples(rig) == Samples{1000});  // the first one: no rate yet
  CHECK(raw_bytes(rig, 0x02) == expected);
  for (const SentFrame& frame : rig.sent(0x02)) CHECK(frame.payload.size() <= 512);
  const auto sent = rig.sent(0x02);
  CHECK(t_us_of_raw(sent[0]) == t_us_of_raw(sent[1]));
  CHECK(rig.ask_status().pings_dropped[0] == 0);
}

TEST_CASE("Raw begins below 75 % of the line and ends at 85 %, both sonars together") {
  // Other frames: SENSORS and STATUS, 164 + 68 bytes a second; the line: 92 160.
  const auto raw_after = [](std::size_t slow_samples, std::size_t fast_samples) {
    Rig rig(921600);
    for (int i = 0; i < 100; ++i) {
      const std::size_t samples = i < 50 ? slow_samples : fast_samples;
      for (const Port port : {Port::kSonarA, Port::kSonarB}) {
        rig.send(port, ping(samples, 0), 100000u * static_cast<std::uint64_t>(i));
      }
    }
    rig.run_until(9900000);
    const std::size_t before = rig.sent(0x02).size();
    rig.run_until(10050000);
    return rig.sent(0x02).size() > before;
  };
  // Two sonars at 10 Hz: n samples are 20 * n * 214 / 200 bytes a second.
  CHECK(raw_after(3200, 3200));        // 68 480 + 232 < 69 120
  CHECK(!raw_after(3400, 3400));       // 72 760
  CHECK(raw_after(3000, 3600));        // 77 040 < 78 336 and raw already
  CHECK(!raw_after(3000, 3800));       // 81 320
}

TEST_CASE("The measured rate follows a change by a fifth with each ping") {
  Rig rig(921600);
  for (int i = 0; i < 60; ++i) {
    const std::size_t samples = i < 40 ? 3000 : 4300;
    for (const Port port : {Port::kSonarA, Port::kSonarB}) {
      rig.send(port, ping(samples, 0), 100000u * static_cast<std::uint64_t>(i) + (port == Port::kSonarB ? 40000 : 0));
    }
  }
  rig.run_until(6100000);
  // From 32 100 bytes/s a sonar to 4608 bytes each 114 ms and then each 100 ms: 33 760, 36 220, 38 190, 39 770. Both
  // together with 232 others pass 78 336 with B's fourth.
  // A's second ping ends before B has a rate.
  CHECK(raw_bytes(rig, 0x02).size() == 38u * 3210 + 4 * 4608);
  CHECK(raw_bytes(rig, 0x03).size() == 39u * 3210 + 3 * 4608);
}

TEST_CASE("The time of a first byte that came before the wrap is not clamped") {
  const std::uint64_t tick_us = ((std::uint64_t{1} << 32) / 1000 + 1) * 1000;  // 704 us behind the wrap
  Rig rig(115200, tick_us - 1000);
  rig.send_at_once(Port::kSonarA, chart(0, Buffer(200, 1)));
  rig.run_for(50000);
  const auto all = bundles(rig);
  REQUIRE(all.size() == 1);
  CHECK(all[0].t_us == static_cast<std::uint32_t>(tick_us - 213 * 10000000u / 921600));
}

TEST_CASE("A channel that was heard but whose rate is not known keeps both compressed") {
  Rig rig(921600);
  rig.send(Port::kSonarB, kogger_frame(5, {1, 2}));
  for (int i = 0; i < 5; ++i) rig.send(Port::kSonarA, ping(500), 100000u * static_cast<std::uint64_t>(i));
  rig.run_until(600000);
  CHECK(ping_samples(rig) == Samples{500, 500, 500, 500, 500});
  for (int i = 6; i < 9; ++i) {
    rig.send(Port::kSonarB, ping(500), 100000u * static_cast<std::uint64_t>(i));
    rig.send(Port::kSonarA, ping(500), 100000u * static_cast<std::uint64_t>(i));
  }
  rig.run_until(1000000);
  CHECK(!rig.sent(0x02).empty());
  CHECK(!rig.sent(0x03).empty());
}

TEST_CASE("At 115200 a slow sonar travels raw, with frames beyond the limit compressed") {
  Rig rig;
  for (int i = 0; i < 4; ++i) rig.send(Port::kSonarA, ping(400), 500000u * static_cast<std::uint64_t>(i));
  rig.run_until(2400000);
  CHECK(!rig.sent(0x02).empty());
  const std::size_t compressed = rig.sent(0x04).size();
  for (int i = 5; i < 8; ++i) rig.send(Port::kSonarA, ping(249, 0, {}, 249), 500000u * static_cast<std::uint64_t>(i));
  rig.run_until(4400000);
  CHECK(rig.sent(0x04).size() == compressed + 3);
}

TEST_CASE("Ping numbers count compressed pings of each channel, dropped ones too, and wrap") {
  Rig rig;
  for (int i = 0; i < 300; ++i) rig.send(Port::kSonarA, chart(0, Buffer(20, 1)), 30000u * static_cast<std::uint64_t>(i));
  rig.send(Port::kSonarB, chart(0, Buffer(20, 1)), 4500000);
  // Raw never begins: B is heard once and has no rate.
  rig.run_until(10000000);
  int expected = 1;
  std::size_t of_a = 0;
  for (const Bundle& bundle : bundles(rig)) {
    if (bundle.channel == 1) {
      CHECK(bundle.number == 1);
      continue;
    }
    ++of_a;
    if (of_a > 151) CHECK(bundle.number == (expected & 0xFF));
    expected = bundle.number + 1;
  }
  CHECK(of_a > 100);

  Rig busy;  // pings of 5000 samples do not fit the line; numbers tell how many are missing
  for (int i = 0; i < 30; ++i) busy.send(Port::kSonarA, ping(5000), 100000u * static_cast<std::uint64_t>(i));
  busy.run_until(6000000);
  const auto dropped = busy.ask_status().pings_dropped[0];
  CHECK(dropped > 5);
  CHECK(bundles(busy).back().number == 30);
  CHECK(ping_samples(busy).size() == 30 - dropped);
}

TEST_CASE("A sonar that is heard from the middle of a ping on: its rest is a ping, the next is whole") {
  Rig rig;
  const Buffer whole = ping(1000);
  rig.send(Port::kSonarA, Buffer(whole.begin() + 481, whole.end()));
  rig.send(Port::kSonarA, whole, 100000);
  rig.run_until(200000);
  CHECK(ping_samples(rig) == Samples{400, 1000});
  CHECK(bundles(rig)[0].first_offset == 600);
}

TEST_CASE("A sonar whose checks are modulo 255 is understood after ten frames, and back") {
  Rig rig;
  const auto chunk = [](bool mod255) {
    Buffer payload = {0, 0, 30, 0, 0, 0};
    payload.insert(payload.end(), 200, 200);
    return kogger_frame(3, payload, {}, mod255);
  };
  for (int i = 0; i < 12; ++i) rig.send(Port::kSonarA, chunk(true));
  rig.run_until(100000);
  CHECK(rig.board->sonar(Channel::kA).packets() == 2);
  CHECK(rig.board->sonar(Channel::kA).frame_errors() >= 10);
  for (int i = 0; i < 12; ++i) rig.send(Port::kSonarA, chunk(false));
  rig.run_until(200000);
  CHECK(rig.board->sonar(Channel::kA).packets() == 4);
}

TEST_CASE("A receive ring that is full loses the newest bytes, counts them, and the stream heals") {
  Rig rig;
  Buffer flood;
  for (int i = 0; i < 20; ++i) append(flood, ping(1000, static_cast<std::uint8_t>(i)));  // 21 400 bytes at one instant
  rig.send_at_once(Port::kSonarA, flood);
  rig.run_for(40000);
  CHECK(rig.board->sonar(Channel::kA).bytes() == 16384);
  CHECK(rig.ask_status().overflow_bytes[0] == 21400 - 16384);
  CHECK(rig.ask_status().overflow_bytes[1] == 0);
  const std::size_t before = ping_samples(rig).size();
  rig.send(Port::kSonarA, ping(1000), rig.now_us + 100000);
  rig.run_for(400000);
  CHECK(ping_samples(rig).size() > before);
  CHECK(ping_samples(rig).back() == 1000);
}

TEST_CASE("16 KB of garbage on a sonar's wire: counted, the pace kept, the next ping whole") {
  Rig rig;
  rig.send(Port::kSonarA, noise(16384, 3));
  Buffer syncs;  // the worst kind: every second byte opens a frame
  for (int i = 0; i < 8192; ++i) append(syncs, {0xBB, 0x55});
  rig.send(Port::kSonarB, syncs);
  rig.run_until(300000);
  rig.send(Port::kSonarA, ping(1000));
  rig.send(Port::kSonarB, ping(1000));
  rig.run_until(1200000);
  CHECK(ping_samples(rig) == Samples{1000, 1000});
  CHECK(rig.ask_status().frame_errors[1] > 1000);
  const auto sensors = rig.sent(0x01);
  REQUIRE(sensors.size() == 3);
  for (std::size_t i = 0; i < sensors.size(); ++i) CHECK(sensors[i].starts_us - (50000 + 500000 * i) <= 20000);
}
