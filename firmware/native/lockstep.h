// The board in virtual time, driven over a pipe. docs/firmware-core.md section 7.
#pragma once

#include <cstdio>

namespace brov {

// Until the end of `in`; 0, or 2 behind a malformed message and one line on `errors`.
int run_lockstep(std::FILE* in, std::FILE* out, std::FILE* errors);

}  // namespace brov
