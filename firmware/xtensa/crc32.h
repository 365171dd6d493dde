// The CRC-32 of zip files, for comparing long outputs.
#pragma once

#include "brov/bytes.h"

class Crc32 {
 public:
  void add(brov::Bytes data) {
    for (std::size_t i = 0; i < data.size; ++i) {
      state_ ^= data[i];
      for (int bit = 0; bit < 8; ++bit) state_ = state_ >> 1 ^ (0xEDB88320u & (0u - (state_ & 1u)));
    }
  }
  std::uint32_t value() const { return ~state_; }

 private:
  std::uint32_t state_ = 0xFFFFFFFFu;
};
