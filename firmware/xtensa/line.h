// One line of text, without the C library's formatting.
#pragma once

#include <cstddef>
#include <cstdint>

#include "machine.h"

class Line {
 public:
  Line& text(const char* more) {
    for (; *more != '\0'; ++more) put(*more);
    return *this;
  }
  Line& number(std::uint64_t value) {
    char digits[20];
    std::size_t count = 0;
    do {
      digits[count++] = static_cast<char>('0' + value % 10);
      value /= 10;
    } while (value != 0);
    while (count != 0) put(digits[--count]);
    return *this;
  }
  Line& hex(std::uint32_t value) {
    for (int shift = 28; shift >= 0; shift -= 4) put("0123456789abcdef"[value >> shift & 15]);
    return *this;
  }
  void print() {
    put('\n');
    machine::print(buffer_, size_);
  }
  void print_measure() {
    put('\n');
    machine::print_measure(buffer_, size_);
  }

 private:
  void put(char c) {
    if (size_ < sizeof buffer_) buffer_[size_++] = c;
  }

  char buffer_[200];
  std::size_t size_ = 0;
};
