"""Water from what a CTD measures: salinity, density, sound speed, depth, the column under the vehicle.

Temperatures are ITS-90. Every formula refuses to answer outside the range it was published for: a single number raises
OutOfValidityError, an array gets NaN there.
"""

from bluerov_slam.navigation.seawater.cast import CtdCast
from bluerov_slam.navigation.seawater.density import density_kg_per_m3
from bluerov_slam.navigation.seawater.depth import (
    SEA_WATER_DENSITY_KG_PER_M3,
    STANDARD_ATMOSPHERE_PA,
    STANDARD_GRAVITY_MPS2,
    DepthFormula,
    SurfacePressure,
    VehicleDepth,
    depth_m,
    gravity_mps2,
    measured_water_depth_m,
    standard_ocean_depth_m,
    standard_ocean_pressure_pa,
    surface_pressure,
    vehicle_depth,
)
from bluerov_slam.navigation.seawater.profile import ColumnOptions, Extension, WaterColumn
from bluerov_slam.navigation.seawater.salinity import CONDUCTIVITY_35_15_0_S_PER_M, practical_salinity_psu
from bluerov_slam.navigation.seawater.sound_speed import (
    SoundSpeedFormula,
    del_grosso_sound_speed_mps,
    mackenzie_sound_speed_mps,
    marczak_sound_speed_mps,
    sound_speed_by_mps,
    sound_speed_mps,
    unesco_sound_speed_mps,
)

__all__ = [
    "CONDUCTIVITY_35_15_0_S_PER_M",
    "SEA_WATER_DENSITY_KG_PER_M3",
    "STANDARD_ATMOSPHERE_PA",
    "STANDARD_GRAVITY_MPS2",
    "ColumnOptions",
    "CtdCast",
    "DepthFormula",
    "Extension",
    "SoundSpeedFormula",
    "SurfacePressure",
    "VehicleDepth",
    "WaterColumn",
    "del_grosso_sound_speed_mps",
    "density_kg_per_m3",
    "depth_m",
    "gravity_mps2",
    "mackenzie_sound_speed_mps",
    "marczak_sound_speed_mps",
    "measured_water_depth_m",
    "practical_salinity_psu",
    "sound_speed_by_mps",
    "sound_speed_mps",
    "standard_ocean_depth_m",
    "standard_ocean_pressure_pa",
    "surface_pressure",
    "unesco_sound_speed_mps",
    "vehicle_depth",
]
