// The one timer of the board: microseconds since boot, 64 bits wide, the same on both cores.
#pragma once

#include <cstdint>

#include <esp_timer.h>

namespace brov {

inline std::uint64_t device_us() { return static_cast<std::uint64_t>(esp_timer_get_time()); }

}  // namespace brov
