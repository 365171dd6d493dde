// Received bytes between two cores: one context writes, one reads, no lock.
#pragma once

#include <array>
#include <atomic>

#include "brov/bytes.h"

namespace brov {

// The indices run freely modulo 2^32, so that all `Capacity` bytes can be used. Only plain loads and stores of the
// indices: no read-modify-write, which not every target has.
template <std::uint32_t Capacity>
class ByteRing {
  static_assert(Capacity != 0 && (Capacity & (Capacity - 1)) == 0, "the capacity is a power of two");

 public:
  // For the writer. The newest bytes are dropped and counted when there is no room.
  void write(Bytes data) {
    const std::uint32_t end = end_.load(std::memory_order_relaxed);
    const std::uint32_t room = Capacity - (end - start_.load(std::memory_order_acquire));
    const std::uint32_t count = data.size < room ? static_cast<std::uint32_t>(data.size) : room;
    for (std::uint32_t i = 0; i < count; ++i) buffer_[(end + i) % Capacity] = data[i];
    end_.store(end + count, std::memory_order_release);
    const auto lost = static_cast<std::uint32_t>(data.size) - count;
    if (lost != 0) lost_.store(lost_.load(std::memory_order_relaxed) + lost, std::memory_order_relaxed);
  }

  // For the reader.
  std::size_t size() const { return end_.load(std::memory_order_acquire) - start_.load(std::memory_order_relaxed); }
  // The oldest bytes, at most `most` of those that are there, as far as they lie in one piece.
  Bytes front(std::size_t most) const {
    const std::uint32_t at = start_.load(std::memory_order_relaxed) % Capacity;
    return {buffer_.data() + at, most < Capacity - at ? most : Capacity - at};
  }
  void consume(std::size_t count) {
    start_.store(start_.load(std::memory_order_relaxed) + static_cast<std::uint32_t>(count), std::memory_order_release);
  }
  std::uint32_t lost() const { return lost_.load(std::memory_order_relaxed); }

 private:
  std::array<std::uint8_t, Capacity> buffer_{};
  std::atomic<std::uint32_t> start_{0}, end_{0}, lost_{0};
};

}  // namespace brov
