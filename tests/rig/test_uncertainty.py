import numpy as np
import pytest

from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, ManufacturingSpread
from bluerov_slam.rig.platform import pose_jacobian
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.rig.uncertainty import pose_covariance, sample_poses, set_point_covariance
from rig.poses import stacks
from rig.test_stack import turn_between

ALONE = [
    ManufacturingSpread(servo_rad=0.004),
    ManufacturingSpread(servo_rad=0.004, pair_correlation=0.76),
    ManufacturingSpread(slop_rad=0.004),
    ManufacturingSpread(rod_mm=0.1),
    ManufacturingSpread(arm_mm=0.1),
    ManufacturingSpread(joint_mm=0.1),
    ManufacturingSpread(stacking_mm=0.1),
    ManufacturingSpread(0.003, 0.003, 0.1, 0.1, 0.05, 0.1, 0.5),
    ManufacturingSpread(gain=0.01),
    ManufacturingSpread(gain=0.01, gain_alike=0.01),
    ManufacturingSpread(rod_mm=0.1, arm_alike_mm=0.2, base_alike_mm=0.1),
    ManufacturingSpread(rod_mm=0.1, axis_gain=(0.05, 0.05, 0.02, 0.02, 0.03, 0.1)),
    ManufacturingSpread(rod_mm=0.1, axis_gain_apart=(0.05, 0.05, 0.02, 0.02, 0.03, 0.1)),
    ManufacturingSpread(rod_mm=0.1, lean_rad=0.001),
]
COUNT = 2000


@pytest.mark.parametrize("spread", ALONE)
def test_many_rigs_of_that_spread_scatter_as_the_derivatives_say(spread):
    """By the whitened scatter: its mean square is 1 in each of six directions, to the spread of COUNT draws.

    Of the platform offsets alone only the place scatters: three directions.
    """
    points = stacks(1, seed=4, share=0.6)[0]
    nominal = stack_pose(points, FO_SHIP)
    made = sample_poses(points, FO_SHIP, spread, COUNT, seed=7)
    errors = np.concatenate(
        [made.position_mm - nominal.position_mm, turn_between(nominal.rotation, made.rotation)], axis=1
    )
    covariance = pose_covariance(points, FO_SHIP, spread)
    used = slice(0, 3) if spread == ManufacturingSpread(stacking_mm=0.1) else slice(0, 6)
    white = np.linalg.solve(np.linalg.cholesky(covariance[used, used]), errors[:, used].T)
    scatter = white @ white.T / COUNT
    np.testing.assert_allclose(scatter, np.eye(len(white)), atol=5.0 * np.sqrt(2.0 / COUNT))
    assert np.all(errors[:, 3:] == 0.0) == (used == slice(0, 3))


def test_facing_servos_that_err_alike_are_not_two_independent_servos():
    one = set_point_covariance(np.zeros(6), FO_SHIP_PLATFORM, ManufacturingSpread(servo_rad=0.01))
    alike = set_point_covariance(
        np.zeros(6), FO_SHIP_PLATFORM, ManufacturingSpread(servo_rad=0.01, pair_correlation=0.76)
    )
    assert alike[2, 2] / one[2, 2] == pytest.approx(1.76)  # at home all six lift the plate alike
    assert alike[5, 5] / one[5, 5] == pytest.approx(0.24)  # and facing ones turn it against each other


def test_play_goes_through_the_pose_jacobian():
    point = stacks(1)[0, 0]
    back = pose_jacobian(point, FO_SHIP_PLATFORM)
    found = set_point_covariance(point, FO_SHIP_PLATFORM, ManufacturingSpread(slop_rad=0.01))
    np.testing.assert_allclose(found, 1e-4 * back @ back.T, rtol=1e-9)


def test_exact_parts_leave_nothing_and_spreads_add_up():
    points = stacks(3)
    assert not np.any(pose_covariance(points, FO_SHIP, ManufacturingSpread()))
    servo, rod = ManufacturingSpread(servo_rad=0.01), ManufacturingSpread(rod_mm=0.2)
    both = pose_covariance(points, FO_SHIP, ManufacturingSpread(servo_rad=0.01, rod_mm=0.2))
    np.testing.assert_allclose(both, pose_covariance(points, FO_SHIP, servo) + pose_covariance(points, FO_SHIP, rod))


def test_the_lowest_platform_moves_the_tool_most():
    """The tilt of a plate moves the tool by its height over the plate: 134 mm less with each."""
    play = ManufacturingSpread(slop_rad=0.01)
    platform = set_point_covariance(np.zeros(6), FO_SHIP_PLATFORM, play)
    levers = 648.38 - 164.0 - 134.0 * np.arange(4)
    forward = platform[0, 0] - 2.0 * levers * platform[0, 4] + levers**2 * platform[4, 4]
    assert forward[0] > 3.0 * forward[3]
    total = pose_covariance(np.zeros((4, 6)), FO_SHIP, play)
    assert total[0, 0] == pytest.approx(np.sum(forward))


def test_out_of_reach_has_no_covariance():
    points = np.zeros((2, 4, 6))
    points[1, 1, 2] = -60.0
    found = pose_covariance(points, FO_SHIP, ManufacturingSpread(rod_mm=0.1))
    assert np.all(np.isfinite(found[0]))
    assert np.all(np.isnan(found[1]))
