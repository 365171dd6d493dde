import math

import numpy as np
import pytest

from bluerov_slam.simulation.hull import (
    ADDED_MASS_KG,
    DRAG_X,
    DRAG_Y,
    DRAG_Z,
    FLOATING_DEPTH_M,
    INERTIA_KGM2,
    MASS_KG,
    NET_BUOYANCY_N,
    RIGHTING_ARM_M,
    Hull,
    State,
    Surroundings,
    drag_n,
    steady_speed_mps,
    step,
)

NOMINAL = Hull()
NOTHING = (0.0, 0.0, 0.0)
QUIET = Surroundings((0.0,) * 6, NOTHING, NOTHING, NOTHING, 0.0, (0.0, 0.0))
DEEP: State = (0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def rolled(roll_rad: float) -> State:
    return (*DEEP[:3], math.cos(roll_rad / 2.0), math.sin(roll_rad / 2.0), 0.0, 0.0, *DEEP[7:])


def run(
    state: State, around: Surroundings, duration_s: float, step_s: float = 0.05, hull: Hull = NOMINAL
) -> np.ndarray:
    states = [state]
    for _ in range(round(duration_s / step_s)):
        state, _ = step(hull, state, around, around, around, step_s)
        states.append(state)
    return np.array(states)


def pushed(**forces: float) -> Surroundings:
    names = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    return replace_thrust(tuple(forces.get(name, 0.0) for name in names))


def replace_thrust(thrust: tuple[float, ...]) -> Surroundings:
    return QUIET._replace(thrust=thrust, pull_ned_n=(0.0, 0.0, NET_BUOYANCY_N))  # trimmed to neutral


def test_terminal_speed_is_where_drag_equals_thrust() -> None:
    for axis, name, drag in ((7, "surge", DRAG_X), (8, "sway", DRAG_Y), (9, "heave", DRAG_Z)):
        for force_n in (5.0, 40.0, -25.0):
            speed = run(DEEP, pushed(**{name: force_n}), 30.0)[-1, axis]
            linear, square = drag
            assert linear * speed + square * speed * abs(speed) == pytest.approx(force_n, rel=2e-3)
            assert speed == pytest.approx(steady_speed_mps(force_n, drag), rel=2e-3)


def test_a_faster_hull_is_faster_by_its_scale() -> None:
    hull = Hull(surge_scale=0.12, sway_scale=-0.05)
    surge = run(DEEP, pushed(surge=40.0), 30.0, hull=hull)[-1, 7]
    sway = run(DEEP, pushed(sway=20.0), 30.0, hull=hull)[-1, 8]
    assert surge == pytest.approx(1.12 * steady_speed_mps(40.0), rel=2e-3)
    assert sway == pytest.approx(0.95 * steady_speed_mps(20.0, DRAG_Y), rel=2e-3)


def test_it_starts_with_the_mass_of_the_water_that_goes_along() -> None:
    speed = run(DEEP, pushed(surge=10.0), 0.05, step_s=0.01)[-1, 7]
    assert speed == pytest.approx(0.05 * 10.0 / (MASS_KG + ADDED_MASS_KG[0]), rel=0.03)


def test_released_it_rises_at_the_speed_its_buoyancy_gives() -> None:
    assert run(DEEP, QUIET, 30.0)[-1, 9] == pytest.approx(-steady_speed_mps(NET_BUOYANCY_N, DRAG_Z), rel=1e-3)


def test_it_floats_where_weight_equals_buoyancy() -> None:
    floating = run((0.0, 0.0, 0.3, *DEEP[3:]), QUIET, 60.0)
    assert floating[-1, 2] == pytest.approx(FLOATING_DEPTH_M, abs=1e-3)
    assert abs(floating[-1, 9]) < 1e-3


def test_the_righting_moment_rolls_it_upright_at_its_own_period() -> None:
    buoyancy_n = MASS_KG * 9.80665 + NET_BUOYANCY_N
    period_s = 2.0 * math.pi * math.sqrt(INERTIA_KGM2[0] / (buoyancy_n * RIGHTING_ARM_M))
    roll = 2.0 * run(rolled(0.05), QUIET, 6.0, step_s=0.01)[:, 4]
    crossings = np.flatnonzero(np.diff(np.sign(roll)) != 0) * 0.01
    assert np.diff(crossings).mean() * 2.0 == pytest.approx(period_s, rel=0.04)
    assert abs(2.0 * run(rolled(0.5), QUIET, 40.0)[-1, 4]) < 0.01


def test_without_thrust_energy_only_goes() -> None:
    tossed = (*rolled(0.6)[:7], 0.8, -0.5, 0.3, 0.7, -0.4, 0.9)
    states = run(tossed, replace_thrust((0.0,) * 6), 20.0, step_s=0.02)
    masses = np.array([MASS_KG + added for added in ADDED_MASS_KG])
    buoyancy_n = MASS_KG * 9.80665 + NET_BUOYANCY_N
    _, _, _, _, x, y, _, *moving = states.T
    energy = 0.5 * (masses[:, None] * np.array(moving[:3]) ** 2).sum(axis=0)
    energy += 0.5 * (np.array(INERTIA_KGM2)[:, None] * np.array(moving[3:]) ** 2).sum(axis=0)
    energy += buoyancy_n * RIGHTING_ARM_M * 2.0 * (x * x + y * y)  # 1 - cos of the lean
    # Munk's moment is cut down by hand, so a little work is done while it turns; drag takes more.
    assert np.diff(energy).max() < 2e-3
    assert energy[-1] < 0.02 * energy[0]


def test_half_the_step_changes_nothing_that_a_sensor_could_see() -> None:
    thrown = (*rolled(0.3)[:7], 0.6, -0.2, 0.1, 0.4, -0.3, 0.5)
    around = pushed(surge=35.0, sway=-8.0, yaw=1.5)
    whole, half = run(thrown, around, 60.0, 0.05)[-1], run(thrown, around, 60.0, 0.025)[-1]
    assert np.abs(whole[:3] - half[:3]).max() < 1e-4
    assert np.abs(whole[3:7] - half[3:7]).max() < 1e-5


def test_water_that_moves_steadily_only_carries_it_along() -> None:
    around = pushed(surge=30.0, yaw=0.5)
    still, carried = run(DEEP, around, 20.0), run(DEEP, around._replace(water_ned_mps=(0.3, -0.2, 0.0)), 20.0)
    assert carried[-1, :2] == pytest.approx(still[-1, :2] + 20.0 * np.array((0.3, -0.2)), abs=1e-9)
    assert carried[-1, 3:] == pytest.approx(still[-1, 3:], abs=1e-12)


def test_drag_and_speed_are_inverse() -> None:
    for speed in (-1.2, -0.3, 0.0, 0.05, 0.8):
        assert steady_speed_mps(drag_n(speed)) == pytest.approx(speed, abs=1e-12)
