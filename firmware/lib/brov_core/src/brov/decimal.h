// Numbers in the text of NMEA and EZO, without floating point.
#pragma once

#include "brov/bytes.h"

namespace brov {

constexpr std::int64_t kNano = 1000000000;  // parsed numbers count billionths of their unit

// `12`, `12.`, `.5` or `12.345`, nothing else. Digits beyond the ninth decimal are ignored; 999 999 999 and more before
// the point stay 999 999 999.
bool parse_decimal(Bytes text, std::int64_t& nano);
// The same with an optional minus sign.
bool parse_signed_decimal(Bytes text, std::int64_t& nano);

}  // namespace brov
