#include "settings_store.h"

#include <Preferences.h>

namespace brov {

namespace {

constexpr char kNamespace[] = "brov-settings";

struct Entry {
  const char* name;
  ConfigKey key;
};
constexpr Entry kSensorsRate{"sensors_mhz", ConfigKey::kSensorsRate};
constexpr Entry kImuRate{"imu_mhz", ConfigKey::kImuRate};
constexpr Entry kDecimation{"decimation", ConfigKey::kDecimation};

std::uint32_t load(Preferences& flash, const Entry& entry, std::uint32_t otherwise) {
  const std::uint32_t value = flash.getUInt(entry.name, otherwise);
  return config_allowed(static_cast<std::uint8_t>(entry.key), value) ? value : otherwise;
}

}  // namespace

Settings load_settings(std::uint32_t boot_baud) {
  Settings settings;
  settings.baud = boot_baud;
  Preferences flash;
  if (!flash.begin(kNamespace, true)) return settings;  // nothing was ever saved
  settings.sensors_rate_mhz = load(flash, kSensorsRate, settings.sensors_rate_mhz);
  settings.imu_rate_mhz = load(flash, kImuRate, settings.imu_rate_mhz);
  settings.decimation = static_cast<std::uint8_t>(load(flash, kDecimation, settings.decimation));
  flash.end();
  return settings;
}

void store_settings(const Settings& settings) {
  Preferences flash;
  if (!flash.begin(kNamespace, false)) return;
  flash.putUInt(kSensorsRate.name, settings.sensors_rate_mhz);
  flash.putUInt(kImuRate.name, settings.imu_rate_mhz);
  flash.putUInt(kDecimation.name, settings.decimation);
  flash.end();
}

}  // namespace brov
