#include <doctest/doctest.h>

#include <algorithm>

#include "brov/checksums.h"
#include "brov/kogger_framer.h"
#include "hex.h"
#include "vectors.h"

using namespace brov;

namespace {

class Run {
 public:
  explicit Run(KoggerChecksum checksum = KoggerChecksum::kMod256) : framer_(checksum) {}

  void feed(Bytes data) {
    fed_ += data.size;
    framer_.feed(data);
    KoggerFrame frame;
    while (framer_.next(frame)) {
      frames.push_back(to_hex(frame.raw));
      starts.push_back(fed_ - 1 - frame.behind);
    }
  }
  void feed(const Buffer& stream, std::size_t block) {
    for (std::size_t at = 0; at < stream.size(); at += block) {
      feed(Bytes{stream.data() + at, std::min(block, stream.size() - at)});
    }
  }
  std::uint32_t frames_ok() const { return framer_.frames_ok(); }
  std::uint32_t errors() const { return framer_.checksum_errors(); }
  bool idle() const { return framer_.idle(); }

  std::vector<std::string> frames;
  std::vector<std::size_t> starts;  // where in the stream they began, by `behind`

 private:
  KoggerFramer framer_;
  std::size_t fed_ = 0;
};

Buffer closed(Buffer frame, KoggerCheck (*check)(Bytes)) {
  const KoggerCheck sums = check(view(frame).from(2));
  frame.push_back(sums.c1);
  frame.push_back(sums.c2);
  return frame;
}

Buffer framed(std::uint8_t id, std::size_t size, KoggerCheck (*check)(Bytes) = kogger_mod256) {
  Buffer frame = {0xBB, 0x55, 0, 1, id, static_cast<std::uint8_t>(size)};
  for (std::size_t i = 0; i < size; ++i) frame.push_back(static_cast<std::uint8_t>(i * 29 + 200));
  return closed(frame, check);
}

Buffer joined(const vectors::Kogger& vector) {
  Buffer stream;
  for (const char* datagram : vector.datagrams) append(stream, unhex(datagram));
  return stream;
}

// A frame of the vectors in their own terms, but for the payload.
std::string described(const vectors::KoggerFrame& f) {
  std::string text;
  for (const int value : {f.route, f.type, f.version, f.mark, f.response, f.id, f.length}) {
    text += std::to_string(value) + " ";
  }
  return text + f.check;
}

std::string described(const std::string& hex) {
  const Buffer raw = unhex(hex);
  const KoggerFrame frame{view(raw), 0};
  const Buffer check = {raw[raw.size() - 2], raw[raw.size() - 1]};
  const std::string check_hex = to_hex(check);
  return described({1, raw[2], frame.type(), frame.version(), frame.mark(), raw[3] >> 7, frame.id(),
                    static_cast<int>(frame.payload().size), check_hex.c_str(), nullptr});
}

// Noise, a repeated sync, frames of several sizes, one inside another, a false start that swallows two frames.
Buffer mixed_stream() {
  Buffer stream = unhex("0055bbbb");
  append(stream, framed(3, 20));
  append(stream, framed(0x10, 0));
  append(stream, unhex("bb5500"));
  Buffer outer = unhex("bb5500016310");
  append(outer, framed(4, 8));
  append(stream, closed(outer, kogger_mod256));
  append(stream, unhex("cc55bb550001033c"));
  append(stream, framed(5, 17));
  append(stream, framed(3, 20, kogger_mod255));
  append(stream, framed(6, 33));
  return stream;
}

}  // namespace

// CC55 framing is the host's business: `kp2_chart` holds nothing else and gives no frame here. What else the vectors
// expect (pings, pending, duplicates_dropped, oversize_chunks, unsupported_chart_frames) is made of these frames by the
// host's ping assembly (tests/protocol/test_kogger_vectors.py); the board's own pings are docs/firmware-core.md section 2.
TEST_CASE("the BB55 frames of every shared vector: as given, joined and byte by byte") {
  REQUIRE(vectors::kogger.size() == 47);
  for (const auto& vector : vectors::kogger) {
    CAPTURE(vector.name);
    std::vector<std::string> expected;
    for (const auto& frame : vector.frames) {
      if (frame.v == 1) expected.push_back(described(frame));
    }
    CHECK(expected.empty() == (vector.frames.empty() || vector.name == std::string("kp2_chart")));
    Run runs[3];
    for (const char* datagram : vector.datagrams) runs[0].feed(unhex(datagram), KoggerFramer::kMaxFeed);
    runs[1].feed(joined(vector), KoggerFramer::kMaxFeed);
    runs[2].feed(joined(vector), 1);
    for (const Run& run : runs) {
      std::vector<std::string> found;
      for (const std::string& frame : run.frames) found.push_back(described(frame));
      CHECK(found == expected);
      CHECK(run.errors() == vector.bad_checksum);
      for (std::size_t i = 0, k = 0; i < vector.frames.size(); ++i) {
        const auto& frame = vector.frames[i];
        if (frame.v != 1) continue;
        if (frame.payload != nullptr && k < run.frames.size()) {
          CHECK(run.frames[k].substr(12, run.frames[k].size() - 16) == frame.payload);
        }
        ++k;
      }
    }
  }
}

TEST_CASE("each shared command is one frame") {
  REQUIRE(vectors::commands.size() == 45);
  for (const auto& command : vectors::commands) {
    CAPTURE(command.what);
    Run run;
    run.feed(unhex(command.frame), 1);
    CHECK(run.frames == std::vector<std::string>{command.frame});
    CHECK(run.idle());
  }
}

TEST_CASE("two blocks, cut anywhere, give what one block gives, and where each frame began") {
  const Buffer stream = mixed_stream();
  Run whole;
  whole.feed(view(stream));
  CHECK(whole.frames_ok() == 5);
  CHECK(whole.frames.size() == 5);
  CHECK(whole.errors() == 3);
  for (std::size_t i = 0; i < whole.frames.size(); ++i) {
    const Buffer raw = unhex(whole.frames[i]);
    REQUIRE(whole.starts[i] + raw.size() <= stream.size());
    CHECK(std::equal(raw.begin(), raw.end(), stream.begin() + static_cast<std::ptrdiff_t>(whole.starts[i])));
  }
  const auto check_same = [&whole](const Run& run) {
    CHECK(run.frames == whole.frames);
    CHECK(run.starts == whole.starts);
    CHECK(run.frames_ok() == whole.frames_ok());
    CHECK(run.errors() == whole.errors());
  };
  for (std::size_t cut = 0; cut <= stream.size(); ++cut) {
    CAPTURE(cut);
    Run run;
    run.feed(view(stream).first(cut));
    run.feed(view(stream).from(cut));
    check_same(run);
  }
  for (std::size_t block = 1; block < stream.size(); ++block) {
    CAPTURE(block);
    Run run;
    run.feed(stream, block);
    check_same(run);
  }
}

TEST_CASE("behind counts the bytes of earlier batches too") {
  const Buffer frame = framed(3, 4);
  KoggerFramer framer;
  KoggerFrame found;
  framer.feed(view(frame).first(5));
  REQUIRE_FALSE(framer.next(found));
  CHECK_FALSE(framer.idle());
  Buffer rest(frame.begin() + 5, frame.end());
  append(rest, framed(4, 0));
  rest.push_back(0x11);
  framer.feed(view(rest));
  REQUIRE(framer.next(found));
  CHECK(found.behind == 12 - 1 + 8 + 1);
  REQUIRE(framer.next(found));
  CHECK(found.behind == 8 - 1 + 1);
  REQUIRE_FALSE(framer.next(found));
  CHECK(framer.idle());
}

TEST_CASE("a damaged byte costs its own frame and no other") {
  const Buffer first = framed(3, 20), hurt = framed(4, 30), last = framed(5, 10);
  const Buffer padding(kMaxKoggerFrame);  // closes whatever a damaged length opened
  const std::vector<std::string> neighbours = {to_hex(first), to_hex(last)};
  for (std::size_t at = 0; at < hurt.size(); ++at) {
    for (int change = 1; change < 256; ++change) {
      Buffer stream = first;
      append(stream, hurt);
      stream[first.size() + at] = static_cast<std::uint8_t>(stream[first.size() + at] ^ change);
      append(stream, last);
      append(stream, padding);
      Run run;
      run.feed(stream, KoggerFramer::kMaxFeed);
      if (run.frames != neighbours) {
        CAPTURE(at);
        CAPTURE(change);
        CHECK(run.frames == neighbours);
      }
    }
  }
}

TEST_CASE("the longest frames and full blocks behind them fit, whatever the buffer held before") {
  const Buffer longest = framed(3, 255);
  REQUIRE(longest.size() == kMaxKoggerFrame);
  for (const std::size_t lead : {0u, 1u, 262u, 1000u, 1024u}) {
    for (const std::size_t block : {std::size_t{1}, KoggerFramer::kMaxFeed - 1, KoggerFramer::kMaxFeed}) {
      CAPTURE(lead);
      CAPTURE(block);
      Buffer stream(lead, 0x11);
      for (int i = 0; i < 20; ++i) append(stream, longest);
      Run run;
      run.feed(stream, block);
      CHECK(run.frames_ok() == 20);
      CHECK(run.errors() == 0);
      for (std::size_t i = 0; i < run.starts.size(); ++i) CHECK(run.starts[i] == lead + i * longest.size());
    }
  }
}

TEST_CASE("all but one byte of the longest frame, and a full block behind it") {
  Buffer stream = framed(3, 255);
  const std::size_t held = stream.size() - 1;
  const Buffer small = framed(4, 23);
  std::uint32_t count = 1;
  for (; stream.size() + small.size() <= held + KoggerFramer::kMaxFeed; ++count) append(stream, small);
  stream.resize(held + KoggerFramer::kMaxFeed, 0x11);
  Run run;
  run.feed(view(stream).first(held));
  CHECK(run.frames_ok() == 0);
  run.feed(view(stream).from(held));
  CHECK(run.frames_ok() == count);
  CHECK(run.errors() == 0);
  CHECK(run.idle());
}

TEST_CASE("auto changes to modulo 255 after ten frames in a row, and back") {
  // 200 bytes: their sums pass 255, so that each frame fits one algorithm only.
  const Buffer real = framed(3, 200), textbook = framed(3, 200, kogger_mod255);
  Run run(KoggerChecksum::kAuto), strict;
  const auto feed = [&](const Buffer& frame, int count) {
    for (int i = 0; i < count; ++i) {
      run.feed(view(frame));
      strict.feed(view(frame));
    }
  };
  feed(textbook, 9);
  feed(real, 1);
  CHECK(run.frames_ok() == 1);
  feed(textbook, 9);  // the good one between began the count anew
  feed(real, 1);
  CHECK(run.frames_ok() == 2);
  CHECK(run.errors() == 18);

  Buffer neither = real;
  neither.back() = static_cast<std::uint8_t>(neither.back() ^ 0x40);
  feed(textbook, 5);
  feed(neither, 1);  // damage belongs to neither and interrupts nothing
  feed(textbook, 5);
  CHECK(run.frames_ok() == 2);
  feed(textbook, 3);
  CHECK(run.frames_ok() == 5);

  feed(real, 10);
  CHECK(run.frames_ok() == 5);
  feed(real, 2);
  CHECK(run.frames_ok() == 7);
  feed(textbook, 1);
  CHECK(run.frames_ok() == 7);

  CHECK(strict.frames_ok() == 14);
  CHECK(strict.errors() == 18 + 14 + 1);
}
