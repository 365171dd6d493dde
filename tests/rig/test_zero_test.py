"""Wrong zeros found by attitudes at many stances, in rigs whose errors are not those that the test supposes."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, LEGS
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.workspace import PlatformWorkspace
from bluerov_slam.rig.zero_test import STANCES, ZeroTest

TEST = ZeroTest()
TOLD = np.stack([servo_angles_rad(TEST.stances[:, i], FO_SHIP_PLATFORM) for i in range(4)], axis=1)


def build(random: np.random.Generator):
    """Gains and zeros of a good rig, evenly spread, and the seat of its IMU."""
    gain = 1.0 + random.uniform(-0.06, 0.06) + random.uniform(-0.03, 0.03, (4, LEGS))
    return gain, np.radians(random.uniform(-1.0, 1.0, (4, LEGS))), np.radians(random.uniform(-0.7, 0.7, 3))


def seen(rig, random: np.random.Generator, servo=(0, 0), degrees: float = 0.0) -> np.ndarray:
    gain, zero, seat = rig
    told = TOLD.copy()
    told[:, *servo] += np.radians(degrees)
    real = gain * told + zero + np.radians(random.uniform(-0.4, 0.4, told.shape))
    reached = np.eye(3)
    for i in range(4):
        reached = reached @ rotations(plate_pose(real[:, i], FO_SHIP_PLATFORM, TEST.stances[:, i]).set_point[:, 3:])
    noise = np.radians([0.1, 0.1, 0.3])
    return np.array([exp_so3(noise * random.standard_normal(3)) @ exp_so3(seat) @ each for each in reached])


def test_stances_are_within_reach_and_stay_the_same() -> None:
    space = PlatformWorkspace()
    assert TEST.stances.shape == (STANCES, 4, 6)
    assert all(space.broken(point) is None for point in TEST.stances.reshape(-1, 6))
    np.testing.assert_array_equal(TEST.stances, ZeroTest().stances)


def test_a_good_rig_is_not_accused_at_first_nor_later() -> None:
    for seed in range(6):
        random = np.random.default_rng(seed)
        rig = build(random)
        before, now = seen(rig, random), seen(rig, random)
        for test in (TEST, TEST.against(before)):
            verdict = test.judge(now)
            assert verdict.finding is None
            assert "no servo stands off its zero" in str(verdict)


@pytest.mark.parametrize("servo", [(0, 0), (1, 3), (3, 5)])
@pytest.mark.parametrize("degrees", [-15.0, 15.0])
def test_a_servo_far_off_is_named_at_the_first_run(servo, degrees) -> None:
    random = np.random.default_rng(20)
    verdict = TEST.judge(seen(build(random), random, servo, degrees))
    assert verdict.finding is not None
    assert verdict.finding.servo == servo
    assert verdict.finding.fault == "offset"
    assert np.degrees(verdict.finding.size) == pytest.approx(degrees, abs=6.0)
    assert f"servo {servo[1] + 1} of platform {servo[0] + 1} stands" in str(verdict)


@pytest.mark.parametrize("servo", [(0, 2), (2, 4)])
def test_a_servo_some_degrees_off_is_named_against_an_earlier_run(servo) -> None:
    random = np.random.default_rng(21)
    rig = build(random)
    verdict = TEST.against(seen(rig, random)).judge(seen(rig, random, servo, 7.0))
    assert verdict.finding is not None
    assert verdict.finding.servo == servo
    assert np.degrees(verdict.sizes_rad[servo]) == pytest.approx(7.0, abs=2.0)


def test_readings_that_are_missing_are_told_and_the_rest_is_used() -> None:
    random = np.random.default_rng(22)
    readings = seen(build(random), random, (1, 1), 20.0)
    readings[::4] = np.nan
    verdict = TEST.judge(readings)
    assert verdict.untested == STANCES // 4
    assert verdict.finding is not None
    assert verdict.finding.servo == (1, 1)
    assert "stances were not measured" in str(verdict)
    nothing = TEST.judge(np.full((STANCES, 3, 3), np.nan))
    assert nothing.finding is None
    assert nothing.untested == STANCES
    assert np.isnan(nothing.sizes_rad).all()


def test_what_a_run_would_have_named_is_stated_and_grows_with_what_is_missing():
    random = np.random.default_rng(23)
    rig = build(random)
    before, now = seen(rig, random), seen(rig, random)
    whole, again = TEST.judge(now), TEST.against(before).judge(now)
    now[::2] = np.nan
    half = TEST.judge(now)
    assert np.radians(7.0) < whole.named_from_rad < np.radians(12.0)  # R13 misses 39 % at 7 degrees, 3 % at 10
    assert np.radians(4.0) < again.named_from_rad < np.radians(7.0)
    assert half.named_from_rad > whole.named_from_rad
    assert np.isnan(whole.size_std_rad)


def test_the_size_of_a_wrong_zero_is_as_uncertain_as_stated():
    off = []
    for seed in range(24, 40):
        random = np.random.default_rng(seed)
        servo = (seed % 4, seed % LEGS)
        verdict = TEST.judge(seen(build(random), random, servo, 14.0))
        assert verdict.finding is not None
        off.append((verdict.finding.size - np.radians(14.0)) / verdict.size_std_rad)
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.4
