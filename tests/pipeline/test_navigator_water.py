"""Depth through water whose density is known: a lake, a sea with a thermocline, and too little known of it."""

import math

import numpy as np
import pytest

from bluerov_slam.navigation.seawater import density_kg_per_m3, gravity_mps2
from bluerov_slam.pipeline.navigator_water import Water, water_json
from pipeline.navigator_records import ctd_sample

SURFACE_PA = 98_000.0
LATITUDE_DEG = 60.0
UNKNOWN = 0.016
STEP_M = 0.02


class Lake:
    """Water of given temperature and salinity by depth, its pressure summed up from the surface in 2 cm steps."""

    def __init__(self, deepest_m: float, salt_psu: float, warm_degc: float, cold_degc: float) -> None:
        self.depth_m = np.arange(0.0, deepest_m, STEP_M)
        warm = 1.0 / (1.0 + np.exp((self.depth_m - 12.0) / 1.5))
        self.temperature_degc = cold_degc + (warm_degc - cold_degc) * warm
        self.salinity_psu = np.full_like(self.depth_m, salt_psu)
        self.pressure_pa = np.zeros_like(self.depth_m)
        for k in range(1, len(self.depth_m)):
            before_pa = float(self.pressure_pa[k - 1])
            density = density_kg_per_m3(float(self.temperature_degc[k]), salt_psu, before_pa)
            self.pressure_pa[k] = before_pa + density * gravity_mps2(LATITUDE_DEG, 0.0) * STEP_M

    def dive(self, water: Water, from_m: float, to_m: float, start_s: float = 0.0, salt: bool = True) -> None:
        """Down or up at 0.3 m/s, five samples a second."""
        count = round(abs(to_m - from_m) / 0.3 * 5.0)
        for k, depth in enumerate(np.linspace(from_m, to_m, count)):
            water.take(self.sample(start_s + 0.2 * k, float(depth), salt), SURFACE_PA)

    def sample(self, at_s: float, depth_m: float, salt: bool = True):
        row = int(np.searchsorted(self.depth_m, depth_m - 1e-9))
        return ctd_sample(
            at_s,
            pressure_pa=SURFACE_PA + float(self.pressure_pa[row]),
            temperature_degc=float(self.temperature_degc[row]),
            salinity_psu=float(self.salinity_psu[row]) if salt else None,
        )

    def sea_pressure_pa(self, depth_m: float) -> float:
        return float(np.interp(depth_m, self.depth_m, self.pressure_pa))


@pytest.fixture(scope="module")
def fresh() -> Lake:
    return Lake(60.0, 0.2, 22.0, 6.0)


def depth_of(water: Water, lake: Lake, depth_m: float) -> tuple[float, float]:
    """Error and stated standard deviation of a depth, both m."""
    found_m, relative_std = water.depth(SURFACE_PA + lake.sea_pressure_pa(depth_m), SURFACE_PA)
    return found_m - depth_m, relative_std * found_m


@pytest.mark.parametrize("depth_m", [2.0, 15.0, 40.0])
def test_depth_in_a_lake_is_that_of_its_own_water(fresh: Lake, depth_m: float) -> None:
    water = Water(UNKNOWN)
    water.latitude_deg = LATITUDE_DEG
    fresh.dive(water, 0.0, 45.0)
    error_m, std_m = depth_of(water, fresh, depth_m)
    assert abs(error_m) < 0.01
    assert std_m < 1e-3 * depth_m
    assert abs(error_m) < 3.0 * std_m + 0.003


def test_without_salinity_the_error_is_that_of_an_unknown_water_and_said(fresh: Lake) -> None:
    water = Water(UNKNOWN)
    water.latitude_deg = LATITUDE_DEG
    fresh.dive(water, 0.0, 45.0, salt=False)
    assert water.column is None
    error_m, std_m = depth_of(water, fresh, 40.0)
    assert 0.9 < abs(error_m) < 1.3  # 2.8 %: no ocean is fresh
    assert abs(error_m) < 2.5 * std_m


def test_an_unknown_latitude_is_counted_as_gravity_that_may_differ(fresh: Lake) -> None:
    known, unknown = Water(UNKNOWN), Water(UNKNOWN)
    known.latitude_deg = LATITUDE_DEG
    for water in (known, unknown):
        fresh.dive(water, 0.0, 45.0)
    error_m, std_m = depth_of(unknown, fresh, 40.0)
    assert abs(error_m) > 0.04  # 45 degrees were taken for 60
    assert abs(error_m) < 2.0 * std_m
    assert std_m > 1.3 * depth_of(known, fresh, 40.0)[1]


def test_begun_in_mid_dive_the_water_there_stands_for_all_above(fresh: Lake) -> None:
    water = Water(UNKNOWN)
    water.latitude_deg = LATITUDE_DEG
    fresh.dive(water, 30.0, 40.0)
    error_m, std_m = depth_of(water, fresh, 40.0)
    assert 0.003 < abs(error_m) < 0.1
    assert abs(error_m) < 2.0 * std_m
    assert std_m == pytest.approx(0.04, rel=0.05)


def test_below_what_was_sampled_depth_is_less_sure(fresh: Lake) -> None:
    water = Water(UNKNOWN)
    water.latitude_deg = LATITUDE_DEG
    fresh.dive(water, 0.0, 11.0)
    inside = depth_of(water, fresh, 10.0)[1] / 10.0
    error_m, std_m = depth_of(water, fresh, 40.0)
    assert abs(error_m) < 2.0 * std_m
    assert std_m / 40.0 > 2.0 * inside


def test_the_air_above_is_no_water_and_zeroing_moves_the_profile(fresh: Lake) -> None:
    water = Water(UNKNOWN)
    for k in range(100):
        water.take(ctd_sample(0.2 * k, pressure_pa=SURFACE_PA, temperature_degc=30.0, salinity_psu=0.0), SURFACE_PA)
    assert water.make_now() is None
    fresh.dive(water, 0.0, 20.0, start_s=30.0)
    deepest_m = water.make_now().deepest_m
    water.rezero(9_800.0)
    assert water.column.deepest_m == pytest.approx(deepest_m + 1.0, abs=0.01)


def test_a_sample_that_is_not_a_number_changes_nothing(fresh: Lake) -> None:
    water = Water(UNKNOWN)
    fresh.dive(water, 0.0, 10.0)
    before = water.make_now().temperature_at_degc(8.0)
    for at_s in (50.0, 51.0, 52.0):
        for name in ("pressure_pa", "temperature_degc", "salinity_psu"):
            known = {"pressure_pa": SURFACE_PA + 80_000.0, "temperature_degc": 9.0, "salinity_psu": 0.2}
            water.take(ctd_sample(at_s, **(known | {name: math.nan})), SURFACE_PA)
    assert water.make_now().temperature_at_degc(8.0) == before


def test_the_profile_says_sound_speed_and_density_by_depth(fresh: Lake) -> None:
    water = Water(UNKNOWN)
    water.latitude_deg = LATITUDE_DEG
    fresh.dive(water, 0.0, 30.0)
    profile = water_json(water.make_now())
    depths = [node["depth_m"] for node in profile["nodes"]]
    assert depths == sorted(depths)
    assert len(depths) == 30
    top, bottom = profile["nodes"][1], profile["nodes"][-1]
    # Marczak (1997) for fresh water: 22 degC 1488.3 m/s, 6 degC 1430.6 m/s; 0.2 PSU and 3 bar add 0.2 and 0.7 m/s.
    assert top["sound_speed_mps"] == pytest.approx(1488.5, abs=0.5)
    assert bottom["sound_speed_mps"] == pytest.approx(1431.3, abs=0.5)
    assert top["density_kg_per_m3"] == pytest.approx(997.9, abs=0.1)
    assert profile["shallowest_m"] == 0.0
    assert 1431.0 < profile["mean_sound_speed_mps"] < 1488.0
    assert all(node["from_descent"] for node in profile["nodes"][1:-1])
