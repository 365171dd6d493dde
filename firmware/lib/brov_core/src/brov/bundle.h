// KOGGER_COMPRESSED: decimated or coded chart chunks of one ping in payloads of limited size. docs/protocol.md section 3.
#pragma once

#include "brov/bytes.h"
#include "brov/hal.h"
#include "brov/settings.h"

namespace brov {

constexpr std::size_t kPayloadLimitSlow = 224;
constexpr std::size_t kPayloadLimitFast = 512;
constexpr std::uint32_t kMaxPingBytes = 20000;

struct ChartChunk {
  std::uint16_t seq_offset = 0, resolution_mm = 0, first_sample = 0;
  Bytes samples;
};

// Groups of `decimation` samples, 1 to 8, to one byte each, the mean unless it is to be the peak; version 1 alternates
// two sub-channels. Returns the bytes written.
std::size_t decimate(Bytes samples, std::uint8_t decimation, Coding coding, std::uint8_t version, std::uint8_t* into);

// One ping's payloads, chunk by chunk: begin(), then add() and end(), which hand each full payload to `sink`. The samples
// of the chunks must stay where they are until end(). payload_limit: at most kPayloadLimitFast.
class BundlePacker {
 public:
  class Sink {
   public:
    virtual void payload(Bytes payload) = 0;

   protected:
    ~Sink() = default;
  };

  BundlePacker(Channel channel, std::uint8_t decimation, Coding coding, std::size_t payload_limit, Sink& sink);
  void begin(std::uint8_t ping_number, std::uint32_t t_us, std::uint8_t version, bool mark);
  void add(const ChartChunk& chunk);
  void end();

 private:
  void piece(std::uint16_t seq_offset, const ChartChunk& chunk, Bytes part);
  bool coded() const { return coding_ == Coding::kCoded && decimation_ > 1; }
  void fill_coded();
  void flush(bool last);

  static constexpr std::size_t kMaxChunks = (kPayloadLimitFast - 9) / 8;  // of one byte each

  Channel channel_;
  std::uint8_t decimation_;
  Coding coding_;
  std::size_t limit_;
  Sink& sink_;
  std::uint8_t ping_number_ = 0, version_ = 0, chunks_ = 0;
  std::uint32_t t_us_ = 0;
  bool mark_ = false;
  std::size_t size_ = 0;
  std::uint8_t payload_[kPayloadLimitFast];
  Bytes parts_[kMaxChunks];
};

}  // namespace brov
