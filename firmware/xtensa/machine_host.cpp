#include <cstdio>

#include "machine.h"

namespace machine {

std::size_t read_scenario(std::uint8_t* into, std::size_t most) { return std::fread(into, 1, most, stdin); }
void print(const char* text, std::size_t length) { std::fwrite(text, 1, length, stdout); }
void print_measure(const char*, std::size_t) {}
std::uint32_t instructions() { return 0; }
void mark_stack() {}
std::uint32_t stack_used() { return 0; }

}  // namespace machine

int main() { return run(); }
