"""Faults built into rigs that share nothing with the test but their drawing: named, or all that they may be are."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.servo_test import ServoTest, stance

NOISE_RAD, LEVEL_RAD, PLAY = np.radians(0.1), np.radians(0.3), 0.03
TEST = ServoTest(level_std_rad=float(np.radians(0.4)), play=0.05)
"""Of rigs as drawn: their build leans no stance."""


def run(fault: dict, random: np.random.Generator):
    """What an IMU with errors of its own sees of a rig with faults: servo -> (kind, number or other servo)."""
    here = TEST.stance_angles_rad
    mount = exp_so3(LEVEL_RAD * random.standard_normal(3))

    def seen(told):
        real = here + (told - here) * (1.0 + PLAY * random.standard_normal(told.shape))
        faulty = real.copy()
        for servo, (kind, what) in fault.items():
            if kind == "stuck":
                faulty[servo] = here[servo] + what
            elif kind == "reversed":
                faulty[servo] = -real[servo]
            elif kind == "exchanged":
                faulty[servo], faulty[what] = real[what], real[servo]
            elif kind == "offset":
                faulty[servo] += what
            elif kind == "weak":
                faulty[servo] = here[servo] + what * (real[servo] - here[servo])
        reached = np.eye(3)
        for i, platform in enumerate(FO_SHIP.platforms):
            reached = reached @ rotations(plate_pose(faulty[i], platform, stance(4)[i]).set_point[3:])
        return exp_so3(NOISE_RAD * random.standard_normal(3)) @ mount @ reached

    return np.array([seen(angles) for _, angles in TEST.moves()]), seen(here)


def test_a_good_rig_is_never_accused() -> None:
    for seed in range(8):
        verdict = TEST.judge(*run({}, np.random.default_rng(seed)))
        assert verdict.findings == ()
        assert str(verdict) == "all servos answer as they should"
        assert np.nanmean(verdict.chi_square) < 12.0


@pytest.mark.parametrize("servo", [(0, 0), (1, 3), (3, 5)])
@pytest.mark.parametrize(
    ("kind", "what", "words"),
    [
        ("stuck", 0.0, "does not move"),
        ("stuck", 0.3, "does not move"),
        ("reversed", None, "turns the wrong way round"),
        ("weak", 0.5, "% of what it is told"),
    ],
)
def test_a_fault_that_shows_in_the_servos_own_answer_is_named(servo, kind, what, words) -> None:
    verdict = TEST.judge(*run({servo: (kind, what)}, np.random.default_rng(11)))
    assert [(each.servo, each.fault) for each in verdict.findings] == [(servo, kind)]
    assert words in str(verdict)
    assert str(verdict).startswith(f"servo {servo[1] + 1} of platform {servo[0] + 1} ")


@pytest.mark.parametrize(("one", "other"), [((0, 0), (0, 3)), ((1, 2), (3, 4)), ((2, 1), (2, 5))])
def test_exchanged_servos_are_named_as_a_pair(one, other) -> None:
    verdict = TEST.judge(*run({one: ("exchanged", other)}, np.random.default_rng(12)))
    assert len(verdict.findings) == 1
    (found,) = verdict.findings
    assert found.fault == "exchanged"
    assert found.servo == one
    assert other in found.others


@pytest.mark.parametrize("servo", [(0, 1), (2, 4)])
@pytest.mark.parametrize("degrees", [-18.0, 18.0])
def test_a_wrong_zero_is_found_with_all_the_servos_it_may_be(servo, degrees) -> None:
    verdict = TEST.judge(*run({servo: ("offset", np.radians(degrees))}, np.random.default_rng(13)))
    (found,) = verdict.findings
    assert found.fault == "offset"
    assert servo in (found.servo, *found.others)
    assert np.degrees(found.size) == pytest.approx(degrees, abs=7.0)
    assert "degrees off its zero" in str(verdict)


def test_two_faults_are_both_named() -> None:
    faults = {(0, 2): ("stuck", 0.1), (3, 1): ("reversed", None)}
    verdict = TEST.judge(*run(faults, np.random.default_rng(14)))
    assert ((0, 2), "stuck") in [(each.servo, each.fault) for each in verdict.findings]
    assert (3, 1) in [each.servo for each in verdict.findings]


def test_a_servo_that_was_not_measured_is_not_called_good() -> None:
    rotations_seen, at_stance = run({}, np.random.default_rng(15))
    rotations_seen[8] = np.nan
    verdict = TEST.judge(rotations_seen, at_stance)
    assert verdict.untested == ((0, 4),)
    assert "servo 5 of platform 1 was not tested" in str(verdict)
    assert np.isnan(verdict.chi_square[0, 4])


def test_servos_in_the_same_place_turn_the_tool_differently_at_the_stance() -> None:
    """At home they would not: all plates level, platform 1's servo 3 turns the tool just as platform 4's."""
    answers = TEST._expected.reshape(4, 6, 6)
    for i in range(4):
        for k in range(i + 1, 4):
            apart = np.linalg.norm(answers[i] - answers[k], axis=-1) / np.linalg.norm(answers[i], axis=-1)
            assert np.min(apart) > 0.05


def test_against_an_earlier_run_a_rigs_own_lean_is_no_fault() -> None:
    own = {
        (0, 0): ("offset", np.radians(10.0)),
        (2, 3): ("offset", np.radians(-8.0)),
        (1, 1): ("offset", np.radians(9.0)),
    }
    test = ServoTest().against(run(own, np.random.default_rng(16)))
    assert test.judge(*run(own, np.random.default_rng(17))).findings == ()
    broken = {**own, (3, 2): ("stuck", 0.2)}
    assert [str(each) for each in test.judge(*run(broken, np.random.default_rng(18))).findings] == [
        "servo 3 of platform 4 does not move"
    ]


def test_moves_are_one_servo_at_a_time_and_within_reach() -> None:
    here = TEST.stance_angles_rad
    for (platform, servo), angles in TEST.moves():
        changed = np.argwhere(angles != here)
        assert changed.tolist() == [[platform, servo]]
        assert bool(plate_pose(angles[platform], FO_SHIP.platforms[platform]).converged)
