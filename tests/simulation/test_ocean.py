import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.simulation.conditions import CONDITIONS, conditions_of
from bluerov_slam.simulation.ocean import Ocean

STEP_S = 0.05
HERE, STILL = (0.0, 0.0, 8.0), (0.0, 0.0, 0.0)


def water(ocean: Ocean, duration_s: float, place: tuple[float, float, float] = HERE) -> tuple[np.ndarray, np.ndarray]:
    steps = [ocean.step((n + 1) * STEP_S, place, STILL) for n in range(int(duration_s / STEP_S))]
    return np.array([w.velocity_mps for w in steps]), np.array([w.acceleration_mps2 for w in steps])


def test_currents_spread_over_dives_and_walk_within_one() -> None:
    first, later = [], []
    for seed in range(200):
        ocean = Ocean(CONDITIONS["hard"], seed, STEP_S)
        first.append(ocean.current_ned_mps(0.0, 8.0)[:2])
        later.append(ocean.current_ned_mps(900.0, 8.0)[:2])
    start, moved = np.array(first), np.array(later) - np.array(first)
    assert start.std() == pytest.approx(0.2, rel=0.12)  # a little less: the strongest are cut off
    assert np.hypot(*start.T).max() <= 0.2 * 2.25 + 1e-12
    assert moved.std() == pytest.approx(0.001 * math.sqrt(900.0), rel=0.12)


@pytest.mark.parametrize(("name", "walk"), [("hard", 0.05), ("still", 0.03)])
def test_eddies_move_the_vehicle_like_white_velocity(name: str, walk: float) -> None:
    calm = replace(CONDITIONS[name], current_std_mps=0.0)
    moved = []
    for seed in range(3):
        velocity, _ = water(Ocean(calm, seed, STEP_S), 600.0)
        moved.append((velocity[:, :2].reshape(20, 600, 2) * STEP_S).sum(axis=1))  # over 30 s each
    assert np.array(moved).std() / math.sqrt(30.0) == pytest.approx(walk, rel=0.2)


def test_velocity_changes_by_the_acceleration() -> None:
    for family in ("nominal", "mismatched"):
        velocity, acceleration = water(Ocean(conditions_of("hard", family), 4, STEP_S), 200.0, (0.0, 0.0, 1.0))
        change = STEP_S * 0.5 * (acceleration[1:] + acceleration[:-1])
        drift = np.cumsum(change - np.diff(velocity, axis=0), axis=0)
        assert np.abs(drift).max() < 0.02


def test_waves_have_their_height_and_die_away_with_depth() -> None:
    conditions = replace(CONDITIONS["still"], wave_height_m=0.5, unmodelled_velocity_m_per_root_s=0.0)
    ocean = Ocean(conditions, 1, STEP_S)
    surface = np.array([ocean.step(0.05 * n, (0.0, 0.0, 0.0), STILL).surface_m for n in range(12_000)])
    assert 4.0 * surface.std() == pytest.approx(0.5, rel=0.1)
    shallow = water(Ocean(conditions, 1, STEP_S), 200.0, (0.0, 0.0, 0.5))[0].std()
    deep = water(Ocean(conditions, 1, STEP_S), 200.0, (0.0, 0.0, 8.0))[0].std()
    assert deep < 0.25 * shallow


def test_the_mismatched_family_has_bursts_and_sheared_current() -> None:
    nominal, mismatched = conditions_of("hard"), conditions_of("hard", "mismatched")
    quiet = replace(mismatched, current_std_mps=0.0, gust_std_mps=0.0, wave_height_m=0.0, tide_mps=0.0)
    velocity, _ = water(Ocean(quiet, 5, STEP_S), 2_000.0)
    level = velocity[:, :2].reshape(-1, 800, 2).std(axis=1)  # over 40 s each
    assert level.max() > 5.0 * level.min()
    kurtosis = (velocity[:, 0] ** 4).mean() / (velocity[:, 0] ** 2).mean() ** 2
    assert kurtosis > 3.5
    ocean = Ocean(mismatched, 1, STEP_S)
    assert ocean.current_ned_mps(0.0, 10.0)[0] == pytest.approx(0.9 * ocean.current_ned_mps(0.0, 0.0)[0])
    assert nominal.shear_share == nominal.gust_std_mps == nominal.wave_height_m == 0.0
