"""What SENSORS says about the water from several sensors at once."""

from __future__ import annotations

from bluerov_slam.simulation.board_readers.ezo_ec import EzoEcReader
from bluerov_slam.simulation.board_readers.ms5837 import Ms5837
from bluerov_slam.simulation.board_readers.readings import Fields, rounded
from bluerov_slam.simulation.board_readers.seawater import (
    DENSITY_KG_PER_M3,
    GRAVITY_MPS2,
    SURFACE_PRESSURE_PA,
    mackenzie_sound_speed_mps,
    practical_salinity_psu,
)
from bluerov_slam.simulation.board_readers.tsys01 import Tsys01


def fill_derived(fields: Fields, ec: EzoEcReader, depth: Ms5837, celsius: Tsys01, now_us: int) -> None:
    """Depth, salinity and sound speed; each stays unknown unless every sensor it needs has a fresh reading."""
    if not depth.ok(now_us):
        return
    sea_pressure_pa = max(0.0, depth.pressure_pa - SURFACE_PRESSURE_PA)
    depth_m = sea_pressure_pa / (DENSITY_KG_PER_M3 * GRAVITY_MPS2)
    fields["depth_cm"] = min(rounded(depth_m * 100.0), 0xFFFF)
    if not ec.alive(now_us) or not celsius.ok(now_us):
        return
    pss78_psu = practical_salinity_psu(ec.conductivity_dus / 1e5, celsius.temperature_degc, sea_pressure_pa / 1e4)
    salinity_psu = max(0.0, pss78_psu)
    fields["salinity_dpsu"] = min(rounded(salinity_psu * 10.0), 0xFF)
    speed_mps = mackenzie_sound_speed_mps(celsius.temperature_degc, salinity_psu, depth_m)
    if speed_mps is not None:
        fields["sound_speed_dmps"] = rounded(speed_mps * 10.0)
