#include <doctest/doctest.h>

#include "brov/decimal.h"
#include "reader_rig.h"

using namespace brov;

namespace {

std::int64_t nano_of(const std::string& text) {
  std::int64_t nano = -1;
  REQUIRE(parse_decimal(bytes_of(text), nano));
  return nano;
}

bool is_number(const std::string& text) {
  std::int64_t nano = 0;
  return parse_decimal(bytes_of(text), nano);
}

}  // namespace

TEST_CASE("decimals become billionths") {
  CHECK(nano_of("0") == 0);
  CHECK(nano_of("12") == 12000000000);
  CHECK(nano_of("12.") == 12000000000);
  CHECK(nano_of(".5") == 500000000);
  CHECK(nano_of("0007.25") == 7250000000);
  CHECK(nano_of("0.123456789") == 123456789);
}

TEST_CASE("decimals beyond the ninth do not count") { CHECK(nano_of("0.9999999999999999") == 999999999); }

TEST_CASE("absurd numbers saturate") {
  CHECK(nano_of("999999999.999999999") == 999999999999999999);
  CHECK(nano_of("1000000000") == 999999999000000000);
  CHECK(nano_of(std::string(90, '9')) == 999999999000000000);
  CHECK(divide_rounded(nano_of("999999999.999999999"), 1) == 999999999999999999);
}

TEST_CASE("what is no number is none") {
  for (const char* text : {"", ".", "-", "-1", "+1", "1.2.3", "1e5", " 1", "1 ", "1,5", "0x10", "nan"}) {
    CAPTURE(text);
    CHECK_FALSE(is_number(text));
  }
}

TEST_CASE("a sign only where it is allowed") {
  std::int64_t nano = 0;
  REQUIRE(parse_signed_decimal(bytes_of("-26.8"), nano));
  CHECK(nano == -26800000000);
  REQUIRE(parse_signed_decimal(bytes_of("26.8"), nano));
  CHECK(nano == 26800000000);
  CHECK_FALSE(parse_signed_decimal(bytes_of("--1"), nano));
  CHECK_FALSE(parse_signed_decimal(bytes_of("-"), nano));
  CHECK_FALSE(parse_signed_decimal(bytes_of(""), nano));
}
