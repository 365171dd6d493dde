// What the runner needs beyond the core: its input, its output, and a clock that counts instructions.
#pragma once

#include <cstddef>
#include <cstdint>

namespace machine {

// The next bytes of the scenario; fewer than `most` only at its end.
std::size_t read_scenario(std::uint8_t* into, std::size_t most);
// Lines that every machine must give alike.
void print(const char* text, std::size_t length);
// Lines about this machine alone.
void print_measure(const char* text, std::size_t length);
// Instructions so far, modulo 2^32; 0 for ever where they are not counted.
std::uint32_t instructions();
// Bytes of stack that have been in use since the last call at this depth or above, 0 where that is not known.
void mark_stack();
std::uint32_t stack_used();

}  // namespace machine

// 0 when every shared vector is as expected and the scenario is whole.
int run();
