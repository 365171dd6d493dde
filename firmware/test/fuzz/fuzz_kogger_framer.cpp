// Any bytes, cut anywhere, into the framer of a sonar's stream.
#include "brov/kogger_framer.h"
#include "fuzz_input.h"

using namespace brov;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  KoggerFramer framer((input.byte() & 1) != 0 ? KoggerChecksum::kAuto : KoggerChecksum::kMod256);
  std::size_t fed = 0, framed = 0;
  while (!input.empty()) {
    const Bytes batch = input.batch();
    fed += batch.size;
    framer.feed(batch);
    for (KoggerFrame frame; framer.next(frame);) {
      require(frame.raw.size >= 8 && frame.raw.size <= kMaxKoggerFrame && frame.payload().size + 8 == frame.raw.size);
      require(frame.behind < fed && frame.behind + 1 >= frame.raw.size);
      framed += frame.raw.size;
    }
    require(framed <= fed);
  }
  return 0;
}
