// Any bytes, cut anywhere, into the decoder of the host's frames.
#include "brov/aa55.h"
#include "fuzz_input.h"

using namespace brov;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  FrameDecoder decoder;
  std::size_t fed = 0, framed = 0;
  while (!input.empty()) {
    const Bytes batch = input.batch();
    fed += batch.size;
    decoder.feed(batch);
    for (FrameDecoder::Frame frame; decoder.next(frame);) {
      require(frame.payload.size <= kMaxPayload);
      framed += frame.payload.size + kFrameOverhead;
    }
    require(framed + decoder.counters().bytes_skipped <= fed);
  }
  return 0;
}
