// Any bytes at any times into the reader of the conductivity probe.
#include "brov/sensors.h"
#include "fuzz_input.h"

using namespace brov;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzInput input(data, size);
  FuzzBus bus(input);
  FuzzHal<FuzzBus> hal(bus);
  EzoEcReader reader;
  reader.start(0);
  std::uint64_t now_us = 0;
  while (!input.empty()) {
    now_us += input.pause_us();
    reader.feed(input.batch(), now_us);
    reader.configure(now_us, hal);
    SensorFields fields;
    reader.fill(fields, now_us);
    require(fields.ec_alive == 1 || (fields.full_conductivity_dus == 0xFFFFFF && fields.ec_salinity_cpsu == 0xFFFF));
    require(fields.ec_alive == 0 || fields.full_conductivity_dus <= 0xFFFFFE);
    require(fields.ec_salinity_cpsu <= 4200 || fields.ec_salinity_cpsu == 0xFFFF);
  }
  return 0;
}
