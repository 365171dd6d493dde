import numpy as np
import pytest

from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, PlatformDimensions
from rig.poses import unequal


def test_joints_lie_on_their_circles_where_the_parts_are_drawn():
    """Bearings measured in the drawing's frame: pairs about 30, -90 and 150 degrees, theta_B 20.53, theta_P 50.02."""
    for joints, radius, angle in (
        (FO_SHIP_PLATFORM.base_joints_mm, 82.7, 20.53),
        (FO_SHIP_PLATFORM.plate_joints_mm, 57.725, 50.02),
    ):
        np.testing.assert_allclose(np.linalg.norm(joints, axis=-1), radius)
        drawn = np.degrees(np.arctan2(-joints[:, 0], -joints[:, 1]))
        wanted = [30 + angle, 30 - angle, -90 + angle, -90 - angle, 150 + angle, 150 - angle]
        np.testing.assert_allclose(np.remainder(drawn - wanted + 180.0, 360.0), 180.0)


def test_horns_of_a_pair_point_at_each_other_and_their_servos_are_as_far_apart_as_measured():
    base, bearings = FO_SHIP_PLATFORM.base_joints_mm, FO_SHIP_PLATFORM.arm_bearings_rad
    for first, second in ((0, 1), (2, 3), (4, 5)):
        between = base[second] - base[first]
        assert 57.0 < np.linalg.norm(between) < 59.0
        forward = [np.cos(bearings[first]), np.sin(bearings[first]), 0.0]
        assert np.dot(forward, between) / np.linalg.norm(between) == pytest.approx(1.0)
        assert np.cos(bearings[first] - bearings[second]) == pytest.approx(-1.0)


def test_plain_legs_are_the_arrays_and_a_batch_has_none():
    made = unequal()
    for i, leg in enumerate(made.legs):
        assert (leg.base_x, leg.base_y, leg.base_z) == tuple(made.base_joints_mm[i])
        assert (leg.plate_x, leg.plate_y, leg.plate_z) == tuple(made.plate_joints_mm[i])
        assert (leg.arm_mm, leg.rod_mm) == (made.arm_mm[i], made.rod_mm[i])
        assert np.arctan2(leg.forward_y, leg.forward_x) == pytest.approx(
            np.angle(np.exp(1j * made.arm_bearings_rad[i]))
        )
    rods = made.rod_mm + np.zeros((3, 1))
    batch = PlatformDimensions(made.base_joints_mm, made.plate_joints_mm, made.arm_bearings_rad, made.arm_mm, rods)
    assert batch.batched
    assert batch.legs == ()
    assert not made.batched
    assert len(made.legs) == 6


def test_arrays_of_the_wrong_shape_are_refused_and_right_ones_are_frozen():
    made = unequal()
    with pytest.raises(ValueError, match=r"rod_mm has shape \(5,\)"):
        PlatformDimensions(
            made.base_joints_mm, made.plate_joints_mm, made.arm_bearings_rad, made.arm_mm, made.rod_mm[:5]
        )
    with pytest.raises(ValueError, match="read-only"):
        made.rod_mm[0] = 1.0


def test_a_radian_is_worth_the_plate_s_radius():
    assert float(FO_SHIP_PLATFORM.plate_radius_mm) == pytest.approx(57.725)


def test_the_rig_has_four_platforms():
    assert len(FO_SHIP.platforms) == 4
