import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import (
    SoundSpeedFormula,
    del_grosso_sound_speed_mps,
    depth_m,
    mackenzie_sound_speed_mps,
    marczak_sound_speed_mps,
    sound_speed_by_mps,
    sound_speed_mps,
    unesco_sound_speed_mps,
)

KG_PER_CM2_PA = 98_066.5


def test_mackenzie_matches_its_published_value() -> None:
    assert mackenzie_sound_speed_mps(25.0, 35.0, 1000.0) == pytest.approx(1550.744, abs=5e-4)


def test_the_sea_of_the_original_example() -> None:
    assert mackenzie_sound_speed_mps(15.2, 35.5, 0.5) == pytest.approx(1507.9, abs=0.05)


def test_unesco_matches_its_published_value() -> None:
    # UNESCO technical paper 44 (1983), check value of SVEL, for the coefficients on IPTS-68.
    assert unesco_sound_speed_mps(40 / 1.00024, 40.0, 1e8) == pytest.approx(1731.995, abs=0.01)


def test_unesco_matches_pure_water() -> None:
    # Del Grosso and Mader (1972): 1482.34 m/s at 20 degC.
    assert unesco_sound_speed_mps(20.0, 0.0, 0.0) == pytest.approx(1482.34, abs=0.05)


def test_del_grosso_matches_the_calculator_of_the_national_physical_laboratory() -> None:
    # As quoted in the tests of github.com/gorbatschow/Sonar.m for NPL's technical guide "Speed of sound in sea water":
    # 5 degC, 35 PSU, 100 kPa, with 1.019716 kg/cm2 in 100 kPa.
    assert del_grosso_sound_speed_mps(5.0, 35.0, 1.019716 * KG_PER_CM2_PA) == pytest.approx(
        1470.8074947307055, abs=1e-9
    )


def del_grosso_of_1974(t: np.ndarray, s: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The equation before it was refitted to ITS-90: other coefficients, IPTS-68, kg/cm2 (doi:10.1121/1.1903388)."""
    return (
        1402.392
        + 0.501109398873e1 * t
        - 0.550946843172e-1 * t**2
        + 0.221535969240e-3 * t**3
        + 0.132952290781e1 * s
        + 0.128955756844e-3 * s**2
        + 0.156059257041e0 * p
        + 0.244998688441e-4 * p**2
        - 0.883392332513e-8 * p**3
        - 0.127562783426e-1 * t * s
        + 0.635191613389e-2 * t * p
        + 0.265484716608e-7 * t**2 * p**2
        - 0.159349479045e-5 * t * p**2
        + 0.522116437235e-9 * t * p**3
        - 0.438031096213e-6 * t**3 * p
        - 0.161674495909e-8 * s**2 * p**2
        + 0.968403156410e-4 * t**2 * s
        + 0.485639620015e-5 * t * s**2 * p
        - 0.340597039004e-3 * s * t * p
    )


def box(low_psu: float, high_psu: float, high_degc: float = 30.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Temperature, salinity and pressure (Pa) all over a range of validity."""
    t, s, p = np.meshgrid(np.linspace(0, high_degc, 11), np.linspace(low_psu, high_psu, 11), np.linspace(0, 9.8e7, 11))
    return t, s, p


def test_del_grosso_is_the_equation_of_1974_on_the_new_scale() -> None:
    t, s, p = box(30, 40)
    ours = del_grosso_sound_speed_mps(t, s, p)
    # Wong and Zhu (1995): the change of scale is within 0.017 m/s; here it is undone, their refit remains.
    assert np.max(np.abs(ours - del_grosso_of_1974(t * 1.00024, s, p / KG_PER_CM2_PA))) < 0.005


def test_the_formulas_agree_where_vehicles_dive() -> None:
    t, s, p = box(33, 38)
    speeds = [sound_speed_by_mps(formula, t, s, p * 0.03) for formula in SoundSpeedFormula]
    # The UNESCO equation is known to be the one that differs: up to 0.5 m/s in warm water at 300 m.
    for speed in speeds[1:]:
        assert np.max(np.abs(speed - speeds[0])) < 0.5
    mackenzie, _, del_grosso = speeds
    assert np.max(np.abs(mackenzie - del_grosso)) < 0.16


@pytest.mark.parametrize(
    # Del Grosso and Mader (1972), doi:10.1121/1.1913258, measured to 0.015 m/s; 20 degC in many textbooks as 1482.34.
    ("temperature_degc", "expected_mps"),
    [(0.0, 1402.39), (20.0, 1482.34), (25.0, 1496.69), (30.0, 1509.13)],
)
def test_marczak_matches_measured_pure_water(temperature_degc: float, expected_mps: float) -> None:
    assert marczak_sound_speed_mps(temperature_degc) == pytest.approx(expected_mps, abs=0.05)


def test_marczak_has_its_well_known_maximum() -> None:
    t = np.linspace(60.0, 90.0, 3001)
    speed = marczak_sound_speed_mps(t)
    # Water is fastest near 74 degC, 1555.1 m/s.
    assert t[np.argmax(speed)] == pytest.approx(74.0, abs=0.5)
    assert speed.max() == pytest.approx(1555.1, abs=0.1)


def test_marczak_is_the_unesco_equation_without_salt() -> None:
    t = np.linspace(0.0, 40.0, 41)
    assert np.max(np.abs(marczak_sound_speed_mps(t) - unesco_sound_speed_mps(t, 0 * t, 0 * t))) < 0.06


@pytest.mark.parametrize("arguments", [(-2.1, 35, 0), (30.1, 35, 0), (10, 29.9, 0), (10, 40.1, 0), (10, 35, 8001)])
def test_mackenzie_refuses_outside_its_range(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(OutOfValidityError):
        mackenzie_sound_speed_mps(*arguments)


@pytest.mark.parametrize("arguments", [(-0.1, 35, 0), (40.1, 35, 0), (10, -0.1, 0), (10, 40.1, 0), (10, 35, 1.01e8)])
def test_unesco_refuses_outside_its_range(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(OutOfValidityError):
        unesco_sound_speed_mps(*arguments)


@pytest.mark.parametrize(
    "arguments", [(-0.1, 35, 0), (30.1, 35, 0), (10, 29.9, 0), (10, 40.1, 0), (10, 35, 9.81e7), (10, 35, -1)]
)
def test_del_grosso_refuses_outside_its_range(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(OutOfValidityError):
        del_grosso_sound_speed_mps(*arguments)


@pytest.mark.parametrize("temperature_degc", [-0.1, 95.1, float("nan")])
def test_marczak_refuses_outside_its_range(temperature_degc: float) -> None:
    with pytest.raises(OutOfValidityError):
        marczak_sound_speed_mps(temperature_degc)


@pytest.mark.parametrize(
    "formula", [mackenzie_sound_speed_mps, unesco_sound_speed_mps, del_grosso_sound_speed_mps, sound_speed_mps]
)
def test_arrays_give_the_same_numbers_and_nan_outside(formula: object) -> None:
    t = np.array([10.0, 20.0, -9.0, np.nan])
    s, p = np.full(4, 35.0), np.array([0.0, 100.0, 100.0, 100.0])
    answers = formula(t, s, p)  # type: ignore[operator]
    assert answers[0] == pytest.approx(formula(10.0, 35.0, 0.0), abs=1e-9)  # type: ignore[operator]
    assert answers[1] == pytest.approx(formula(20.0, 35.0, 100.0), abs=1e-9)  # type: ignore[operator]
    assert np.isnan(answers[2:]).all()


def test_the_formula_in_use_changes_where_mackenzie_ends() -> None:
    assert sound_speed_mps(15.0, 35.0, 1e6) == mackenzie_sound_speed_mps(15.0, 35.0, depth_m(1e6, 0.0))
    assert sound_speed_mps(15.0, 5.0, 1e6) == unesco_sound_speed_mps(15.0, 5.0, 1e6)
    assert sound_speed_mps(15.0, 30.0, 1e6) == pytest.approx(unesco_sound_speed_mps(15.0, 30.0, 1e6), abs=0.5)
    with pytest.raises(OutOfValidityError):
        sound_speed_mps(-1.0, 5.0, 0.0)
    both = sound_speed_mps(np.full(2, 15.0), np.array([35.0, 5.0]), np.full(2, 1e6))
    assert both[0] == pytest.approx(sound_speed_mps(15.0, 35.0, 1e6))
    assert both[1] == pytest.approx(sound_speed_mps(15.0, 5.0, 1e6))


def test_noise_of_the_sensor_above_the_surface_is_the_surface() -> None:
    for formula in SoundSpeedFormula:
        assert sound_speed_by_mps(formula, 15.0, 35.0, -300.0) == sound_speed_by_mps(formula, 15.0, 35.0, 0.0)
