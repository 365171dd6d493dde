// The part of a byte stream that a decoder has not finished with.
#pragma once

#include <array>

#include "brov/bytes.h"

namespace brov {

// Capacity: the longest thing that is held incomplete, and one block of new bytes.
template <std::size_t Capacity>
class StreamBuffer {
 public:
  // Moves what is held to the front only when the end is reached. Bytes beyond the capacity are lost.
  void append(Bytes data) {
    if (size_ + data.size > Capacity) {
      for (std::size_t i = read_; i < size_; ++i) buffer_[i - read_] = buffer_[i];
      size_ -= read_;
      read_ = 0;
    }
    for (std::size_t i = 0; i < data.size && size_ < Capacity; ++i) buffer_[size_++] = data[i];
  }
  Bytes held() const { return {buffer_.data() + read_, size_ - read_}; }
  void take(std::size_t count) { read_ += count; }

 private:
  std::array<std::uint8_t, Capacity> buffer_{};
  std::size_t size_ = 0, read_ = 0;
};

}  // namespace brov
