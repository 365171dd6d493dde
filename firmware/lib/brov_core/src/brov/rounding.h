// Doubles to the integers of the wire.
#pragma once

#include <cstdint>

namespace brov {

// The nearest integer as `trunc(x + 0.5)`, halves away from zero. |x| < 2^62.
constexpr std::int64_t rounded(double x) {
  return x >= 0.0 ? static_cast<std::int64_t>(x + 0.5) : -static_cast<std::int64_t>(0.5 - x);
}

}  // namespace brov
