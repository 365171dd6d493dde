// Runs the core's codecs on bytes from stdin, so that pytest can compare them with Python's:
//
//     codec_filter aa55 | bb55 | bb55-auto | bundle | coded
//
// stdin is messages, each a u32 length and that many bytes; every message is answered and flushed.
// Framers: a message is one block of the stream (length 0xFFFFFFFF, no bytes: begin a new stream); the answer is one line
// for each frame, then `fed` and the counters. bundle: a message is one ping; the answer is its payloads, then `packed`.
// coded: a message is a u16 count of samples and a code; the answer is the samples, or `none`.
#include <cstdio>
#include <cstring>
#include <vector>

#include "brov/aa55.h"
#include "brov/bundle.h"
#include "brov/coded.h"
#include "brov/kogger_framer.h"
#include "hex.h"

using namespace brov;

namespace {

constexpr std::uint32_t kNewStream = 0xFFFFFFFF;

bool read_message(std::uint32_t& length, Buffer& bytes) {
  std::uint8_t header[4];
  if (std::fread(header, 1, sizeof header, stdin) != sizeof header) return false;
  length = get_u32(header);
  bytes.resize(length == kNewStream ? 0 : length);
  return std::fread(bytes.data(), 1, bytes.size(), stdin) == bytes.size();
}

struct Aa55 {
  FrameDecoder codec;

  void print_frames() {
    FrameDecoder::Frame frame;
    while (codec.next(frame)) std::printf("%d %s\n", frame.type, to_hex(frame.payload).c_str());
  }
  void print_counters() const {
    const DecoderCounters& c = codec.counters();
    std::printf("fed %u %u %u %u\n", c.frames_ok, c.checksum_errors, c.length_errors, c.bytes_skipped);
  }
};

template <KoggerChecksum Checksum>
struct Bb55 {
  KoggerFramer codec{Checksum};

  void print_frames() {
    KoggerFrame frame;
    while (codec.next(frame)) std::printf("%zu %s\n", frame.behind, to_hex(frame.raw).c_str());
  }
  void print_counters() const {
    std::printf("fed %u %u %d\n", codec.frames_ok(), codec.checksum_errors(), codec.idle() ? 1 : 0);
  }
};

template <typename Stream>
int run_framer() {
  Stream stream;
  std::uint32_t length = 0;
  Buffer block;
  while (read_message(length, block)) {
    if (length == kNewStream) {
      stream = Stream();
      continue;
    }
    if (block.size() > decltype(stream.codec)::kMaxFeed) return 1;
    stream.codec.feed(view(block));
    stream.print_frames();
    stream.print_counters();
    std::fflush(stdout);
  }
  return 0;
}

class Printer final : public BundlePacker::Sink {
 public:
  void payload(Bytes payload) override { std::printf("%s\n", to_hex(payload).c_str()); }
};

// u8 channel, decimation, coding, version, mark, ping number | u32 t_us | u16 payload limit, then for each chunk
// u16 seqOffset, resolution, first sample, count of samples | samples
int run_bundle() {
  std::uint32_t length = 0;
  Buffer ping;
  Printer printer;
  while (read_message(length, ping)) {
    const std::uint8_t* at = ping.data();
    BundlePacker packer(static_cast<Channel>(at[0]), at[1], static_cast<Coding>(at[2]), get_u16(at + 10), printer);
    packer.begin(at[5], get_u32(at + 6), at[3], at[4] != 0);
    for (at += 12; at < ping.data() + ping.size();) {
      const std::size_t count = get_u16(at + 6);
      packer.add({get_u16(at), get_u16(at + 2), get_u16(at + 4), {at + 8, count}});
      at += 8 + count;
    }
    packer.end();
    std::printf("packed\n");
    std::fflush(stdout);
  }
  return 0;
}

int run_coded() {
  std::uint32_t length = 0;
  Buffer message;
  while (read_message(length, message)) {
    // Copies of the exact size, so that the sanitizers see every step beyond it.
    const Buffer code(message.begin() + 2, message.end());
    Buffer samples(get_u16(message.data()));
    const bool decoded = decode_samples(view(code), samples.data(), samples.size());
    std::printf("%s\n", decoded ? to_hex(view(samples)).c_str() : "none");
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const char* codec = argc == 2 ? argv[1] : "";
  if (std::strcmp(codec, "aa55") == 0) return run_framer<Aa55>();
  if (std::strcmp(codec, "bb55") == 0) return run_framer<Bb55<KoggerChecksum::kMod256>>();
  if (std::strcmp(codec, "bb55-auto") == 0) return run_framer<Bb55<KoggerChecksum::kAuto>>();
  if (std::strcmp(codec, "bundle") == 0) return run_bundle();
  if (std::strcmp(codec, "coded") == 0) return run_coded();
  std::fprintf(stderr, "usage: codec_filter aa55 | bb55 | bb55-auto | bundle | coded\n");
  return 2;
}
