"""Exchanged receivers on samples, from the virtual board's datagrams to the fix: named, and no direction is given."""

from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ArrayMounting
from bluerov_slam.pipeline.acoustic_frames import AcousticInput
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.acoustic_watch import AcousticState, AcousticWatch
from bluerov_slam.pipeline.acoustics import AcousticPipeline
from bluerov_slam.simulation.acoustic_board import acoustic_board, rotation_frd_array
from bluerov_slam.simulation.acoustic_plan import AcousticPlan
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.scene import SimulatedScene

PLAN = AcousticPlan(array="cross_with_stalk", errors="none", record_every=0, message_every=0)
SCENARIO = replace(SCENARIOS["survey"], mission_start_s=60.0)


@pytest.fixture(scope="module")
def scene():
    return SimulatedScene(SCENARIO)


def _fixes(scene, plan):
    board = acoustic_board(replace(SCENARIO, acoustics=plan), scene)
    mounting = ArrayMounting(rotation_frd_array(plan), np.array(plan.lever_arm_frd_m))
    pipeline, receiver = AcousticPipeline(AcousticOptions(board.nominal_array, mounting)), AcousticInput()
    return [
        fix
        for at_s, frame in board.advance(14.0)
        for record in receiver.feed(frame, "board", at_s)
        for fix in pipeline.feed(record)
    ]


def test_exchanged_receivers_are_named_and_no_direction_is_given(scene):
    fixes = _fixes(scene, replace(PLAN, faults=("swapped 1 2",)))
    assert len(fixes) >= 12
    late = fixes[6:]
    assert not any(fix.accepted for fix in late)
    assert {fix.reason for fix in late} == {
        "receivers 0 and 3 or 1 and 2 seem exchanged; check the order of their plugs and of acoustics.places_m"
    }
    watch = AcousticWatch()
    for fix in fixes:
        watch.observe(fix)
    words = watch.words(fixes[-1].arrived_s)
    assert words.state is AcousticState.FAULT
    assert words.text == "Receivers 0 and 3 or 1 and 2 seem exchanged"
    assert words.cure == "Check the order of their plugs and of acoustics.places_m."


def test_receivers_in_order_are_left_alone(scene):
    fixes = _fixes(scene, PLAN)
    assert sum(fix.accepted for fix in fixes) >= 12
    assert not any("exchanged" in fix.reason for fix in fixes)
