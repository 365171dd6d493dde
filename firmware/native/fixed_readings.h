// Register contents that make the I2C sensors read given values.
#pragma once

#include <optional>

#include "i2c_models.h"

namespace brov {

// A sensor without a value does not answer. The MS5837 measures the temperature too and needs both.
void set_fixed_readings(I2cModels& models, std::optional<double> pressure_pa, std::optional<double> temperature_degc);

}  // namespace brov
