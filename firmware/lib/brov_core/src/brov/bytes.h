// Views of bytes, and little-endian numbers written and read field by field.
#pragma once

#include <cstddef>
#include <cstdint>

namespace brov {

struct Bytes {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;

  constexpr Bytes() = default;
  constexpr Bytes(const std::uint8_t* first, std::size_t count) : data(first), size(count) {}
  constexpr std::uint8_t operator[](std::size_t i) const { return data[i]; }
  constexpr Bytes from(std::size_t start) const { return {data + start, size - start}; }
  constexpr Bytes first(std::size_t count) const { return {data, count}; }
};

inline void put_u16(std::uint8_t* at, std::uint16_t v) {
  at[0] = static_cast<std::uint8_t>(v);
  at[1] = static_cast<std::uint8_t>(v >> 8);
}
inline void put_u24(std::uint8_t* at, std::uint32_t v) {
  put_u16(at, static_cast<std::uint16_t>(v));
  at[2] = static_cast<std::uint8_t>(v >> 16);
}
inline void put_u32(std::uint8_t* at, std::uint32_t v) {
  put_u16(at, static_cast<std::uint16_t>(v));
  put_u16(at + 2, static_cast<std::uint16_t>(v >> 16));
}
inline void put_u64(std::uint8_t* at, std::uint64_t v) {
  put_u32(at, static_cast<std::uint32_t>(v));
  put_u32(at + 4, static_cast<std::uint32_t>(v >> 32));
}
inline std::uint16_t get_u16(const std::uint8_t* at) {
  return static_cast<std::uint16_t>(at[0] | at[1] << 8);
}
inline std::uint32_t get_u32(const std::uint8_t* at) {
  return get_u16(at) | static_cast<std::uint32_t>(get_u16(at + 2)) << 16;
}
inline std::uint64_t get_u64(const std::uint8_t* at) {
  return get_u32(at) | static_cast<std::uint64_t>(get_u32(at + 4)) << 32;
}

// The nearest integer of numerator / denominator, halves away from zero. denominator > 0.
constexpr std::int64_t divide_rounded(std::int64_t numerator, std::int64_t denominator) {
  return numerator >= 0 ? (2 * numerator + denominator) / (2 * denominator)
                        : -((-2 * numerator + denominator) / (2 * denominator));
}

constexpr std::int64_t clamped(std::int64_t v, std::int64_t low, std::int64_t high) {
  return v < low ? low : v > high ? high : v;
}

}  // namespace brov
