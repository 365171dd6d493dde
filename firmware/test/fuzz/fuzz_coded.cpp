// Any bytes as a code, and any samples coded and decoded again.
#include "brov/coded.h"
#include "fuzz_input.h"

using namespace brov;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 4) return 0;
  static std::uint8_t samples[4096], code[512];
  const std::size_t count = get_u16(data) % sizeof samples;
  const Bytes bytes = Bytes(data, size).from(4);
  decode_samples(bytes, samples, count);

  const std::size_t code_size = kMinCodeBytes + get_u16(data + 2) % (sizeof code - kMinCodeBytes + 1);
  const bool pairs = (data[0] & 1) != 0;
  const Bytes parts[] = {bytes.first(bytes.size / 3), bytes.from(bytes.size / 3)};
  const SampleRun run{parts, 2, static_cast<std::uint8_t>(data[1] & 1), pairs};
  const std::size_t values = run.size();
  if (parts[0].size == 0 || values >= 8 * code_size - 14 || values > sizeof samples) return 0;
  encode_samples(run, code, code_size);
  require(decode_samples({code, code_size}, samples, values));
  require(samples[0] == code[1]);
  return 0;
}
