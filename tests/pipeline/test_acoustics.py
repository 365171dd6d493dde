"""Records of the array in, fixes out."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.acoustics.message.frame import message_frame_bits
from bluerov_slam.acoustics.message.report import BeaconReport
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import quaternion_from_rotation, rotation_from_euler
from bluerov_slam.pipeline.acoustic_callers import TWO_TEXT
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.acoustics import AcousticPipeline
from bluerov_slam.records import (
    AcousticFix,
    AcousticMessage,
    AcousticRecord,
    NavMode,
    NavState,
    TimeDifferenceReading,
)
from bluerov_slam.simulation.acoustic_paths import Medium
from bluerov_slam.simulation.acoustic_record import AcousticSetup, Window, simulate_record
from samples import ctd_sample

PLACE = (54.3219, 10.1356)
CROSS = ReceiverArray.cross()
OPTIONS = AcousticOptions(array=CROSS, beacon_deg=PLACE, beacon_depth_m=3.0, beacon_std_m=0.0, sound_speed_fixed=True)
LOUD = (300.0, 280.0, 310.0, 290.0)
AHEAD = (20.0, 5.0, 8.0)
PERIOD_S = 25e-6


def reading(
    source: Sequence[float] = AHEAD, at_s: float = 10.0, std: Sequence[float] = LOUD, **changes: Any
) -> TimeDifferenceReading:
    array = changes.pop("array", CROSS)
    delays = array.delays_s(source, changes.pop("speed", 1500.0)) + changes.pop("error_s", 0.0)
    return TimeDifferenceReading(at_s, at_s + 0.02, 0, delays, np.array(std), 0x3C05)


def state(at_s: float, yaw_deg: float = 0.0, depth_m: float = 11.0, **changes: Any) -> NavState:
    quaternion = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, math.radians(yaw_deg)))
    made = NavState(
        at_s, at_s, NavMode.AIDED, PLACE, (0.0, 0.0, depth_m), (0.0, 0.0, 0.0), quaternion, (0.0, 0.0, 0.0),
        1e-6 * np.eye(6), np.eye(3), depth_m, 0.02, None, None, None, None, 0.0, 0,
    )  # fmt: skip
    return replace(made, **changes)


def only(found: list[AcousticFix | AcousticMessage]) -> AcousticFix:
    [fix] = found
    assert isinstance(fix, AcousticFix)
    return fix


def test_delays_alone_give_a_direction() -> None:
    fix = only(AcousticPipeline(OPTIONS).feed(reading()))
    assert fix.accepted
    assert (fix.azimuth_rad, fix.elevation_rad) == pytest.approx(
        (math.atan2(5, 20), math.atan2(8, math.hypot(20, 5))), abs=2e-3
    )
    assert fix.slip_probability is not None
    assert fix.slip_probability < 1e-6
    assert fix.position_deg is None
    assert "attitude" in fix.reason
    assert fix.direction_covariance_rad2 is not None
    # Across the line of sight: what one pulse is worth, and a little for its timing.
    across_rad = math.sqrt(fix.direction_covariance_rad2[0][0]) * math.cos(fix.elevation_rad or 0.0)
    assert across_rad == pytest.approx(OPTIONS.direction_std_rad, rel=0.05)
    assert across_rad > OPTIONS.direction_std_rad


def test_a_quiet_water_that_the_settings_promise_leaves_the_timing() -> None:
    fix = only(AcousticPipeline(replace(OPTIONS, direction_std_rad=0.0)).feed(reading()))
    assert fix.direction_covariance_rad2 is not None
    assert 0.0 < math.sqrt(fix.direction_covariance_rad2[0][0]) < math.radians(0.5)


def test_the_mounting_turns_it_into_the_bodys_axes() -> None:
    looking_down = ArrayMounting(rotation_from_euler(0.0, math.radians(-90.0), 0.0))
    fix = only(AcousticPipeline(replace(OPTIONS, mounting=looking_down)).feed(reading((30.0, 0.0, 0.0))))
    assert fix.elevation_rad == pytest.approx(math.pi / 2, abs=0.01)


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -130.0])
def test_attitude_and_depth_give_the_position(yaw_deg: float) -> None:
    """The beacon lies 20 m ahead, 5 m to starboard and 8 m above a level vehicle."""
    lever = np.array((0.3, 0.1, -0.2))
    pipeline = AcousticPipeline(replace(OPTIONS, mounting=ArrayMounting(np.eye(3), lever)))
    for k in range(20):
        pipeline.observe(state(9.0 + 0.1 * k, yaw_deg, depth_m=11.2))
    fix = only(pipeline.feed(reading((20.0, 5.0, -8.0))))
    assert fix.reason == ""
    turn = rotation_from_euler(0.0, 0.0, math.radians(yaw_deg))
    expected = -(turn @ (np.array((20.0, 5.0, -8.0)) + lever))
    assert fix.position_deg is not None
    north, east, _ = LocalFrame(*PLACE).to_ned_m(*fix.position_deg)
    assert (north, east) == pytest.approx(tuple(expected[:2]), abs=0.2)
    assert fix.range_m == pytest.approx(math.sqrt(20**2 + 5**2 + 8**2), abs=0.2)
    assert fix.covariance_ned_m2 is not None


def test_an_uncertain_heading_makes_the_position_uncertain_across() -> None:
    sure, unsure = np.zeros((6, 6)), np.zeros((6, 6))
    unsure[5, 5] = math.radians(5.0) ** 2
    widths = []
    for covariance in (sure, unsure):
        pipeline = AcousticPipeline(replace(OPTIONS, direction_std_rad=0.0))
        pipeline.observe(state(10.0, pose_covariance=covariance))
        fix = only(pipeline.feed(reading((20.0, 0.0, -8.0))))
        assert fix.covariance_ned_m2 is not None
        widths.append(math.sqrt(fix.covariance_ned_m2[1][1]))
    assert widths[0] < 0.2
    assert widths[1] == pytest.approx(20.0 * math.radians(5.0), rel=0.1)


def test_what_one_pulse_is_worth_makes_the_position_uncertain() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    pipeline.observe(state(10.0, pose_covariance=np.zeros((6, 6))))
    fix = only(pipeline.feed(reading((20.0, 0.0, -8.0))))
    assert fix.covariance_ned_m2 is not None
    assert fix.range_std_m is not None
    # Across by the level range; along by what the elevation makes of a depth that is known.
    assert math.sqrt(fix.covariance_ned_m2[1][1]) == pytest.approx(20.0 * OPTIONS.direction_std_rad, rel=0.1)
    slant_m = math.hypot(20.0, 8.0)
    assert fix.range_std_m == pytest.approx(slant_m * OPTIONS.direction_std_rad * 20.0 / 8.0, rel=0.1)


def test_a_pose_that_is_too_old_is_not_used() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    pipeline.observe(state(9.0))
    assert only(pipeline.feed(reading())).position_deg is None


def test_a_level_transmitter_gives_a_direction_and_says_why_no_more() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    pipeline.observe(state(10.0, depth_m=3.0))
    fix = only(pipeline.feed(reading((20.0, 5.0, 0.0))))
    assert fix.accepted
    assert fix.position_deg is None
    assert fix.reason.startswith("no position: ")


def test_a_depth_that_contradicts_the_angle_is_named() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    pipeline.observe(state(10.0, depth_m=11.0))
    fix = only(pipeline.feed(reading((20.0, 5.0, 8.0))))  # the beacon is above, the sound from below
    assert fix.accepted
    assert fix.position_deg is None


def test_without_a_place_of_the_beacon_there_is_a_range() -> None:
    pipeline = AcousticPipeline(replace(OPTIONS, beacon_deg=None))
    pipeline.observe(state(10.0))
    fix = only(pipeline.feed(reading((20.0, 5.0, -8.0))))
    assert fix.range_m == pytest.approx(22.1, abs=0.3)
    assert "acoustics.beacon" in fix.reason


@pytest.mark.parametrize("receiver", [0, 1, 2, 3])
def test_a_slip_of_one_receiver_is_doubted_with_the_right_delays_among_the_alternatives(receiver: int) -> None:
    right = reading()
    slip = np.zeros(3)
    if receiver:
        slip[receiver - 1] = PERIOD_S
    else:
        slip[:] = -PERIOD_S
    fix = only(AcousticPipeline(OPTIONS).feed(replace(right, delays_s=right.delays_s + slip)))
    assert not fix.accepted
    assert "period" in fix.reason
    choices = [fix.delays_s, *(delays for delays, _ in fix.alternatives)]
    assert any(np.allclose(each, right.delays_s, atol=1e-7) for each in choices)
    assert sum(share for _, share in fix.alternatives) + (1 - (fix.slip_probability or 0)) == pytest.approx(
        1.0, abs=0.01
    )


@pytest.mark.parametrize("receiver", [0, 1, 3])
def test_a_silent_receiver_is_left_out_and_the_rest_carry_on(receiver: int) -> None:
    std = [300.0] * 4
    std[receiver] = 2.0
    broken = reading(std=std)
    delays = broken.delays_s.copy()
    if receiver:
        delays[receiver - 1] = 0.002
    else:
        delays += 0.0007  # what the board took for the reference's arrival was noise
    fix = only(AcousticPipeline(OPTIONS).feed(replace(broken, delays_s=delays)))
    assert fix.excluded == ((receiver, "silent: check its cable"),)
    assert fix.accepted
    assert fix.azimuth_rad == pytest.approx(math.atan2(5, 20), abs=0.03)


def test_an_impossible_delay_leaves_its_receiver_out() -> None:
    right = reading()
    fix = only(AcousticPipeline(OPTIONS).feed(replace(right, delays_s=right.delays_s + np.array((0.0, 0.001, 0.0)))))
    assert [receiver for receiver, _ in fix.excluded] == [2]
    assert fix.azimuth_rad == pytest.approx(math.atan2(5, 20), abs=0.03)


def test_delays_that_were_not_measured_and_noise_alone_are_no_fix() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    unmeasured = only(pipeline.feed(replace(reading(), delays_s=np.array([math.nan, math.nan, 1e-6]))))
    assert not unmeasured.accepted
    assert "only 2" in unmeasured.reason
    noise = only(pipeline.feed(reading(std=(2.0, 2.0, 2.0, 2.0))))
    assert noise.reason.startswith("no receiver heard")
    assert len(noise.excluded) == 4


def test_another_array_than_the_board_has_is_named() -> None:
    fix = only(AcousticPipeline(replace(OPTIONS, array=ReceiverArray.cross(centre=True))).feed(reading()))
    assert not fix.accepted
    assert "4 receivers" in fix.reason
    assert "describe 5" in fix.reason


def test_five_receivers_tell_the_range_by_themselves() -> None:
    five = ReceiverArray.cross(0.5, centre=True)
    options = replace(OPTIONS, array=five, delay_std_s=2e-8, nearest_m=1.0)
    near = reading((4.0, 0.5, 0.5), array=five, std=(300.0,) * 5)
    fix = only(AcousticPipeline(options).feed(near))
    assert fix.range_m == pytest.approx(math.sqrt(4**2 + 0.5), rel=0.1)


def test_the_sound_speed_is_the_ctds_and_else_the_fixed_one() -> None:
    pipeline = AcousticPipeline(replace(OPTIONS, sound_speed_fixed=False))
    assert only(pipeline.feed(reading())).sound_speed_mps == 1500.0
    pipeline.feed(ctd_sample(arrived_s=11.0, sound_speed_mps=1480.0))
    assert only(pipeline.feed(reading(at_s=12.0))).sound_speed_mps == 1480.0
    pipeline.feed(ctd_sample(arrived_s=13.0, sound_speed_mps=None))
    assert only(pipeline.feed(reading(at_s=14.0))).sound_speed_mps == 1480.0
    assert only(pipeline.feed(reading(at_s=1400.0))).sound_speed_mps == 1500.0


def simulated(record_id: int = 4, at_s: float = 10.0) -> AcousticRecord:
    made = simulate_record(AcousticSetup(CROSS, medium=Medium(1500.0), snr_db=25.0), AHEAD, 3)
    counts = np.array(made.samples, np.int16)
    return AcousticRecord(at_s, at_s + 0.3, record_id, made.sample_rate_hz, counts, 12, 0)


def test_a_raw_record_gives_a_fix_of_its_own() -> None:
    fix = only(AcousticPipeline(OPTIONS).feed(simulated()))
    assert fix.accepted
    assert fix.record_id == 4
    assert fix.azimuth_rad == pytest.approx(math.atan2(5, 20), abs=0.01)
    assert all(snr is not None and snr > 15.0 for snr in fix.snr_db)
    assert all(std is not None and std > 100.0 for std in fix.signal_std_counts)


def test_the_record_of_a_pulse_whose_delays_were_taken_says_nothing_new() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    assert only(pipeline.feed(reading(at_s=10.0))).accepted
    assert pipeline.feed(simulated(at_s=10.0)) == []
    assert not only(pipeline.feed(reading(at_s=11.0, std=(300.0, 2.0, 2.0, 2.0)))).accepted
    assert only(pipeline.feed(simulated(at_s=11.0))).accepted  # it does where they were of no use


def test_records_with_much_missing_are_refused() -> None:
    fix = only(AcousticPipeline(OPTIONS).feed(replace(simulated(), missing_samples=700)))
    assert not fix.accepted
    assert "did not arrive" in fix.reason


def test_the_transmitter_tells_its_place_by_board_or_in_a_record() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    said = BeaconReport(54.0, 10.0, 2.0, None, 4.0).pack()
    pipeline.feed(AcousticMessage(10.0, 10.1, 0, said))
    fix = only(pipeline.feed(reading(at_s=20.0)))
    assert fix.beacon_source == "message"
    assert fix.beacon_deg_m == pytest.approx((54.0, 10.0, 4.0))
    assert fix.beacon_std_m == pytest.approx(math.hypot(2.0, 0.3 * 9.92), abs=0.01)
    late = only(pipeline.feed(reading(at_s=1000.0)))
    assert late.beacon_source == "settings"
    pipeline.feed(AcousticMessage(1001.0, 1001.1, 0, b"no report of ours"))
    assert only(pipeline.feed(reading(at_s=1002.0))).beacon_source == "settings"

    setup = AcousticSetup(
        CROSS,
        sample_rate_hz=106_424.0,
        bits=message_frame_bits(7, said),
        window=Window("onset", 19_500, 600),
        snr_db=10.0,
    )
    made = simulate_record(setup, AHEAD, 3)
    record = AcousticRecord(1010.0, 1011.0, 9, made.sample_rate_hz, np.array(made.samples, np.int16), 12, 0)
    [message] = pipeline.feed(record)
    assert isinstance(message, AcousticMessage)
    assert message.payload == said
    assert only(pipeline.feed(reading(at_s=1012.0))).beacon_source == "message"


def test_two_transmitters_give_no_fix_while_nothing_tells_which_is_ours() -> None:
    pipeline = AcousticPipeline(OPTIONS)
    places = ((20.0, 5.0, -8.0), (10.0, -18.0, -6.0))
    fixes = []
    for k in range(20):
        at_s = 10.0 + k - 0.4 * (k % 2)
        pipeline.observe(state(at_s, position_ned_m=None))
        fixes.append(only(pipeline.feed(reading(places[k % 2], at_s=at_s))))
    late = fixes[8:]
    assert not any(fix.accepted or fix.position_deg or fix.alternatives for fix in late)
    assert {fix.reason for fix in late} == {TWO_TEXT}
    for k in range(20, 45):  # one is switched off
        pipeline.observe(state(10.0 + k, position_ned_m=None))
        fixes.append(only(pipeline.feed(reading(places[0], at_s=10.0 + k))))
    assert fixes[-1].accepted


@pytest.mark.parametrize("array", [CROSS, ReceiverArray.cross(centre=True)], ids=["four", "five"])
def test_nothing_that_a_board_can_send_makes_it_raise(array: ReceiverArray) -> None:
    rng = np.random.default_rng(8)
    pipeline = AcousticPipeline(replace(OPTIONS, array=array))
    fixes = []
    for k in range(400):
        count = int(rng.choice([2, 3, 4, 5, 16])) if k % 3 == 0 else len(array)
        delays = rng.normal(0.0, rng.choice([1e-6, 1e-4, 1e-2, 2.0]), count - 1)
        delays[rng.random(count - 1) < 0.1] = math.nan
        std = rng.choice([0.0, 2.0, 100.0, 65535.0], count)
        reference = int(rng.integers(count))
        fixes += pipeline.feed(TimeDifferenceReading(float(k), k + 0.1, reference, delays, std, None))
        if k % 10 == 0:
            shape = (int(rng.choice([1, len(array), 16])), int(rng.choice([1, 10, 500, 2048])))
            counts = rng.integers(-2048, 2047, shape).astype(np.int16)
            rate_hz = float(rng.choice([1.0, 1e3, 1.2e5, 851_393.0, 4e9]))
            fixes += pipeline.feed(AcousticRecord(k + 0.5, k + 0.6, k, rate_hz, counts, 12, 0))
    assert all(fix.accepted or fix.reason for fix in fixes if isinstance(fix, AcousticFix))


def test_the_same_records_give_the_same_fixes() -> None:
    def run() -> list[AcousticFix | AcousticMessage]:
        pipeline, fixes = AcousticPipeline(OPTIONS), []
        for k in range(30):
            pipeline.observe(state(10.0 + k, yaw_deg=3.0 * k))
            fixes += pipeline.feed(reading((20.0, 5.0 - k, -8.0), at_s=10.0 + k))
        return fixes

    assert run() == run()


@pytest.mark.parametrize("true_speed_mps", [1493.0, 1500.0, 1507.0])
def test_a_sound_speed_that_nobody_measured_makes_good_delays_of_an_array_in_space_no_contradiction(
    true_speed_mps: float,
) -> None:
    """Half a percent of sound speed is 0.8 us on a stalk of 25 cm: no slip, and no second source."""
    stalk = ReceiverArray(np.vstack((CROSS.positions_m, (0.25, 0.0, 0.0))))
    pipeline = AcousticPipeline(replace(OPTIONS, array=stalk))
    for source in ((20.0, 5.0, 8.0), (12.0, 20.0, -6.0)):
        fix = only(pipeline.feed(reading(source, array=stalk, std=(300.0,) * 5, speed=true_speed_mps)))
        assert fix.accepted, fix.reason
        assert fix.delays_s == pytest.approx(stalk.delays_s(source, true_speed_mps), abs=1e-9)
        assert fix.azimuth_rad == pytest.approx(math.atan2(source[1], source[0]), abs=0.03)
