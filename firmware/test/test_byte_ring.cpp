#include <doctest/doctest.h>

#include <algorithm>
#include <memory>
#include <thread>

#include "brov/byte_ring.h"
#include "hex.h"

using namespace brov;

namespace {

Buffer take(ByteRing<16>& ring, std::size_t most) {
  Buffer taken;
  for (std::size_t left = std::min(ring.size(), most); left != 0;) {
    const Bytes piece = ring.front(left);
    taken.insert(taken.end(), piece.data, piece.data + piece.size);
    ring.consume(piece.size);
    left -= piece.size;
  }
  return taken;
}

}  // namespace

TEST_CASE("A ring gives back what was written, round its end, and uses every byte of its room") {
  ByteRing<16> ring;
  std::uint8_t next_in = 0, next_out = 0;
  for (std::size_t round = 0; round < 500; ++round) {
    Buffer in(round % 17);
    for (auto& byte : in) byte = next_in++;
    ring.write(view(in));
    CHECK(ring.size() == in.size());
    for (const std::uint8_t byte : take(ring, 16)) CHECK(byte == next_out++);
  }
  CHECK(next_in == next_out);
  CHECK(ring.lost() == 0);
}

TEST_CASE("A full ring drops the newest bytes and counts them") {
  ByteRing<16> ring;
  Buffer in(20);
  for (std::size_t i = 0; i < in.size(); ++i) in[i] = static_cast<std::uint8_t>(i);
  ring.write(view(in));
  CHECK(ring.lost() == 4);
  CHECK(take(ring, 5) == Buffer{0, 1, 2, 3, 4});
  ring.write(view(in));
  CHECK(ring.lost() == 4 + 15);
  CHECK(take(ring, 100) == Buffer{5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4});
}

TEST_CASE("One thread writes, another reads: every byte comes once and in order") {
  const auto ring = std::make_unique<ByteRing<16>>();
  constexpr std::uint32_t kTotal = 200000;
  std::thread writer([&] {
    std::uint32_t sent = 0;
    while (sent < kTotal) {
      std::uint8_t bytes[5];
      const std::size_t room = 16 - ring->size();  // only grows behind our back
      const std::size_t count = std::min<std::size_t>({room, sizeof bytes, kTotal - sent});
      for (std::size_t i = 0; i < count; ++i) bytes[i] = static_cast<std::uint8_t>((sent + i) * 31 >> 3);
      ring->write(Bytes(bytes, count));
      sent += static_cast<std::uint32_t>(count);
      if (count == 0) std::this_thread::yield();
    }
  });
  std::uint32_t received = 0, wrong = 0;
  while (received < kTotal) {
    const std::size_t there = ring->size();
    if (there == 0) {
      std::this_thread::yield();
      continue;
    }
    const Bytes piece = ring->front(there);
    for (std::size_t i = 0; i < piece.size; ++i, ++received) {
      wrong += piece[i] != static_cast<std::uint8_t>(received * 31 >> 3);
    }
    ring->consume(piece.size);
  }
  writer.join();
  CHECK(wrong == 0);
  CHECK(ring->lost() == 0);
}
