// The settings that survive power-off (rates and decimation), in the ESP32's NVS.
#pragma once

#include "brov/settings.h"

namespace brov {

// What was saved; the default for what is not there or out of its range.
Settings load_settings(std::uint32_t boot_baud);
// Writing to flash stops both cores for some milliseconds (tens where a page has to be erased).
void store_settings(const Settings& settings);

}  // namespace brov
