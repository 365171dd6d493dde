#include "vector_checks.h"

#include <cstring>

#include "brov/aa55.h"
#include "brov/bundle.h"
#include "brov/checksums.h"
#include "brov/kogger_framer.h"
#include "brov/payloads.h"
#include "crc32.h"
#include "line.h"
#include "vectors.h"

using namespace brov;

namespace {

std::uint8_t nibble(char digit) {
  return static_cast<std::uint8_t>(digit <= '9' ? digit - '0' : digit - 'a' + 10);
}

// Bytes out of hex, in memory that lives as long as the object.
class Unhexed {
 public:
  explicit Unhexed(const char* hex) { append(hex); }
  void append(const char* hex) {
    for (; hex[0] != '\0'; hex += 2) bytes_.push_back(static_cast<std::uint8_t>(nibble(hex[0]) << 4 | nibble(hex[1])));
  }
  Bytes view() const { return {bytes_.data(), bytes_.size()}; }

 private:
  std::vector<std::uint8_t> bytes_;
};

bool equal(Bytes a, Bytes b) { return a.size == b.size && (a.size == 0 || std::memcmp(a.data, b.data, a.size) == 0); }
bool equal(Bytes a, const char* hex) { return equal(a, Unhexed(hex).view()); }

// One table's outcome.
class Table {
 public:
  explicit Table(const char* name) : name_(name) {}
  void vector(bool as_expected) {
    ++count_;
    if (!as_expected) ++failed_;
  }
  void came_out(Bytes data) { crc_.add(data); }
  int done() {
    Line line;
    line.text("vectors ").text(name_).text(" ").number(static_cast<std::uint64_t>(count_)).text(" failed ");
    line.number(static_cast<std::uint64_t>(failed_)).text(" crc ").hex(crc_.value()).print();
    return failed_ + (count_ == 0 ? 1 : 0);
  }

 private:
  const char* name_;
  int count_ = 0, failed_ = 0;
  Crc32 crc_;
};

Bytes payload_of(Bytes frame) { return frame.first(frame.size - 1).from(kFrameOverhead - 1); }

int check_frames() {
  Table table("frames");
  for (const auto& vector : vectors::frames) {
    const Unhexed frame(vector.frame);
    static std::uint8_t encoded[kMaxPayload + kFrameOverhead];
    const Bytes payload = payload_of(frame.view());
    const std::size_t size = encode_frame(static_cast<MessageType>(vector.type), payload, encoded);
    table.came_out({encoded, size});
    static FrameDecoder decoder;
    bool right = equal({encoded, size}, frame.view());
    int frames = 0;
    for (Bytes left = frame.view(); left.size != 0;) {
      const std::size_t block = left.size < FrameDecoder::kMaxFeed ? left.size : FrameDecoder::kMaxFeed;
      decoder.feed(left.first(block));
      left = left.from(block);
      for (FrameDecoder::Frame found; decoder.next(found); ++frames) {
        right = right && found.type == vector.type && equal(found.payload, payload);
        table.came_out(found.payload);
      }
    }
    table.vector(right && frames == 1);
  }
  return table.done();
}

template <typename Fields, std::size_t Size>
int check_packed(const char* name, const std::vector<vectors::Packed<Fields>>& expected,
                 void (*pack)(const Fields&, std::uint8_t (&)[Size])) {
  Table table(name);
  for (const auto& vector : expected) {
    std::uint8_t payload[Size];
    pack(vector.fields, payload);
    table.came_out({payload, Size});
    table.vector(equal({payload, Size}, payload_of(Unhexed(vector.frame).view())));
  }
  return table.done();
}

int check_bursts_and_acks() {
  Table bursts("imu_bursts");
  for (const auto& vector : vectors::imu_bursts) {
    std::uint8_t payload[kImuBurstHeaderBytes + 64 * kImuSampleBytes];
    const auto count = static_cast<std::uint8_t>(vector.samples.size());
    const std::size_t size = pack_imu_burst(vector.t0_us, vector.dt_us, vector.samples.data(), count, payload);
    bursts.came_out({payload, size});
    bursts.vector(equal({payload, size}, payload_of(Unhexed(vector.frame).view())));
  }
  Table acks("acks");
  for (const auto& vector : vectors::acks) {
    std::uint8_t payload[kAckBytes];
    pack_ack(vector.acked_type, vector.sequence, static_cast<AckResult>(vector.result), payload);
    acks.came_out({payload, kAckBytes});
    acks.vector(equal({payload, kAckBytes}, payload_of(Unhexed(vector.frame).view())));
  }
  return bursts.done() + acks.done();
}

bool given_and_other(long long expected, std::uint32_t found) { return expected >= 0 && expected != found; }

int check_streams() {
  Table table("streams");
  for (const auto& vector : vectors::streams) {
    FrameDecoder decoder;
    const Unhexed stream(vector.stream);
    std::vector<std::uint8_t> types;
    for (std::size_t i = 0; i < stream.view().size; ++i) {
      decoder.feed({stream.view().data + i, 1});
      for (FrameDecoder::Frame frame; decoder.next(frame);) {
        types.push_back(frame.type);
        table.came_out(frame.payload);
      }
    }
    const DecoderCounters& counters = decoder.counters();
    table.vector(equal({types.data(), types.size()}, {vector.types.data(), vector.types.size()}) &&
                 !given_and_other(vector.checksum_errors, counters.checksum_errors) &&
                 !given_and_other(vector.length_errors, counters.length_errors) &&
                 !given_and_other(vector.bytes_skipped, counters.bytes_skipped));
  }
  return table.done();
}

int check_checksums() {
  Table table("checksums");
  for (const auto& pair : vectors::checksum_pairs) {
    const Unhexed bytes(pair.bytes);
    const KoggerCheck mod256 = kogger_mod256(bytes.view()), mod255 = kogger_mod255(bytes.view());
    const std::uint8_t found[] = {mod256.c1, mod256.c2, mod255.c1, mod255.c2};
    table.came_out({found, sizeof found});
    table.vector(equal({found, 2}, pair.mod256) && equal({found + 2, 2}, pair.mod255));
  }
  return table.done();
}

bool same(const vectors::KoggerFrame& expected, const KoggerFrame& found) {
  const Bytes raw = found.raw;
  return raw[2] == expected.route && found.type() == expected.type && found.version() == expected.version &&
         found.mark() == (expected.mark != 0) && (raw[3] >> 7) == expected.response && found.id() == expected.id &&
         static_cast<int>(found.payload().size) == expected.length && equal(raw.from(raw.size - 2), expected.check) &&
         (expected.payload == nullptr || equal(found.payload(), expected.payload));
}

int check_kogger() {
  Table table("kogger");
  for (const auto& vector : vectors::kogger) {
    KoggerFramer framer;
    std::size_t next = 0;
    bool right = true;
    const auto skip_cc55 = [&] {
      while (next < vector.frames.size() && vector.frames[next].v != 1) ++next;
    };
    for (const char* datagram : vector.datagrams) {
      const Unhexed bytes(datagram);
      for (std::size_t i = 0; i < bytes.view().size; ++i) {
        framer.feed({bytes.view().data + i, 1});
        for (KoggerFrame frame; framer.next(frame);) {
          table.came_out(frame.raw);
          skip_cc55();
          right = right && next < vector.frames.size() && same(vector.frames[next], frame);
          ++next;
        }
      }
    }
    skip_cc55();
    table.vector(right && next == vector.frames.size() && framer.checksum_errors() == vector.bad_checksum);
  }
  for (const auto& command : vectors::commands) {
    KoggerFramer framer;
    const Unhexed bytes(command.frame);
    framer.feed(bytes.view());
    KoggerFrame frame;
    table.vector(framer.next(frame) && equal(frame.raw, bytes.view()) && framer.idle());
  }
  return table.done();
}

class Payloads final : public BundlePacker::Sink {
 public:
  Payloads(Table& table, const std::vector<const char*>& expected) : table_(table), expected_(expected) {}
  void payload(Bytes payload) override {
    table_.came_out(payload);
    right_ = right_ && count_ < expected_.size() && equal(payload, expected_[count_]);
    ++count_;
  }
  bool right() const { return right_ && count_ == expected_.size(); }

 private:
  Table& table_;
  const std::vector<const char*>& expected_;
  std::size_t count_ = 0;
  bool right_ = true;
};

int check_bundles() {
  Table table("bundles");
  for (const auto& vector : vectors::bundles) {
    Payloads payloads(table, vector.payloads);
    BundlePacker packer(static_cast<Channel>(vector.channel), vector.decimation, static_cast<Coding>(vector.coding),
                        vector.payload_limit, payloads);
    packer.begin(vector.ping_number, vector.t_us, vector.version, vector.mark);
    std::vector<Unhexed> samples;  // they outlive the chunks, of which the packer keeps views
    for (const auto& chunk : vector.chunks) samples.emplace_back(chunk.samples);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const auto& chunk = vector.chunks[i];
      packer.add({chunk.seq_offset, chunk.resolution_mm, chunk.first_sample, samples[i].view()});
    }
    packer.end();
    table.vector(payloads.right());
  }
  return table.done();
}

}  // namespace

int check_vectors() {
  return check_frames() + check_packed("sensors", vectors::sensors, pack_sensors) +
         check_packed("status", vectors::status, pack_status) + check_packed("gps", vectors::gps, pack_gps) +
         check_bursts_and_acks() + check_streams() + check_checksums() + check_kogger() + check_bundles();
}
