// Coding 2 of KOGGER_COMPRESSED: a run of samples in a given number of bytes. docs/protocol.md section 3.
#pragma once

#include "brov/bytes.h"

namespace brov {

constexpr std::size_t kMinCodeBytes = 16;  // in less the header weighs too much: means do it there

// The samples of a payload's chunks in the order in which they are coded: of charts of version 1 one sub-channel behind
// the other, and with `pairs` the mean of two neighbours each. The chunks' samples stay where they are.
struct SampleRun {
  const Bytes* parts;
  std::size_t count;
  std::uint8_t version;
  bool pairs;

  std::size_t size() const;
  // Calls take(Bytes) with all values, some at a time.
  template <typename Take>
  void each(Take take) const;
};

// The run in exactly `size` bytes, 16 to 512; it must have fewer than 8 size - 14 values, and at least one.
void encode_samples(const SampleRun& run, std::uint8_t* into, std::size_t size);

// The `count` samples of a code; false if it is none.
bool decode_samples(Bytes code, std::uint8_t* samples, std::size_t count);

template <typename Take>
void SampleRun::each(Take take) const {
  const std::size_t channels = version == 0 ? 1 : 2;
  const std::size_t step = pairs ? 2 * channels : channels;
  for (std::size_t channel = 0; channel < channels; ++channel) {
    for (std::size_t part = 0; part < count; ++part) {
      const Bytes samples = parts[part];
      if (step == 1) {
        take(samples);
        continue;
      }
      std::uint8_t values[64];
      std::size_t gathered = 0;
      for (std::size_t i = channel; i < samples.size; i += step) {
        unsigned value = samples[i];
        if (pairs && i + channels < samples.size) value = (value + samples[i + channels] + 1) / 2;
        values[gathered++] = static_cast<std::uint8_t>(value);
        if (gathered == sizeof values || i + step >= samples.size) {
          take(Bytes(values, gathered));
          gathered = 0;
        }
      }
    }
  }
}

}  // namespace brov
