from typing import Any

import pytest

from bluerov_slam.pipeline.sea_water_watch import SeaWaterWatch
from bluerov_slam.protocol.sensor_frame import SensorFields
from bluerov_slam.records import CtdSample
from pipeline.esp32_stream import MESSAGES


def ctd_of(name: str = "sensors_full_range", surface_pressure_pa: float = 101_325.0, **changes: int) -> CtdSample:
    fields = SensorFields(**{**MESSAGES[name]["fields"], **changes})
    return SeaWaterWatch(surface_pressure_pa).samples(fields, 1.0, 2.0)[1]


def test_depth_counts_from_the_surface_pressure_in_use() -> None:
    high_lake = ctd_of(surface_pressure_pa=80_000.0, full_pressure_pa=80_000 + 100_518)
    assert high_lake.depth_m == pytest.approx(10.0, abs=1e-3)
    assert high_lake.surface_pressure_pa == 80_000.0


def test_above_the_surface_the_depth_is_zero() -> None:
    assert ctd_of(full_pressure_pa=100_000).depth_m == 0.0


def test_the_firmwares_sound_speed_is_used_where_it_sent_one() -> None:
    assert ctd_of(sound_speed_dmps=15000).sound_speed_mps == 1500.0


def test_else_the_sound_speed_is_computed_in_the_sea_and_in_a_pool() -> None:
    sea = ctd_of(sound_speed_dmps=0xFFFF)
    assert sea.salinity_psu is not None
    assert sea.sound_speed_mps == pytest.approx(1506, abs=1.5)
    pool = ctd_of(sound_speed_dmps=0xFFFF, full_conductivity_dus=5000, temperature_cdegc=2000)
    assert pool.salinity_psu == pytest.approx(0.27, abs=0.02)
    assert pool.sound_speed_mps == pytest.approx(1482.7, abs=0.3)


@pytest.mark.parametrize(
    ("changes", "unknown"),
    [
        ({"temperature_ok": 0}, ["salinity_psu", "sound_speed_mps", "temperature_degc"]),
        ({"ec_alive": 0}, ["salinity_psu", "sound_speed_mps", "conductivity_s_per_m"]),
        ({"depth_ok": 0}, ["salinity_psu", "sound_speed_mps", "depth_m", "pressure_pa"]),
        ({"temperature_cdegc": -500}, ["salinity_psu", "sound_speed_mps"]),
        ({"temperature_cdegc": 5000}, ["salinity_psu", "sound_speed_mps"]),
        ({"full_conductivity_dus": 900_000}, ["salinity_psu", "sound_speed_mps"]),
        ({"full_pressure_pa": 16_000_000, "temperature_cdegc": -500}, ["salinity_psu", "sound_speed_mps"]),
    ],
)
def test_what_cannot_be_computed_is_unknown(changes: dict[str, Any], unknown: list[str]) -> None:
    ctd = ctd_of(sound_speed_dmps=0xFFFF, **changes)
    for name in unknown:
        assert getattr(ctd, name) is None, name


def test_a_later_full_range_frame_clears_the_doubts() -> None:
    watch = SeaWaterWatch()
    for name in ("sensors_legacy", "sensors_full_range"):
        for pressure in (60_000, 100):
            fields = SensorFields(**{**MESSAGES[name]["fields"], "pressure_dmbar": pressure})
            watch.samples(fields, 1.0, 2.0)
        assert watch.pressure_distrusted is watch.conductivity_distrusted is (name == "sensors_legacy")


@pytest.mark.parametrize(("depth_cm", "pressure_dmbar", "believed"), [(7_000, 14_959, False), (3_000, 40_288, True)])
def test_a_link_opened_below_55_m_shows_no_wrapped_pressure(depth_cm: int, pressure_dmbar: int, believed: bool) -> None:
    """70 m are 80 495 counts of 0.1 mbar, of which 16 bits keep 14 959: alone they would pass for 5 m."""
    ctd = ctd_of("sensors_legacy", depth_cm=depth_cm, pressure_dmbar=pressure_dmbar)
    assert (ctd.pressure_pa is not None) is believed


def test_a_depth_that_old_firmware_never_fills_in_raises_no_doubt() -> None:
    assert ctd_of("sensors_legacy", depth_cm=0, pressure_dmbar=50_000).pressure_pa is not None
