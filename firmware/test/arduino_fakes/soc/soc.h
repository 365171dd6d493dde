#pragma once

#include <cstdint>

#define REG_READ(address) fake_register(address)

std::uint32_t fake_register(std::uint32_t address);
