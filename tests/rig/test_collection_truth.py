"""The truth that a collection writes: whole counts, one rig over all points, sessions of their own."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.rig.collection import set_point_of
from bluerov_slam.rig.collection_truth import CollectionTruth, counted_set_points, truth_spread
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, FO_SHIP_SERVOS
from bluerov_slam.rig.gauge import servo_errors
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servos import counts_of
from bluerov_slam.rig.stack import stack_pose

LEVEL = np.radians([-0.3, -1.9, 0.0])


def test_set_points_are_what_whole_counts_make() -> None:
    told = np.array([set_point_of("A", 10.0), set_point_of("A", 10.0), set_point_of("Z", 8.0), np.zeros(6)])
    made = counted_set_points(told)
    angles = np.array([servo_angles_rad(each, FO_SHIP_PLATFORM) for each in made])
    counts = counts_of(angles, FO_SHIP_SERVOS)
    exact = FO_SHIP_SERVOS.middle_counts + FO_SHIP_SERVOS.offset_counts
    exact = exact + np.where(FO_SHIP_SERVOS.reversed_, -1.0, 1.0) * FO_SHIP_SERVOS.counts_per_rad * angles
    np.testing.assert_allclose(exact, counts, atol=1e-6)
    np.testing.assert_array_equal(made[0], made[1])
    miss = np.abs(made - told)
    assert 0.0 < np.max(miss[:, :3]) < 0.5
    assert np.degrees(np.max(miss[:, 3:])) < 0.5


def test_out_of_a_servos_range_there_is_no_truth() -> None:
    place, covariance = CollectionTruth()(set_point_of("Z", -400.0), LEVEL)
    assert np.all(np.isnan(place))
    assert np.all(np.isnan(covariance))


def test_ways_are_better_known_than_places_and_begin_anew_with_a_session() -> None:
    truth = CollectionTruth()
    for axis, value in (("A", 0.0), ("A", 20.0), ("A", -20.0), ("Z", 32.0)):
        turned = np.array([np.radians(1.1 * value) if axis == "A" else 0.0, 0.0, 0.0])
        place, covariance = truth(set_point_of(axis, value), LEVEL + turned)
    way, spread = truth.since_first()
    assert np.trace(spread) < np.trace(covariance)
    assert way[2] == pytest.approx(32.0, abs=6.0)
    drawn = stack_pose(np.tile(set_point_of("Z", 32.0), (4, 1)), FO_SHIP).position_mm
    assert np.linalg.norm(place - drawn) < 5.0 * np.sqrt(np.trace(covariance))
    truth.restart()
    assert np.isnan(truth.since_first()[0]).all()


def test_its_figures_are_those_of_the_thesiss_rig_and_of_printed_parts() -> None:
    spread = truth_spread()
    assert spread.stacking_mm > 0.0
    assert spread.axis_gain[3] == pytest.approx(0.12, abs=0.01)


def test_facing_servos_err_together_as_the_gauge_lets_them():
    covariance = servo_errors().covariance_rad2
    spread = truth_spread()
    assert spread.pair_correlation == pytest.approx(covariance[0, 1] / covariance[0, 0])
    assert 0.7 < spread.pair_correlation < 0.8
    assert spread.servo_rad == pytest.approx(np.sqrt(covariance[0, 0]))


@pytest.mark.parametrize("first", [0, 2, 4])
def test_the_pairs_of_the_correlation_are_those_that_the_gauge_lies_over(first):
    across = FO_SHIP_PLATFORM.base_joints_mm[first + 1] - FO_SHIP_PLATFORM.base_joints_mm[first]
    assert np.linalg.norm(across) == pytest.approx(58.0, abs=0.5)
    along = across / np.linalg.norm(across)
    bearing = FO_SHIP_PLATFORM.arm_bearings_rad[[first, first + 1]]
    arms = np.column_stack([np.cos(bearing), np.sin(bearing)])
    np.testing.assert_allclose(arms @ along[:2], [1.0, -1.0], atol=1e-6)


def test_the_attitude_that_was_commanded_leaves_the_drawn_place_but_for_whole_counts():
    set_point = np.array([1.0, 0.0, 2.0, 0.02, 0.0, 0.0])
    place, covariance = CollectionTruth()(set_point, np.array([0.08, 0.0, 0.0]))
    np.testing.assert_allclose(place, stack_pose(np.tile(set_point, (4, 1)), FO_SHIP).position_mm, atol=1.5)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
