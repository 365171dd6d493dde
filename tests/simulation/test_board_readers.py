"""What the board computes of sea water is what the host computes, up to the digits of the wire."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation import seawater
from bluerov_slam.simulation.board_readers.seawater import (
    SURFACE_PRESSURE_PA,
    mackenzie_sound_speed_mps,
    practical_salinity_psu,
)


@given(st.floats(2.5, 6.0), st.floats(0.0, 30.0), st.floats(0.0, 3.0e6))
def test_salinity_and_sound_speed_agree_with_the_host(
    conductivity_s_per_m: float, temperature_degc: float, sea_pressure_pa: float
) -> None:
    on_board_psu = practical_salinity_psu(conductivity_s_per_m, temperature_degc, sea_pressure_pa / 1e4)
    if not 3.0 <= on_board_psu <= 41.9:
        return
    pressure_pa = SURFACE_PRESSURE_PA + sea_pressure_pa
    on_host_psu = seawater.practical_salinity_psu(conductivity_s_per_m, temperature_degc, pressure_pa)
    assert on_board_psu == pytest.approx(on_host_psu, abs=1e-6)
    depth_m = sea_pressure_pa / (1025.0 * 9.80665)
    on_board_mps = mackenzie_sound_speed_mps(temperature_degc, on_board_psu, depth_m)
    if on_board_mps is not None:
        on_host_mps = seawater.mackenzie_sound_speed_mps(temperature_degc, on_board_psu, depth_m)
        assert on_board_mps == pytest.approx(on_host_mps, abs=1e-6)
