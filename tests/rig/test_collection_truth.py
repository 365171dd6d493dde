"""The truth that a collection writes down: what its stated deviation is made of, and what an attitude does to it."""

import numpy as np
import pytest

from bluerov_slam.rig.collection_truth import truth_of, truth_spread
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM
from bluerov_slam.rig.gauge import servo_errors
from bluerov_slam.rig.stack import stack_pose


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


def test_the_attitude_that_was_commanded_leaves_the_drawn_place():
    set_point = np.array([1.0, 0.0, 2.0, 0.02, 0.0, 0.0])
    place, covariance = truth_of(set_point, np.array([0.08, 0.0, 0.0]))
    np.testing.assert_allclose(place, stack_pose(np.tile(set_point, (4, 1)), FO_SHIP).position_mm, atol=0.2)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
