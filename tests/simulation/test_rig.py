"""The simulated rig: near what was drawn, other than drawn, and as its faults make it."""

import numpy as np
import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.rig.collection import set_point_of
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.simulation.rig import RigFigures, ServoFault, SimulatedRig
from bluerov_slam.simulation.rig_receiver import euler_rad

PERFECT = RigFigures(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
HOME = np.zeros((4, 6))


def all_at(axis, value):
    return np.tile(set_point_of(axis, value), (4, 1))


@pytest.mark.parametrize(("axis", "value"), [("A", 24.0), ("B", -8.0), ("C", 16.0), ("X", 20.0), ("Z", -64.0)])
def test_a_rig_as_drawn_goes_where_it_is_set(axis, value):
    rig = SimulatedRig(1, PERFECT)
    target = all_at(axis, value)
    track = rig.move(HOME, target, 20, 0.05)
    expected = stack_pose(target, FO_SHIP)
    # A count is 7.9 mrad: what is left is the servos' resolution.
    np.testing.assert_allclose(rig.pose.position_mm, expected.position_mm, atol=4.0)
    np.testing.assert_allclose(track.places_mm[-1], rig.pose.position_mm)
    assert np.all(np.diff(track.times_s) > 0.0)


def test_rigs_differ_by_their_seed_and_not_otherwise():
    places = [SimulatedRig(seed).pose.position_mm for seed in (1, 1, 2)]
    np.testing.assert_array_equal(places[0], places[1])
    assert 0.1 < np.linalg.norm(places[0] - places[2]) < 30.0


def test_what_no_servo_can_do_is_refused_and_nothing_moves():
    rig = SimulatedRig(1)
    before = rig.pose.position_mm
    assert rig.move(HOME, all_at("X", 400.0), 6, 0.05) is None
    np.testing.assert_array_equal(rig.pose.position_mm, before)


def test_a_stuck_servo_tilts_the_tool_once_the_rig_moves():
    rig = SimulatedRig(1, PERFECT, [ServoFault.parse("stuck 1 2")])
    free = SimulatedRig(1, PERFECT)
    np.testing.assert_allclose(rig.pose.position_mm, free.pose.position_mm)
    for each in (rig, free):
        each.move(HOME, all_at("Z", 40.0), 20, 0.05)
    tilt = np.degrees(np.abs(euler_rad(rig.pose.rotation)[:2] - euler_rad(free.pose.rotation)[:2]).max())
    assert tilt > 2.0


def test_an_offset_servo_tilts_the_tool_at_home():
    rig = SimulatedRig(1, PERFECT, [ServoFault.parse("offset 0 3 14.4")])
    assert np.degrees(np.abs(euler_rad(rig.pose.rotation)[:2]).max()) > 1.0


@pytest.mark.parametrize(
    "text", ["", "stuck", "stuck 1", "stuck 4 0", "stuck 0 6", "offset 0 1", "broken 0 1", "stuck a b"]
)
def test_a_fault_that_is_none_is_named(text):
    with pytest.raises(ConfigError, match="no fault of a servo"):
        ServoFault.parse(text)
