"""Our formulas against TEOS-10, the equation of state of 2010, which was fitted without them."""

import numpy as np
import pytest

from bluerov_slam.errors import ExpectedError
from bluerov_slam.navigation import seawater
from bluerov_slam.navigation.seawater import teos10

pytestmark = pytest.mark.skipif(
    not teos10.is_available(),
    reason="no gsw: TEOS-10 cannot be compared with (cure: pip install 'bluerov-slam[teos10]')",
)

# Mid-Atlantic: the salt is that of the reference composition within 0.02 g/kg.
ATLANTIC_DEG = (30.0, -40.0)


def water(low_psu: float = 30.0, deepest_pa: float = 3e6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The water that vehicles meet: down to 300 m."""
    t, s, p = np.meshgrid(np.linspace(0, 30, 11), np.linspace(low_psu, 40, 11), np.linspace(0, deepest_pa, 7))
    return t, s, p


def test_salinity_is_that_of_teos_10() -> None:
    conductivity = np.linspace(0.025, 5.9, 236)
    t = np.full_like(conductivity, 18.0)
    ours = seawater.practical_salinity_psu(conductivity, t, np.full_like(t, seawater.STANDARD_ATMOSPHERE_PA))
    theirs = teos10.practical_salinity_psu(conductivity, t, np.zeros_like(t))
    sea, fresh = ours >= 2, ours < 2
    assert np.count_nonzero(sea) > 150
    assert np.count_nonzero(fresh) > 10
    assert ours[sea] == pytest.approx(theirs[sea], abs=1e-10)
    # Below 2 PSU theirs is stretched to meet PSS-78 without a step; Hill's own has one of less than 0.001 PSU.
    assert ours[fresh] == pytest.approx(theirs[fresh], abs=5e-4)
    # Ours ends where PSS-78 does.
    assert np.array_equal(np.isnan(ours), theirs > 42)


def test_density_is_that_of_teos_10() -> None:
    t, s, p = water()
    theirs = teos10.density_kg_per_m3(t, s, p, *ATLANTIC_DEG)
    assert np.max(np.abs(seawater.density_kg_per_m3(t, s, p) - theirs)) < 0.03
    t, s, p = water(deepest_pa=1e8)
    theirs = teos10.density_kg_per_m3(t, s, p, *ATLANTIC_DEG)
    assert np.max(np.abs(seawater.density_kg_per_m3(t, s, p) - theirs)) < 0.06


@pytest.mark.parametrize(
    ("formula", "within_mps"),
    [
        # The worst lies at 30 degC and 300 m, which no sea has.
        (seawater.SoundSpeedFormula.MACKENZIE, 0.21),
        (seawater.SoundSpeedFormula.UNESCO, 0.29),
        (seawater.SoundSpeedFormula.DEL_GROSSO, 0.18),
    ],
)
def test_sound_speed_is_that_of_teos_10(formula: seawater.SoundSpeedFormula, within_mps: float) -> None:
    t, s, p = water()
    theirs = teos10.sound_speed_mps(t, s, p, *ATLANTIC_DEG)
    assert np.max(np.abs(seawater.sound_speed_by_mps(formula, t, s, p) - theirs)) < within_mps


def test_fresh_water_is_that_of_teos_10() -> None:
    t = np.linspace(0.0, 40.0, 41)
    theirs = teos10.sound_speed_mps(t, 0 * t, 0 * t, *ATLANTIC_DEG)
    assert np.max(np.abs(seawater.marczak_sound_speed_mps(t) - theirs)) < 0.04
    assert np.max(np.abs(seawater.unesco_sound_speed_mps(t, 0 * t, 0 * t) - theirs)) < 0.04


@pytest.mark.parametrize("latitude_deg", [0.0, 45.0, 90.0])
def test_depth_is_that_of_teos_10(latitude_deg: float) -> None:
    shallow = np.linspace(0.0, 1e7, 11)
    theirs = teos10.standard_ocean_depth_m(shallow, latitude_deg)
    assert np.max(np.abs(seawater.standard_ocean_depth_m(shallow, latitude_deg) - theirs)) < 0.01
    deepest = teos10.standard_ocean_depth_m(1e8, latitude_deg)
    assert seawater.standard_ocean_depth_m(1e8, latitude_deg) == pytest.approx(float(deepest), abs=1.5)


@pytest.mark.parametrize("latitude_deg", [0.0, 45.0, 90.0])
def test_gravity_is_that_of_teos_10(latitude_deg: float) -> None:
    p = np.linspace(0.0, 1e8, 11)
    assert seawater.gravity_mps2(latitude_deg, p) == pytest.approx(teos10.gravity_mps2(p, latitude_deg), rel=4e-5)


def test_without_the_library_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ExpectedError, match="teos10"):
        teos10.density_kg_per_m3(10.0, 35.0, 0.0, *ATLANTIC_DEG)
