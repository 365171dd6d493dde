// Bytes of the tests: out of hex, back to hex, and as views.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "brov/bytes.h"

using Buffer = std::vector<std::uint8_t>;

inline Buffer unhex(const std::string& hex) {
  Buffer bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

inline std::string to_hex(brov::Bytes bytes) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string hex;
  for (std::size_t i = 0; i < bytes.size; ++i) {
    hex += kDigits[bytes[i] >> 4];
    hex += kDigits[bytes[i] & 15];
  }
  return hex;
}

inline brov::Bytes view(const Buffer& buffer) { return {buffer.data(), buffer.size()}; }
inline std::string to_hex(const Buffer& buffer) { return to_hex(view(buffer)); }

inline void append(Buffer& to, const Buffer& more) { to.insert(to.end(), more.begin(), more.end()); }
