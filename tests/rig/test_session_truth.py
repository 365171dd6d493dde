"""The truth over a session: what it learns of a rig's build, the way from the first pose, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.collection import set_point_of
from bluerov_slam.rig.dimensions import FO_SHIP, LEGS, ManufacturingSpread
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.session_truth import AttitudeErrors, SessionTruth
from bluerov_slam.rig.stack import StackPose, stack_pose
from bluerov_slam.rig.tool_truth import tool_truth
from bluerov_slam.rig.uncertainty import pose_covariance

SPREAD = ManufacturingSpread(
    servo_rad=0.01, slop_rad=0.003, rod_mm=0.1, stacking_mm=0.2, gain=0.01, gain_alike=0.05, base_alike_mm=0.2
)
NOISE = np.radians([0.1, 0.1, 0.2])
EXACT = AttitudeErrors(tuple(NOISE.tolist()), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
HOME = np.zeros((4, 6))


def alike(axis: str, value: float) -> np.ndarray:
    return np.tile(set_point_of(axis, value), (4, 1))


MOTION = [HOME, *(alike(axis, value) for axis, value in (("A", 20.0), ("A", -20.0), ("B", 12.0), ("Z", 40.0)))]


class Rig:
    """Drawn from SPREAD, but for its dimensions: gains, zeros, play, and the offsets between its parts."""

    def __init__(self, seed: int) -> None:
        self.random = random = np.random.default_rng(seed)
        self.gain = 1.0 + SPREAD.gain_alike * random.standard_normal() + SPREAD.gain * random.standard_normal((4, LEGS))
        self.zero = SPREAD.servo_rad * random.standard_normal((4, LEGS))
        self.bases = SPREAD.base_alike_mm * random.standard_normal(3)
        self.bases = self.bases + SPREAD.stacking_mm * random.standard_normal((4, 3))
        foot, tool = SPREAD.stacking_mm * random.standard_normal((2, 3))
        self.stack = replace(FO_SHIP, foot_mm=FO_SHIP.foot_mm + foot, tool_mm=FO_SHIP.tool_mm + tool)
        self.rod = SPREAD.rod_mm * random.standard_normal((4, LEGS))

    def pose(self, told: np.ndarray) -> StackPose:
        made = []
        for i, platform in enumerate(FO_SHIP.platforms):
            play = SPREAD.slop_rad * self.random.standard_normal(LEGS)
            real = replace(platform, rod_mm=platform.rod_mm + self.rod[i])
            angles = self.gain[i] * servo_angles_rad(told[i], platform) + self.zero[i] + play
            made.append(plate_pose(angles, real, told[i]).set_point)
        points = np.array(made)
        points[:, :3] += self.bases
        return stack_pose(points, self.stack)

    def seen(self, pose: StackPose) -> np.ndarray:
        return exp_so3(NOISE * self.random.standard_normal(3)) @ pose.rotation


def session(seed: int):
    """Errors and covariances of place and of the way from home at the last pose of the motion."""
    rig, truth = Rig(seed), SessionTruth(FO_SHIP, SPREAD, EXACT)
    home = None
    for told in MOTION:
        pose = rig.pose(told)
        found = truth.take(told, rig.seen(pose))
        home = pose.position_mm if home is None else home
    way, covariance = truth.since_first()
    return found.position_mm - pose.position_mm, found.covariance[:3, :3], way - (pose.position_mm - home), covariance


def test_place_and_way_are_as_certain_as_they_say() -> None:
    found = [session(seed) for seed in range(60)]
    places = [error @ np.linalg.solve(covariance, error) for error, covariance, _, _ in found]
    ways = [error @ np.linalg.solve(covariance, error) for _, _, error, covariance in found]
    # The mean of 60 chi-squares of three has a standard deviation of 0.32.
    assert 3.0 - 0.96 < np.mean(places) < 3.0 + 0.96
    assert 3.0 - 0.96 < np.mean(ways) < 3.0 + 0.96
    # The way leaves out what both ends have alike.
    assert np.mean([np.trace(each[3]) for each in found]) < 0.5 * np.mean([np.trace(each[1]) for each in found])


def test_the_first_pose_is_that_of_one_pose_by_itself() -> None:
    rig = Rig(3)
    seen = rig.seen(rig.pose(MOTION[1]))
    alone = tool_truth(MOTION[1], seen, NOISE, FO_SHIP, SPREAD)
    found = SessionTruth(FO_SHIP, SPREAD, EXACT).take(MOTION[1], seen)
    # One goes on by derivatives about the set point that was told, the other about what it makes of it.
    assert found.position_mm == pytest.approx(alone.position_mm, abs=0.3)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(np.sqrt(np.diag(alone.covariance)), rel=0.03)
    assert found.surprise == pytest.approx(alone.surprise, rel=0.1)


def test_without_attitudes_it_says_what_the_derivatives_say_and_learns_nothing() -> None:
    truth = SessionTruth(FO_SHIP, SPREAD, EXACT)
    for told in MOTION:
        found = truth.take(told)
        assert found.position_mm == pytest.approx(stack_pose(told, FO_SHIP).position_mm, abs=1e-6)
        np.testing.assert_allclose(found.covariance, pose_covariance(told, FO_SHIP, SPREAD), rtol=1e-6, atol=1e-9)


def test_a_gain_of_all_servos_is_learnt_from_the_attitudes_of_a_motion() -> None:
    rig = Rig(5)
    rig.gain, rig.zero = np.full((4, LEGS), 1.08), np.zeros((4, LEGS))
    truth = SessionTruth(FO_SHIP, SPREAD, EXACT)
    for told in MOTION[:3]:
        truth.take(told, rig.seen(rig.pose(told)))
    # A place where no attitude was measured is told by what was learnt: the height follows the gain.
    told = alike("Z", -40.0)
    real = rig.pose(told).position_mm[2]
    drawn = stack_pose(told, FO_SHIP).position_mm[2]
    found = truth.take(told)
    assert abs(found.position_mm[2] - real) < 0.4 * abs(drawn - real)
    assert found.covariance[2, 2] < 0.3 * pose_covariance(told, FO_SHIP, SPREAD)[2, 2]


def test_servos_that_do_not_move_keep_their_play() -> None:
    only_play = ManufacturingSpread(slop_rad=0.01)
    truth = SessionTruth(FO_SHIP, only_play, EXACT)
    truth.take(HOME)
    truth.take(HOME)
    _, still = truth.since_first()
    assert np.max(np.abs(still)) < 1e-9
    truth.take(MOTION[1])
    _, moved = truth.since_first()
    one, other = (pose_covariance(told, FO_SHIP, only_play)[:3, :3] for told in (HOME, MOTION[1]))
    np.testing.assert_allclose(moved, one + other, rtol=1e-6, atol=1e-9)


def test_a_seat_that_is_not_known_hides_the_turn_but_not_its_changes() -> None:
    loose = replace(EXACT, seat_rad=(0.0, 0.0, 3.0))
    rig, truth = Rig(8), SessionTruth(FO_SHIP, SPREAD, loose)
    turned = exp_so3(np.array([0.0, 0.0, 0.7]))
    first = truth.take(HOME, turned @ rig.seen(rig.pose(HOME)))
    assert first.covariance[5, 5] == pytest.approx(pose_covariance(HOME, FO_SHIP, SPREAD)[5, 5], rel=0.05)
    pose = rig.pose(alike("C", 16.0))
    then = truth.take(alike("C", 16.0), turned @ rig.seen(pose))
    assert then.surprise < 16.3


def test_a_new_session_keeps_what_was_learnt_of_the_rig_and_begins_its_way_anew() -> None:
    rig = Rig(9)
    truth = SessionTruth(FO_SHIP, SPREAD, EXACT)
    for told in MOTION:
        truth.take(told, rig.seen(rig.pose(told)))
    truth.restart()
    assert np.isnan(truth.since_first()[0]).all()
    found = truth.take(MOTION[2])
    assert truth.since_first()[0] == pytest.approx(np.zeros(3), abs=1e-9)
    assert found.covariance[2, 2] < 0.5 * pose_covariance(MOTION[2], FO_SHIP, SPREAD)[2, 2]


def test_a_pose_out_of_reach_has_no_truth_and_spoils_nothing() -> None:
    rig, truth = Rig(10), SessionTruth(FO_SHIP, SPREAD, EXACT)
    truth.take(HOME, rig.seen(rig.pose(HOME)))
    far = HOME.copy()
    far[2, 2] = 400.0
    for bad in (far, np.full((4, 6), np.nan)):
        found = truth.take(bad, np.eye(3))
        assert np.all(np.isnan(found.position_mm))
        assert np.all(np.isnan(found.covariance))
        assert np.all(np.isnan(truth.since_first()[0]))
    unmeasured = truth.take(MOTION[1], np.full((3, 3), np.nan))
    assert np.all(np.isfinite(unmeasured.covariance))
    assert np.isnan(unmeasured.surprise)
