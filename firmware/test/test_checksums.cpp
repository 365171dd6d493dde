#include <doctest/doctest.h>

#include "brov/checksums.h"
#include "hex.h"
#include "vectors.h"

using namespace brov;

namespace {

std::string hex(KoggerCheck check) { return to_hex(Buffer{check.c1, check.c2}); }

}  // namespace

TEST_CASE("checksums agree with the shared pairs") {
  REQUIRE(vectors::checksum_pairs.size() == 8);
  for (const auto& pair : vectors::checksum_pairs) {
    CAPTURE(pair.bytes);
    const Buffer bytes = unhex(pair.bytes);
    CHECK(hex(kogger_mod256(view(bytes))) == pair.mod256);
    CHECK(hex(kogger_mod255(view(bytes))) == pair.mod255);
  }
}

TEST_CASE("checksums of nothing are zero, and long data does not overflow them") {
  CHECK(xor8({}) == 0);
  CHECK(hex(kogger_mod256({})) == "0000");
  CHECK(hex(kogger_mod255({})) == "0000");
  // n bytes of 0x01: n and n (n + 1) / 2.
  const Buffer ones(4096, 1);
  CHECK(xor8(view(ones)) == 0);
  CHECK(hex(kogger_mod256(view(ones))) == "0000");  // 4096 = 16 * 256; 8 390 656 = 32776 * 256
  CHECK(hex(kogger_mod255(view(ones))) == "1088");  // 4096 = 16 + 16 * 255; 8 390 656 = 136 + 32904 * 255
}
