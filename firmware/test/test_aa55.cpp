#include <doctest/doctest.h>

#include <algorithm>

#include "brov/aa55.h"
#include "hex.h"
#include "vectors.h"

using namespace brov;

namespace {

// What came out of a decoder: "type:payload" for each frame.
struct Decoded {
  std::vector<std::string> frames;
  DecoderCounters counters;
};

std::string described(std::uint8_t type, Bytes payload) { return to_hex(Bytes{&type, 1}) + ":" + to_hex(payload); }

class Run {
 public:
  void feed(Bytes data) {
    decoder_.feed(data);
    FrameDecoder::Frame frame;
    while (decoder_.next(frame)) frames_.push_back(described(frame.type, frame.payload));
  }
  Decoded result() const { return {frames_, decoder_.counters()}; }

 private:
  FrameDecoder decoder_;
  std::vector<std::string> frames_;
};

Decoded decoded(const Buffer& stream, std::size_t block = FrameDecoder::kMaxFeed) {
  Run run;
  for (std::size_t at = 0; at < stream.size(); at += block) {
    run.feed({stream.data() + at, std::min(block, stream.size() - at)});
  }
  return run.result();
}

void check_equal(const Decoded& a, const Decoded& b) {
  CHECK(a.frames == b.frames);
  CHECK(a.counters.frames_ok == b.counters.frames_ok);
  CHECK(a.counters.checksum_errors == b.counters.checksum_errors);
  CHECK(a.counters.length_errors == b.counters.length_errors);
  CHECK(a.counters.bytes_skipped == b.counters.bytes_skipped);
}

Buffer encoded(MessageType type, const Buffer& payload) {
  Buffer frame(payload.size() + kFrameOverhead);
  encode_frame(type, view(payload), frame.data());
  return frame;
}

Buffer counting(std::size_t size) {
  Buffer bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i * 7 + 3);
  return bytes;
}

// Frames of several types, one with a whole frame in its payload, with noise and half a frame between them.
Buffer mixed_stream() {
  Buffer stream = unhex("00aaaa");
  append(stream, encoded(MessageType::kSensors, counting(76)));
  append(stream, encoded(MessageType::kCommandAck, unhex("201100")));
  append(stream, unhex("aa5501004b"));  // a length that SENSORS cannot have
  Buffer raw = unhex("40e20100");
  append(raw, encoded(MessageType::kCommandAck, unhex("201200")));
  append(stream, encoded(MessageType::kKoggerRawA, raw));
  append(stream, unhex("aa550600450102"));  // a STATUS that breaks off and swallows what follows
  append(stream, encoded(MessageType::kTimeSync, counting(9)));
  append(stream, encoded(static_cast<MessageType>(0x7E), {}));
  append(stream, encoded(MessageType::kGps, counting(32)));
  append(stream, encoded(MessageType::kConfig, counting(11)));
  return stream;
}

}  // namespace

TEST_CASE("every shared frame is decoded and encodes to itself, byte by byte as well") {
  REQUIRE(vectors::frames.size() == 33);
  for (const auto& vector : vectors::frames) {
    CAPTURE(vector.name);
    const Buffer frame = unhex(vector.frame);
    const Bytes payload = view(frame).first(frame.size() - 1).from(5);
    for (const std::size_t block : {FrameDecoder::kMaxFeed, std::size_t{1}}) {
      const Decoded result = decoded(frame, block);
      CHECK(result.frames == std::vector<std::string>{described(vector.type, payload)});
      CHECK(result.counters.bytes_skipped == 0);
    }
    CHECK(encoded(static_cast<MessageType>(vector.type), Buffer(payload.data, payload.data + payload.size)) == frame);
  }
}

TEST_CASE("the shared streams, whole and byte by byte") {
  REQUIRE(vectors::streams.size() == 7);
  for (const auto& vector : vectors::streams) {
    CAPTURE(vector.name);
    const Buffer stream = unhex(vector.stream);
    const Decoded whole = decoded(stream);
    check_equal(whole, decoded(stream, 1));
    std::vector<std::uint8_t> types;
    for (const std::string& frame : whole.frames) types.push_back(unhex(frame.substr(0, 2))[0]);
    CHECK(types == vector.types);
    if (vector.checksum_errors >= 0) CHECK(whole.counters.checksum_errors == vector.checksum_errors);
    if (vector.length_errors >= 0) CHECK(whole.counters.length_errors == vector.length_errors);
    if (vector.bytes_skipped >= 0) CHECK(whole.counters.bytes_skipped == vector.bytes_skipped);
  }
}

TEST_CASE("each type has its own lengths") {
  struct Rule {
    int type;
    std::vector<std::size_t> allowed, refused;
  };
  const std::vector<Rule> rules = {
      {0x01, {76}, {0, 75, 77}},
      {0x02, {12, 4096}, {0, 11, 4097}},
      {0x03, {12, 4096}, {0, 11, 4097}},
      {0x04, {1, 4096}, {0, 4097}},
      {0x05, {28, 46, 1162}, {0, 10, 27, 29, 1163, 1180}},
      {0x06, {62, 63, 126}, {0, 61, 127}},
      {0x07, {3}, {0, 2, 4}},
      {0x08, {16, 22, 100}, {0, 10, 17, 106}},
      {0x09, {22, 23, 512}, {0, 21, 513}},
      {0x0A, {6, 7, 261}, {0, 5, 262}},
      {0x0B, {32}, {0, 31, 33}},
      {0x20, {9, 10, 264}, {0, 8, 265}},
      {0x21, {9, 10, 264}, {0, 8, 265}},
      {0x22, {6, 11, 41}, {0, 1, 5, 7, 46}},
      {0x23, {9}, {0, 8, 10}},
      {0x24, {0, 1, 4096}, {4097, 0xFFFF}},
      {0x00, {0, 1, 4096}, {4097, 0xFFFF}},
      {0xFF, {0, 1, 4096}, {4097, 0xFFFF}},
  };
  for (const Rule& rule : rules) {
    CAPTURE(rule.type);
    const auto type = static_cast<MessageType>(rule.type);
    for (const std::size_t length : rule.allowed) {
      CAPTURE(length);
      CHECK(decoded(encoded(type, Buffer(length))).counters.frames_ok == 1);
    }
    for (const std::size_t length : rule.refused) {
      CAPTURE(length);
      const Buffer header = {0xAA, 0x55, static_cast<std::uint8_t>(rule.type), static_cast<std::uint8_t>(length >> 8),
                             static_cast<std::uint8_t>(length)};
      CHECK(decoded(header).counters.length_errors == 1);  // at once, not after the payload
    }
  }
}

TEST_CASE("two blocks, cut anywhere, give what one block gives") {
  const Buffer stream = mixed_stream();
  const Decoded whole = decoded(stream);
  CHECK(whole.counters.frames_ok == 7);
  CHECK(whole.counters.length_errors == 1);
  CHECK(whole.counters.checksum_errors == 1);
  for (std::size_t cut = 0; cut <= stream.size(); ++cut) {
    CAPTURE(cut);
    Run run;
    run.feed(view(stream).first(cut));
    run.feed(view(stream).from(cut));
    check_equal(run.result(), whole);
  }
  for (std::size_t block = 1; block < stream.size(); ++block) check_equal(decoded(stream, block), whole);
}

TEST_CASE("a damaged byte costs its own frame and no other") {
  const Buffer first = encoded(MessageType::kTimeSync, counting(9));
  const Buffer hurt = encoded(MessageType::kConfig, counting(11));
  const Buffer last = encoded(MessageType::kGps, counting(32));
  const Buffer padding(kMaxPayload + kFrameOverhead);  // closes whatever a damaged length opened
  for (std::size_t at = 0; at < hurt.size(); ++at) {
    for (int change = 1; change < 256; ++change) {
      Buffer stream = first;
      append(stream, hurt);
      stream[first.size() + at] = static_cast<std::uint8_t>(stream[first.size() + at] ^ change);
      append(stream, last);
      append(stream, padding);
      const Decoded result = decoded(stream);
      const bool neighbours_only =
          result.frames == std::vector<std::string>{described(0x23, view(first).first(14).from(5)),
                                                    described(0x0B, view(last).first(37).from(5))};
      if (!neighbours_only) {
        CAPTURE(at);
        CAPTURE(change);
        CHECK(neighbours_only);
      }
    }
  }
}

TEST_CASE("the longest frame and full blocks behind it fit, whatever the buffer held before") {
  const Buffer longest = encoded(static_cast<MessageType>(0x7E), counting(kMaxPayload));
  for (const std::size_t lead : {0u, 1u, 1000u, 1023u, 1024u, 4000u}) {
    for (const std::size_t block : {std::size_t{1}, std::size_t{7}, FrameDecoder::kMaxFeed - 1, FrameDecoder::kMaxFeed}) {
      CAPTURE(lead);
      CAPTURE(block);
      Buffer stream(lead, 0x11);
      for (int i = 0; i < 4; ++i) append(stream, longest);
      const Decoded result = decoded(stream, block);
      CHECK(result.counters.frames_ok == 4);
      CHECK(result.counters.bytes_skipped == lead);
    }
  }
}

TEST_CASE("all but one byte of the longest frame, and a full block behind it") {
  Buffer stream = encoded(static_cast<MessageType>(0x7E), counting(kMaxPayload));
  const std::size_t held = stream.size() - 1;
  const Buffer second = encoded(static_cast<MessageType>(0x7E), counting(FrameDecoder::kMaxFeed - 1 - kFrameOverhead));
  append(stream, second);
  Run run;
  for (std::size_t at = 0; at < held; at += FrameDecoder::kMaxFeed) {
    run.feed({stream.data() + at, std::min(FrameDecoder::kMaxFeed, held - at)});
  }
  CHECK(run.result().frames.empty());
  run.feed(view(stream).from(held));
  CHECK(run.result().counters.frames_ok == 2);
  CHECK(run.result().counters.bytes_skipped == 0);
}

TEST_CASE("a payload stays valid until the next bytes come") {
  Buffer stream = encoded(MessageType::kTimeSync, counting(9));
  append(stream, encoded(MessageType::kConfig, counting(11)));
  FrameDecoder decoder;
  decoder.feed(view(stream));
  FrameDecoder::Frame one, two, none;
  REQUIRE(decoder.next(one));
  REQUIRE(decoder.next(two));
  REQUIRE_FALSE(decoder.next(none));
  CHECK(to_hex(one.payload) == to_hex(counting(9)));
  CHECK(to_hex(two.payload) == to_hex(counting(11)));
}
