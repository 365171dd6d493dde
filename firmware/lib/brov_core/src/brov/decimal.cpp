#include "brov/decimal.h"

namespace brov {

namespace {

constexpr std::int64_t kMostWhole = 999999999;

constexpr bool is_digit(std::uint8_t c) { return c >= '0' && c <= '9'; }

}  // namespace

bool parse_decimal(Bytes text, std::int64_t& nano) {
  std::int64_t whole = 0;
  std::int64_t fraction = 0;
  std::int64_t place = kNano / 10;
  bool any_digit = false;
  bool behind_point = false;
  for (std::size_t i = 0; i < text.size; ++i) {
    if (text[i] == '.' && !behind_point) {
      behind_point = true;
      continue;
    }
    if (!is_digit(text[i])) {
      return false;
    }
    any_digit = true;
    const std::int64_t digit = text[i] - '0';
    if (behind_point) {
      fraction += digit * place;
      place /= 10;
    } else {
      whole = clamped(whole * 10 + digit, 0, kMostWhole);
    }
  }
  nano = whole * kNano + fraction;
  return any_digit;
}

bool parse_signed_decimal(Bytes text, std::int64_t& nano) {
  const bool negative = text.size > 0 && text[0] == '-';
  if (!parse_decimal(negative ? text.from(1) : text, nano)) {
    return false;
  }
  nano = negative ? -nano : nano;
  return true;
}

}  // namespace brov
