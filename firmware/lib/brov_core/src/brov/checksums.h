// The three checks of the two serial protocols. Check values: docs/protocol.md.
#pragma once

#include "brov/bytes.h"

namespace brov {

std::uint8_t xor8(Bytes data);

struct KoggerCheck {
  std::uint8_t c1;
  std::uint8_t c2;
  constexpr bool operator==(const KoggerCheck& other) const { return c1 == other.c1 && c2 == other.c2; }
};

KoggerCheck kogger_mod256(Bytes data);  // the real one
KoggerCheck kogger_mod255(Bytes data);  // textbook Fletcher-16, which some senders use

}  // namespace brov
