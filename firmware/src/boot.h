// How the board came up: why it was reset, how often it has started, and the line of text that says so.
#pragma once

#include <cstddef>
#include <cstdint>

namespace brov {

// The ESP-IDF's numbers, as STATUS carries them; 0 for what it does not know.
std::uint8_t reset_reason();
// The same words as on the dashboard.
const char* reset_reason_text(std::uint8_t reason);
// Whether nobody asked for this start.
bool is_fault(std::uint8_t reason);

// One more start, kept in flash; wraps at 65 536. Always 0 where the flash cannot be written.
std::uint16_t count_boot();

constexpr std::size_t kMaxBootText = 120;
// "BlueROV SLAM firmware 0.2.0: start 12 (brown-out), 115200 baud" and a line end; returns its length.
std::size_t write_boot_text(std::uint16_t boot_count, std::uint8_t reason, std::uint32_t baud,
                            char (&into)[kMaxBootText]);

}  // namespace brov
