#include "brov/derived.h"

#include "brov/rounding.h"
#include "brov/seawater.h"

namespace brov {

void fill_derived(SensorFields& fields, const EzoEcReader& ec, const Ms5837& depth, const Tsys01& celsius,
                  std::uint64_t now_us) {
  if (!depth.ok(now_us)) {
    return;
  }
  const double over_surface_pa = static_cast<double>(depth.pressure_pa()) - kSurfacePressurePa;
  const double sea_pressure_pa = over_surface_pa > 0.0 ? over_surface_pa : 0.0;
  const double depth_m = sea_pressure_pa / (kDensityKgPerM3 * kGravityMps2);
  fields.depth_cm = static_cast<std::uint16_t>(clamped(rounded(depth_m * 100.0), 0, 0xFFFF));
  if (!ec.alive(now_us) || !celsius.ok(now_us)) {
    return;
  }
  const double conductivity_s_per_m = ec.conductivity_dus() / 1e5;
  const double pss78_psu =
      practical_salinity_psu(conductivity_s_per_m, celsius.temperature_degc(), sea_pressure_pa / 1e4);
  const double salinity_psu = pss78_psu > 0.0 ? pss78_psu : 0.0;
  fields.salinity_dpsu = static_cast<std::uint8_t>(clamped(rounded(salinity_psu * 10.0), 0, 0xFF));
  double speed_mps = 0.0;
  if (mackenzie_sound_speed_mps(celsius.temperature_degc(), salinity_psu, depth_m, speed_mps)) {
    fields.sound_speed_dmps = static_cast<std::uint16_t>(rounded(speed_mps * 10.0));
  }
}

}  // namespace brov
