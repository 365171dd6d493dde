"""What can be wrong under water, on samples from the virtual board's frames to the sentence: named, and never a lie."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import quaternion_from_rotation
from bluerov_slam.pipeline.acoustic_callers import OTHER_TEXT, TWO_TEXT, WRONG_TEXT
from bluerov_slam.pipeline.acoustic_frames import AcousticInput
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.acoustic_watch import AcousticState, AcousticWatch, AcousticWords
from bluerov_slam.pipeline.acoustics import AcousticPipeline
from bluerov_slam.records import AcousticFix, AcousticRecord, NavMode, NavState, TimeDifferenceReading
from bluerov_slam.simulation.acoustic_board import acoustic_board, rotation_frd_array
from bluerov_slam.simulation.acoustic_plan import AcousticPlan
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.scene import SimulatedScene

PLAN = AcousticPlan(array="cross_with_stalk", record_every=0, message_every=0)
SCENARIO = replace(SCENARIOS["survey"], mission_start_s=60.0)
SECOND = (-30.0, 40.0, 3.0)


@dataclass
class Dive:
    """Fixes with the transmitter that each pulse came from and how far its direction is off, and the page's words."""

    fixes: list[AcousticFix]
    beacons: list[int]
    off_deg: list[float]
    words: AcousticWords

    def accepted(self, beacon: int) -> int:
        return sum(fix.accepted and who == beacon for fix, who in zip(self.fixes, self.beacons, strict=True))


@pytest.fixture(scope="module")
def scene() -> SimulatedScene:
    return SimulatedScene(SCENARIO)


def dive(
    scene: SimulatedScene, plan: AcousticPlan, *, knows_place: bool, until_s: float = 30.0, place_off_m: float = 0.0
) -> Dive:
    board = acoustic_board(replace(SCENARIO, acoustics=plan), scene)
    origin = (scene.origin_latitude_deg, scene.origin_longitude_deg)
    latitude, longitude, _ = LocalFrame(*origin).to_geodetic(plan.beacon_north_m - place_off_m, plan.beacon_east_m)
    mounting = ArrayMounting(rotation_frd_array(plan), np.array(plan.lever_arm_frd_m))
    pipeline = AcousticPipeline(
        AcousticOptions(board.nominal_array, mounting, beacon_deg=(latitude, longitude), beacon_depth_m=2.0)
    )
    receiver, watch, fixes, next_s = AcousticInput(), AcousticWatch(), [], 0.0
    for at_s, frame in board.advance(until_s):
        while next_s < at_s:
            pipeline.observe(_state(scene, next_s, origin, knows_place))
            next_s += 0.05
        for record in receiver.feed(frame, "board", at_s):
            fixes += [fix for fix in pipeline.feed(record) if isinstance(fix, AcousticFix)]
    for fix in fixes:
        watch.observe(fix)
    heard = [pulse for pulse in board.pulses if not pulse.reason][: len(fixes)]
    off_deg = [_off_deg(fix, pulse.direction_frd) for fix, pulse in zip(fixes, heard, strict=True) if fix.accepted]
    return Dive(fixes, [pulse.beacon for pulse in heard], off_deg, watch.words(fixes[-1].arrived_s if fixes else 30.0))


def _state(scene: SimulatedScene, at_s: float, origin: tuple[float, float], knows_place: bool) -> NavState:
    motion = scene.motion(np.array([at_s + 60.0]))
    north_m, east_m, down_m = motion.position_ned_m[0].tolist()
    return NavState(
        at_s, at_s, NavMode.AIDED, origin if knows_place else None,
        (north_m + 1.0, east_m - 1.0, down_m) if knows_place else None, (0.0, 0.0, 0.0),
        quaternion_from_rotation(motion.rotation_ned_frd[0]), (0.0, 0.0, 0.0),
        np.diag((4.0, 4.0, 0.01, 1e-4, 1e-4, 3e-4)), np.eye(3), down_m, 0.05, None, None, None, None, 0.0, 0,
    )  # fmt: skip


def _off_deg(fix: AcousticFix, true_frd: np.ndarray) -> float:
    assert fix.azimuth_rad is not None
    assert fix.elevation_rad is not None
    level = math.cos(fix.elevation_rad)
    seen = (level * math.cos(fix.azimuth_rad), level * math.sin(fix.azimuth_rad), math.sin(fix.elevation_rad))
    return math.degrees(math.acos(min(1.0, float(np.dot(seen, true_frd)))))


def test_without_a_fault_nearly_every_pulse_counts(scene: SimulatedScene) -> None:
    found = dive(scene, PLAN, knows_place=True)
    assert found.accepted(0) > 0.85 * len(found.fixes)
    assert np.median(found.off_deg) < 2.0
    assert max(found.off_deg) < 10.0  # one in twenty comes by an echo
    assert found.words.state is AcousticState.OK


def test_two_transmitters_of_which_nothing_tells_ours_give_no_fix(scene: SimulatedScene) -> None:
    found = dive(scene, replace(PLAN, second_beacon_ned_m=SECOND), knows_place=False)
    assert len(found.fixes) > 50
    assert not any(fix.accepted or fix.alternatives for fix in found.fixes[6:])
    assert Counter(fix.reason for fix in found.fixes).most_common(1)[0][0] == TWO_TEXT
    assert "Two transmitters" in found.words.text
    assert "Switch one of them off" in found.words.cure


def test_of_two_transmitters_ours_goes_on_where_its_place_is_known(scene: SimulatedScene) -> None:
    found = dive(scene, replace(PLAN, second_beacon_ned_m=SECOND), knows_place=True)
    assert found.accepted(1) <= 1
    assert found.accepted(0) > 0.8 * found.beacons.count(0)
    assert max(found.off_deg) < 10.0
    assert sum(fix.reason == OTHER_TEXT for fix in found.fixes) > 20
    assert found.words.state is AcousticState.WARN


def test_a_transmitter_that_is_not_where_ours_should_be_is_held_back(scene: SimulatedScene) -> None:
    found = dive(scene, PLAN, knows_place=True, place_off_m=150.0)
    assert found.accepted(0) <= 3
    # A place so far off may look as an exchange would; then both are named, the place first.
    assert found.fixes[-1].reason.startswith(WRONG_TEXT.partition(";")[0])
    assert "its place" in found.words.cure
    assert found.words.state is AcousticState.FAULT


@pytest.mark.parametrize("fault", ["swapped 0 2", "swapped 1 3"])
def test_opposite_corners_exchanged_are_named_once_the_vehicle_turns(scene: SimulatedScene, fault: str) -> None:
    found = dive(scene, replace(PLAN, faults=(fault,)), knows_place=False, until_s=75.0)
    assert not any(fix.accepted for fix in found.fixes[-6:])
    assert "seem exchanged" in found.fixes[-1].reason
    assert fault.removeprefix("swapped ").replace(" ", " and ") in found.words.text


@pytest.mark.parametrize(
    ("fault", "word"), [("dead 2", "dead"), ("silent 1", "silent"), ("clipped 0", "measured no arrival")]
)
def test_a_faulty_receiver_is_left_out_by_name_and_the_rest_stay_true(
    scene: SimulatedScene, fault: str, word: str
) -> None:
    found = dive(scene, replace(PLAN, faults=(fault,)), knows_place=True)
    assert found.accepted(0) > 0.75 * len(found.fixes)
    assert np.median(found.off_deg) < 3.0
    assert found.words.text.startswith(f"Receiver {fault[-1]}: ")
    assert word in found.words.text


def test_a_transmitter_out_of_range_is_a_silence_with_its_cure(scene: SimulatedScene) -> None:
    found = dive(scene, replace(PLAN, beacon_north_m=900.0), knows_place=True, until_s=8.0)
    assert found.fixes == []
    assert found.words.state is AcousticState.WAITING
    assert "within range" in found.words.cure


@pytest.mark.parametrize(
    ("rate_hz", "samples", "word"),
    [(425_700.0, 2048, "more like"), (851_393.0, 200, "one bit of a pulse"), (50e3, 2048, "sample rate")],
)
def test_a_record_that_cannot_be_right_is_named(scene: SimulatedScene, rate_hz: float, samples: int, word: str) -> None:
    """A wrong rate, and less than one bit of a pulse."""
    board = acoustic_board(replace(SCENARIO, acoustics=replace(PLAN, record_every=1, errors="none")), scene)
    receiver = AcousticInput()
    records = [record for at_s, frame in board.advance(3.0) for record in receiver.feed(frame, "board", at_s)]
    good = next(record for record in records if isinstance(record, AcousticRecord))
    bad = replace(good, sample_rate_hz=rate_hz, samples=good.samples[:, :samples])
    [fix] = AcousticPipeline(AcousticOptions(board.nominal_array)).feed(bad)
    assert isinstance(fix, AcousticFix)
    assert not fix.accepted
    assert fix.position_deg is None
    assert word in fix.reason + " ".join(reason for _, reason in fix.excluded)


def test_receivers_on_a_line_give_no_direction_and_say_so() -> None:
    line = ReceiverArray(np.array([(0.0, 0.2 * k, 0.0) for k in range(4)]))
    delays = line.delays_s((20.0, 5.0, 3.0), 1500.0)

    reading = TimeDifferenceReading(1.0, 1.0, 0, delays, np.full(4, 300.0), None)
    [fix] = AcousticPipeline(AcousticOptions(line)).feed(reading)
    assert isinstance(fix, AcousticFix)
    assert not fix.accepted
    assert "line" in fix.reason
