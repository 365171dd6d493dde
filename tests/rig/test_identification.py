"""Rigs with other dimensions and servos than stated are found, as well as it says, and what cannot be is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, AxisLimits, StackDimensions
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.identification import (
    PRIOR_STD,
    SERVO_KINDS,
    SIZE_KINDS,
    TOOL_KINDS,
    MeasuredPoses,
    Parameter,
    identify,
    parameters_of,
    single_platform,
)
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.stack import stack_pose

ONE = single_platform(FO_SHIP_PLATFORM)
PLACE_STD_MM, TURN_STD_RAD = np.full(3, 0.3), np.full(3, np.radians(0.2))


def told_angles(stack: StackDimensions, count: int, random: np.random.Generator) -> np.ndarray:
    limits = 0.5 * AxisLimits().array()
    points = random.uniform(-limits, limits, (count, len(stack.platforms), 6))
    return np.stack([servo_angles_rad(points[:, i], each) for i, each in enumerate(stack.platforms)], axis=1)


def real_rig(random: np.random.Generator) -> tuple[StackDimensions, np.ndarray, np.ndarray]:
    """One whose arms, rods and servos are not as stated, built without the code under test."""
    platforms, count = [], len(FO_SHIP.platforms)
    for each in FO_SHIP.platforms:
        arm, rod = random.normal(0.0, 0.7, 2)
        platforms.append(replace(each, arm_mm=each.arm_mm + arm, rod_mm=each.rod_mm + rod))
    tool = FO_SHIP.tool_mm + random.normal(0.0, 3.0, 3)
    gain = 1.0 + random.normal(0.0, 0.04, (count, 6))
    return (
        replace(FO_SHIP, platforms=tuple(platforms), tool_mm=tool),
        gain,
        np.radians(random.normal(0.0, 1.5, (count, 6))),
    )


def measure(rig, told, random: np.random.Generator | None) -> MeasuredPoses:
    """By a spread of its own: none of it is the identification's."""
    stack, gain, offset = rig
    angles = gain * told + offset
    points = np.stack([plate_pose(angles[:, i], each).set_point for i, each in enumerate(stack.platforms)], axis=1)
    pose = stack_pose(points, stack)
    place, turn = pose.position_mm.copy(), pose.rotation.copy()
    if random is not None:
        place += PLACE_STD_MM * random.standard_normal(place.shape)
        turn = np.array([exp_so3(TURN_STD_RAD * random.standard_normal(3)) @ each for each in turn])
    return MeasuredPoses(told, place, turn, PLACE_STD_MM, TURN_STD_RAD)


def test_one_platform_is_found_exactly_without_noise_where_all_is_seen() -> None:
    random = np.random.default_rng(1)
    gain, offset = 1.0 + random.normal(0.0, 0.05, (1, 6)), random.normal(0.0, 0.03, (1, 6))
    fine = replace(measure((ONE, gain, offset), told_angles(ONE, 30, random), None), position_std_mm=np.full(3, 1e-5),
                   attitude_std_rad=np.full(3, 1e-7))  # fmt: skip
    found = identify(fine, ONE, parameters_of(1, SERVO_KINDS))
    assert found.converged
    assert found.gain == pytest.approx(gain, abs=1e-6)
    assert found.offset_rad == pytest.approx(offset, abs=1e-6)
    assert found.untold == ()


def test_the_stack_is_found_as_well_as_it_says() -> None:
    kinds = ("offset", "gain", "arm", "rod", *TOOL_KINDS)
    squares = []
    for seed in range(4):
        random = np.random.default_rng(100 + seed)
        rig = real_rig(random)
        found = identify(measure(rig, told_angles(FO_SHIP, 40, random), random), FO_SHIP, parameters_of(4, kinds))
        truth = []
        for each in found.parameters:
            if each.platform is None:
                truth.append((rig[0].tool_mm - FO_SHIP.tool_mm)["xyz".index(each.kind[-1])])
            elif each.servo is not None:
                truth.append((rig[2] if each.kind == "offset" else rig[1] - 1.0)[each.platform, each.servo])
            else:
                real, stated = rig[0].platforms[each.platform], FO_SHIP.platforms[each.platform]
                truth.append((real.arm_mm - stated.arm_mm if each.kind == "arm" else real.rod_mm - stated.rod_mm)[0])
        error = found.values - np.array(truth)
        squares.append(error @ np.linalg.solve(found.covariance, error) / len(error))
        assert found.converged
        assert 0.7 < found.misfit < 1.3
    # The real rigs are drawn a little narrower than the prior spreads.
    assert 0.5 < np.mean(squares) < 1.2


@pytest.mark.parametrize("kind", list(PRIOR_STD))
def test_derivatives_are_those_of_the_model(kind: str) -> None:
    """One parameter off by a little, no noise: the first step must land on it."""
    random = np.random.default_rng(4)
    stack = StackDimensions((FO_SHIP_PLATFORM, FO_SHIP_PLATFORM), FO_SHIP.foot_mm, FO_SHIP.base_mm, FO_SHIP.tool_mm)
    each = next(each for each in parameters_of(2, (kind,)) if each.platform in (None, 1) and each.servo in (None, 4))
    told = told_angles(stack, 25, random)
    blank = MeasuredPoses(told, np.zeros((25, 3)), np.tile(np.eye(3), (25, 1, 1)), PLACE_STD_MM, TURN_STD_RAD)
    from bluerov_slam.rig.identification import _Rig

    step = 1e-4
    poses = []
    for way in (1.0, -1.0):
        rig = _Rig(stack, (each,), np.array([way * step * PRIOR_STD[kind]]), blank)
        pose = stack_pose(rig.set_points(None), rig.stack)
        poses.append((pose.position_mm, pose.rotation @ exp_so3(rig.mount)))
    (ahead, turned), (behind, turned_back) = poses
    rig = _Rig(stack, (each,), np.zeros(1), blank)
    slope = rig.residuals(rig.set_points(None), np.array([PRIOR_STD[kind]]))[1]
    by_place = slope[:75, 0].reshape(25, 3) * PLACE_STD_MM
    by_turn = slope[75:, 0].reshape(25, 3) * TURN_STD_RAD
    assert by_place == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-5)
    skew = (turned @ turned_back.transpose(0, 2, 1) - turned_back @ turned.transpose(0, 2, 1)) / (4.0 * step)
    assert by_turn == pytest.approx(np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1), abs=1e-6)


def test_attitudes_alone_do_not_tell_the_size_and_it_says_so() -> None:
    random = np.random.default_rng(7)
    measured = measure((ONE, np.ones((1, 6)), np.zeros((1, 6))), told_angles(ONE, 40, random), random)
    blind = replace(measured, position_mm=np.full((40, 3), np.nan))
    found = identify(blind, ONE, parameters_of(1, SERVO_KINDS + SIZE_KINDS))
    assert found.untold[0].startswith("not told apart")
    assert all(f"more platform 1 {name}" in found.untold[0] for name in ("rod", "base radius", "plate radius"))
    seeing = identify(measured, ONE, parameters_of(1, SERVO_KINDS + SIZE_KINDS))
    assert len(seeing.untold) < len(found.untold)


def test_places_alone_do_not_tell_how_the_instrument_sits() -> None:
    random = np.random.default_rng(8)
    measured = measure((ONE, np.ones((1, 6)), np.zeros((1, 6))), told_angles(ONE, 20, random), random)
    blind = replace(measured, rotation=np.full((20, 3, 3), np.nan))
    found = identify(blind, ONE, (Parameter("mount roll"), *parameters_of(1, ("offset",))))
    assert "mount roll: not seen in these measurements" in found.untold
    assert found.share_untold[0] == pytest.approx(1.0)
    assert np.max(found.share_untold[1:]) < 0.8


def test_a_height_and_the_tools_height_are_not_told_apart_while_all_stands_level() -> None:
    told = servo_angles_rad(
        np.array([[[0.0, 0.0, z, 0.0, 0.0, 0.0]] for z in (-8.0, -4.0, 0.0, 4.0)]), FO_SHIP_PLATFORM
    )
    measured = measure((ONE, np.ones((1, 6)), np.zeros((1, 6))), told, None)
    found = identify(measured, ONE, (Parameter("base height", 0), Parameter("tool z")))
    assert len(found.untold) == 1
    assert "base height" in found.untold[0]
    assert "tool z" in found.untold[0]


def test_a_pose_out_of_reach_is_named() -> None:
    told = told_angles(ONE, 3, np.random.default_rng(9))
    told[1] = servo_angles_rad(np.array([0.0, 0.0, 60.0, 0.0, 0.0, 0.0]), FO_SHIP_PLATFORM)
    poses = MeasuredPoses(told, np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)), PLACE_STD_MM, TURN_STD_RAD)
    with pytest.raises(ValueError, match="pose 1: platform 1 cannot take these angles"):
        identify(poses, ONE, parameters_of(1, ("offset",)))


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(ValueError, match="'rods' is none of"):
        parameters_of(1, ("rods",))
