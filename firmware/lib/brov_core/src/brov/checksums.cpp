#include "brov/checksums.h"

namespace brov {

std::uint8_t xor8(Bytes data) {
  std::uint8_t check = 0;
  for (std::size_t i = 0; i < data.size; ++i) check = static_cast<std::uint8_t>(check ^ data[i]);
  return check;
}

KoggerCheck kogger_mod256(Bytes data) {
  std::uint32_t c1 = 0, c2 = 0;  // their low bytes are the wrapping sums
  for (std::size_t i = 0; i < data.size; ++i) {
    c1 += data[i];
    c2 += c1;
  }
  return {static_cast<std::uint8_t>(c1), static_cast<std::uint8_t>(c2)};
}

KoggerCheck kogger_mod255(Bytes data) {
  std::uint32_t c1 = 0, c2 = 0;
  for (std::size_t i = 0; i < data.size; ++i) {
    c1 += data[i];
    if (c1 >= 255) c1 -= 255;
    c2 += c1;
    if (c2 >= 255) c2 -= 255;
  }
  return {static_cast<std::uint8_t>(c1), static_cast<std::uint8_t>(c2)};
}

}  // namespace brov
