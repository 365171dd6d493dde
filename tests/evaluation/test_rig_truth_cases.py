"""R12: it judges the covariance, would see a dishonest one, and the figures told are those of the tuning rigs."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from bluerov_slam.evaluation import rig_truth_cases
from bluerov_slam.evaluation.rig_experiment import TOLD_SPREAD
from bluerov_slam.evaluation.rig_truth_cases import scattered_poses, score, thesis_poses
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.rig.collection_truth import counted_set_points
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM
from bluerov_slam.rig.uncertainty import set_point_errors
from bluerov_slam.rig.workspace import PlatformWorkspace
from bluerov_slam.simulation.rig import SimulatedRig

SEEDS = range(12)


@pytest.fixture(scope="module")
def scored():
    return [score(seed, TOLD_SPREAD) for seed in SEEDS]


def test_every_figure_stands_with_its_limits(scored) -> None:
    rows = {row.id: row for row in rig_truth_cases._judged("R12", "truth", [each.place for each in scored])}
    assert set(rows) == {"R12.nees", "R12.cover", "R12.rms", "R12.stated"}
    low, high = rows["R12.nees"].must.low, rows["R12.nees"].must.high
    assert 0.0 < low < 1.0 < high < 2.0
    # Between that of the rigs alone and that of no rigs at all.
    assert low < chi_square_quantile(0.025, 3.0 * len(scored)) / (3.0 * len(scored))
    assert (rows["R12.cover"].must.low, rows["R12.cover"].must.high) == (90.0, 98.0)


def test_a_covariance_a_quarter_as_large_is_seen(scored) -> None:
    dishonest = [(error, 0.25 * covariance) for error, covariance in (each.place for each in scored)]
    rows = {row.id: row for row in rig_truth_cases._judged("R12", "truth", dishonest)}
    assert rows["R12.nees"].met is False
    assert rows["R12.cover"].met is False


def test_the_memory_makes_places_better_and_ways_much_better(scored) -> None:
    def rms(pairs):
        return float(np.sqrt(np.mean([error @ error for error, _ in pairs])))

    place, alone, way = (rms([getattr(each, name) for each in scored]) for name in ("place", "alone", "way"))
    assert way < 0.6 * place < alone


def test_poses_are_within_reach_and_come_again_from_their_seed() -> None:
    space = PlatformWorkspace()
    for poses in (thesis_poses(np.random.default_rng(1)), scattered_poses(np.random.default_rng(1))):
        assert all(space.broken(point) is None for points in poses for point in points)
    first, again = (scattered_poses(np.random.default_rng(2)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    one, other = (score(3, TOLD_SPREAD, scattered=True).way for _ in range(2))
    np.testing.assert_array_equal(one[0], other[0])


def test_the_figures_told_are_the_likeliest_of_the_tuning_rigs() -> None:
    """By plate places of rigs of the tuning seeds, half or twice of any figure is less likely."""
    points = [np.zeros(6), np.array([0, 0, -12, 0, 0, 0.0]), np.array([4, -4, 0, -0.1, 0.07, 0.0])]
    scale = np.tile([1.0, 1.0, 1.0, 50.0, 50.0, 50.0], 4 * len(points))
    errors = []
    for seed in range(40):
        rig = SimulatedRig(seed)
        made = []
        for before, point in zip([points[0], *points], points, strict=False):
            told = np.tile(point, (4, 1))
            if point is not points[0]:
                rig.move(np.tile(before, (4, 1)), told, 1, 0.05)
            made.append(rig.true_set_points - counted_set_points(told))
        errors.append(np.array(made).transpose(1, 0, 2).ravel())
    white = np.array(errors) * scale

    def likelihood(spread) -> float:
        each = [set_point_errors(point, FO_SHIP_PLATFORM, spread) for point in points]
        own, alike = np.vstack([one.own for one in each]), np.vstack([one.alike for one in each])
        single = own @ own.T
        for k, one in enumerate(each):
            single[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] += one.play @ one.play.T
        total = np.kron(np.eye(4), single) + np.kron(np.ones((4, 4)), alike @ alike.T)
        factor = np.linalg.cholesky(total * np.outer(scale, scale) + 1e-9 * np.eye(len(scale)))
        left = np.linalg.solve(factor, white.T)
        return float(-len(white) * np.sum(np.log(np.diag(factor))) - 0.5 * np.sum(left**2))

    # The offsets between plates are none of a plate's own; of gains, arms and rods only the servos' stand out alone.
    plates = replace(TOLD_SPREAD, stacking_mm=0.0, base_alike_mm=0.0)
    best = likelihood(plates)
    assert {"servo_rad", "slop_rad"} < {each.name for each in fields(plates)}
    for name in ("servo_rad", "slop_rad", "gain_alike"):
        for share in (0.5, 2.0):
            assert likelihood(replace(plates, **{name: share * getattr(plates, name)})) < best - 3.0
