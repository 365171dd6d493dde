// What SENSORS says about the water from several sensors at once. docs/firmware-core.md section 6.
#pragma once

#include "brov/ezo_ec.h"
#include "brov/ms5837.h"
#include "brov/tsys01.h"

namespace brov {

// Depth, salinity and sound speed; each stays unknown unless every sensor it needs has a fresh reading.
void fill_derived(SensorFields& fields, const EzoEcReader& ec, const Ms5837& depth, const Tsys01& celsius,
                  std::uint64_t now_us);

}  // namespace brov
