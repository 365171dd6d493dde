"""Limits of a platform: each is met exactly where its margin says, and bad input names its cure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, FO_SHIP_SERVOS
from bluerov_slam.rig.limits import (
    FO_SHIP_LIMITS,
    Limit,
    PlatformLimits,
    checked_pose,
    checked_set_points,
    platform_margins,
    segment_distance_mm,
)


def test_home_keeps_every_limit() -> None:
    margins = platform_margins(np.zeros(6), FO_SHIP_PLATFORM)
    assert margins.allowed
    assert margins.broken() is None
    assert float(margins.axis) == 1.0


@pytest.mark.parametrize(
    ("set_point", "limit"),
    [
        ([5.1, 0.0, 0.0, 0.0, 0.0, 0.0], Limit.AXIS),
        ([0.0, 0.0, -40.0, 0.0, 0.0, 0.0], Limit.REACH),
        ([0.0, 0.0, -16.0, 0.26, 0.0, 0.0], Limit.REACH),
    ],
)
def test_the_broken_limit_is_named(set_point: list[float], limit: Limit) -> None:
    broken = platform_margins(np.array(set_point), FO_SHIP_PLATFORM).broken()
    assert broken is limit
    assert broken.words


def test_servo_and_joint_limits_are_named_when_they_are_what_is_narrow() -> None:
    point = np.array([0.0, 0.0, -8.0, 0.0, 0.0, 0.0])
    narrow = dataclasses.replace(FO_SHIP_LIMITS, highest_servo_rad=np.full(6, 0.5))
    assert platform_margins(point, FO_SHIP_PLATFORM, narrow).broken() is Limit.SERVO
    stiff = dataclasses.replace(FO_SHIP_LIMITS, joint_tilt_rad=0.3)
    assert platform_margins(point, FO_SHIP_PLATFORM, stiff).broken() is Limit.JOINT
    thick = dataclasses.replace(FO_SHIP_LIMITS, rod_thickness_mm=21.0)
    assert platform_margins(point, FO_SHIP_PLATFORM, thick).broken() in {Limit.LEGS, Limit.ARMS}


def test_offsets_of_servos_shift_their_ranges() -> None:
    each = PlatformLimits.of_servos(FO_SHIP_SERVOS)
    assert len(each) == 4
    shift = each[0].highest_servo_rad - np.pi / 2.0
    assert np.allclose(np.abs(shift), np.abs([2, -1, 0, -19, -4, 1]) * np.pi / 400.0)


def test_distance_of_segments_is_the_least_of_many_points() -> None:
    random = np.random.default_rng(3)
    ends = random.normal(size=(4, 200, 3))
    share = np.linspace(0.0, 1.0, 101)[:, None, None]
    first, second = ends[0] + share * (ends[1] - ends[0]), ends[2] + share * (ends[3] - ends[2])
    many = np.linalg.norm(first[:, None] - second[None], axis=-1).min(axis=(0, 1))
    exact = segment_distance_mm(*ends)
    assert (exact <= many + 1e-12).all()
    assert np.abs(exact - many).max() < 0.05


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.array([0.0, 0.0, 0.0, 15.0, 0.0, 0.0]), "degrees"),
        (np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0]), "not a number"),
        (np.array([2e4, 0.0, 0.0, 0.0, 0.0, 0.0]), "millimetres"),
        (np.zeros(5), "shape"),
    ],
)
def test_bad_set_points_name_the_cure(points: np.ndarray, words: str) -> None:
    with pytest.raises(OutOfValidityError, match=words):
        checked_set_points(points)


def test_bad_poses_name_the_cure() -> None:
    with pytest.raises(OutOfValidityError, match="degrees"):
        checked_pose(np.zeros(3), np.array([0.0, 30.0, 0.0]))
    with pytest.raises(OutOfValidityError, match="not a number"):
        checked_pose(np.array([0.0, np.nan, 0.0]), np.eye(3))
    with pytest.raises(OutOfValidityError, match="no rotation"):
        checked_pose(np.zeros(3), 2.0 * np.eye(3))
    with pytest.raises(OutOfValidityError, match="no rotation"):
        checked_pose(np.zeros(3), np.diag([1.0, 1.0, -1.0]))
