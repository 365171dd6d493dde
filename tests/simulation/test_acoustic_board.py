"""The virtual acoustic board: what it sends, when, and how far that is from the truth."""

from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.acoustics.message.report import BeaconReport
from bluerov_slam.acoustics.receiver_faults import Fault, examine_record, find_swapped
from bluerov_slam.clock import DeviceClock
from bluerov_slam.errors import ConfigError
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.acoustic_messages import NO_DELAY_NS, unpack_message, unpack_record_chunk, unpack_tdoa
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType
from bluerov_slam.records import LinkBytes, TimeDifferenceReading
from bluerov_slam.simulation.acoustic_board import (
    VirtualAcousticBoard,
    acoustic_board,
    fitted_array,
    rotation_frd_array,
)
from bluerov_slam.simulation.acoustic_plan import ERROR_SETS, AcousticPlan, acoustic_plan_from_mapping
from bluerov_slam.simulation.dive import SimulatedDive
from bluerov_slam.simulation.dive_plan import dive_plan_from_mapping
from bluerov_slam.simulation.scenario import SCENARIOS, scenario_from_mapping
from bluerov_slam.simulation.scene import SimulatedScene
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32

SCENARIO = replace(SCENARIOS["survey"], mission_start_s=60.0)
QUIET = AcousticPlan(errors="none", record_every=0, message_every=0)


@pytest.fixture(scope="module")
def scene():
    return SimulatedScene(SCENARIO)


def _board(scene, plan, seed=1):
    return VirtualAcousticBoard(
        plan,
        scene,
        SCENARIO.water,
        SCENARIO.water_depth_m,
        seed,
        mission_start_s=SCENARIO.mission_start_s,
        utc_start_unix_s=SCENARIO.utc_start_unix_s,
    )


def _frames(frames):
    """(instant, type, payload) of every frame; every one is whole."""
    decoder = Esp32FrameDecoder()
    found = [(at_s, *decoded) for at_s, frame in frames for decoded in decoder.feed(frame)]
    assert len(found) == len(frames)
    return found


def _readings(frames):
    return [unpack_tdoa(payload) for _, kind, payload in _frames(frames) if kind == MessageType.ACOUSTIC_TDOA]


def test_without_errors_the_delays_are_those_of_the_geometry(scene):
    board = _board(scene, QUIET)
    readings = _readings(board.advance(12.0))
    heard = [pulse for pulse in board.pulses if not pulse.reason]
    assert len(readings) == len(heard) >= 11
    rotation = rotation_frd_array(QUIET)
    for reading, pulse in zip(readings, heard, strict=True):
        delays_s = np.array(reading.delays_ns) * 1e-9
        assert delays_s == pytest.approx(pulse.delays_s, abs=0.15e-6)
        # The bent ray changes the elevation; in the array's horizontal plane that hardly shows near the horizon.
        direct = board.nominal_array.delays_s(rotation.T @ pulse.direction_frd * pulse.range_m, 1500.0)
        assert delays_s == pytest.approx(direct, abs=6e-6)
        assert reading.reference == 0
        assert reading.frame_bits == 0xFFFF


def test_the_errors_make_slips_outliers_and_a_bias(scene):
    board = _board(scene, AcousticPlan(record_every=0, message_every=0, pulse_period_s=0.5))
    readings = _readings(board.advance(30.0))
    heard = [pulse for pulse in board.pulses if not pulse.reason]
    error_us = np.array([r.delays_ns for r in readings]) * 1e-3 - 1e6 * np.array([p.delays_s for p in heard])
    in_cell = np.abs(error_us).max(axis=1) < 8.0
    assert 0.7 < in_cell.mean() < 1.0
    bias_us = np.median(error_us[in_cell], axis=0)
    assert 0.1 < np.abs(bias_us).max() < 3.0  # what the receivers' resonances do
    assert np.std(error_us[in_cell], axis=0).max() < 2.0
    # Against the straight geometry there are mounting, wander and bent rays on top.
    nominal = [
        board.nominal_array.delays_s(rotation_frd_array(board.plan).T @ p.direction_frd * p.range_m, 1500.0)
        for p in heard
    ]
    assert np.abs(np.array([p.delays_s for p in heard]) - nominal).max() > 1e-6


def test_records_come_on_request_and_at_their_rate(scene):
    board = _board(scene, replace(QUIET, record_every=5))
    frames = _frames(board.advance(11.0))
    chunks = [unpack_record_chunk(payload) for _, kind, payload in frames if kind == MessageType.ACOUSTIC_RECORD]
    assert sorted({chunk.record_id for chunk in chunks}) == [1, 2]
    first = [chunk for chunk in chunks if chunk.record_id == 1]
    assert sum(len(chunk.samples) for chunk in first) == 2048
    assert {chunk.trigger_index for chunk in first} == {448}
    assert {chunk.sample_rate_hz for chunk in first} == {851_393}
    asking = _board(scene, QUIET)
    asking.advance(3.0)
    asking.request_record()
    kinds = [kind for _, kind, _ in _frames(asking.advance(5.0))]
    assert kinds.count(MessageType.ACOUSTIC_RECORD) == len(first)


def test_a_record_holds_the_pulse_that_its_time_differences_came_from(scene):
    board = _board(scene, replace(QUIET, record_every=3))
    frames = _frames(board.advance(4.5))
    readings = {unpack_tdoa(p).t_us: unpack_tdoa(p) for _, kind, p in frames if kind == MessageType.ACOUSTIC_TDOA}
    chunks = [unpack_record_chunk(p) for _, kind, p in frames if kind == MessageType.ACOUSTIC_RECORD]
    samples = np.concatenate([chunk.samples for chunk in chunks]).T
    std_counts = np.rint(samples.std(axis=1, ddof=1))
    assert readings[chunks[0].t_us].signal_std == tuple(int(each) for each in std_counts)


def test_messages_say_where_the_beacon_is(scene):
    plan = replace(QUIET, message_every=4)
    board = _board(scene, plan)
    frames = _frames(board.advance(9.5))
    messages = [unpack_message(p) for _, kind, p in frames if kind == MessageType.ACOUSTIC_MESSAGE]
    assert len(messages) == 2
    report = BeaconReport.unpack(messages[0].payload)
    north_m = (report.latitude_deg - SCENARIO.origin_latitude_deg) * 111_180.0
    assert north_m == pytest.approx(plan.beacon_north_m, abs=0.1)
    assert report.depth_m == plan.beacon_depth_m
    fourth = board.pulses[3]
    assert report.time_mark_us == round((SCENARIO.utc_start_unix_s + fourth.sent_s) * 1e6) % 3_600_000_000
    told = [unpack_tdoa(p).frame_bits for _, kind, p in frames if kind == MessageType.ACOUSTIC_TDOA]
    assert [bits != 0xFFFF for bits in told[:8]] == [False] * 3 + [True] + [False] * 3 + [True]
    assert told[3] >> 8 == 0b111100


def test_stamps_are_of_the_board_s_own_clock(scene):
    board = _board(scene, replace(QUIET, errors="nominal"), seed=5)
    clock = DeviceClock()
    frames = _frames(board.advance(30.0))
    heard = [pulse for pulse in board.pulses if not pulse.reason]
    off_s = []
    for (at_s, _, payload), pulse in zip(frames, heard, strict=True):
        measured_s = clock.map_us32(unpack_tdoa(payload).t_us, at_s)
        off_s.append(measured_s - pulse.arrived_s)
        assert at_s > pulse.arrived_s
    # Its shortest delay to us, 45 ms and more, cannot be told from the clock's offset.
    assert np.ptp(off_s[10:]) < 0.015
    assert abs(np.median(off_s)) < 0.08


def test_the_beacon_s_clock_is_slow(scene):
    board = _board(scene, replace(QUIET, errors="nominal"), seed=2)
    board.advance(10.0)
    periods_s = np.diff([pulse.sent_s for pulse in board.pulses])
    assert np.ptp(periods_s) < 1e-9
    assert 1.0 < periods_s[0] < 1.03
    assert np.diff([pulse.sent_s for pulse in _sent(scene, QUIET)]) == pytest.approx(1.0, abs=1e-12)


def _sent(scene, plan):
    board = _board(scene, plan)
    board.advance(5.0)
    return board.pulses


def test_a_distant_beacon_is_not_heard(scene):
    board = _board(scene, replace(QUIET, beacon_north_m=900.0))
    assert board.advance(5.0) == []
    assert {pulse.reason for pulse in board.pulses} == {"too weak to trip the trigger"}


def test_a_board_that_is_busy_misses_pulses(scene):
    board = _board(scene, replace(QUIET, record_every=1, pulse_period_s=0.1))
    board.advance(4.0)
    assert sum(pulse.reason == "the board was still busy" for pulse in board.pulses) > 10


def test_the_thesis_s_chain_works_in_whole_samples(scene):
    board = _board(scene, replace(QUIET, chain="thesis", pre_trigger_samples=0))
    for reading in _readings(board.advance(6.0)):
        steps = np.array(reading.delays_ns) * 1e-9 * 275e6 / 323
        assert steps == pytest.approx(np.rint(steps), abs=1e-3)


def test_the_same_seed_gives_the_same_bytes_in_any_steps(scene):
    plan = AcousticPlan()
    whole = _board(scene, plan, 3).advance(8.0)
    stepped = _board(scene, plan, 3)
    pieces = [frame for step in range(1, 81) for frame in stepped.advance(0.1 * step)]
    assert [frame for _, frame in whole] == [frame for _, frame in pieces][: len(whole)]
    assert [frame for _, frame in _board(scene, plan, 4).advance(8.0)] != [frame for _, frame in whole]


def test_over_the_esp32_s_line_the_frames_stand_between_its_own():
    scenario = replace(SCENARIO, acoustics=replace(QUIET, link="serial"), ping_period_ms=0)
    esp32 = VirtualEsp32(scenario)
    data = b"".join(esp32.advance(0.02 * step) for step in range(1, 300))
    decoder = Esp32FrameDecoder()
    kinds = [kind for kind, _ in decoder.feed(data)]
    esp32.close()
    assert decoder.counters.checksum_errors == 0
    assert kinds.count(MessageType.ACOUSTIC_TDOA) in (5, 6)
    assert kinds.count(MessageType.SENSORS) > 5


def test_the_scenario_with_a_beacon_has_a_board():
    scenario = SCENARIOS["beacon"]
    assert scenario.acoustics is not None
    assert acoustic_board(scenario, SimulatedScene(scenario)).plan.link == "udp"


def test_a_plan_is_read_from_a_scenario_s_table():
    scenario = scenario_from_mapping(
        {"acoustics": {"beacon_north_m": 90, "chain": "thesis", "mounting_rpy_deg": [0, 0, 45], "link": "serial"}}
    )
    assert scenario.acoustics == AcousticPlan(
        beacon_north_m=90.0, chain="thesis", mounting_rpy_deg=(0.0, 0.0, 45.0), link="serial"
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"beacon": 3}, "unknown key 'beacon'"),
        ({"chain": "magic"}, "chain must be one of band_limited, thesis"),
        ({"beacon_depth_m": -3}, r"beacon_depth_m must be 0\.1\.\.1000"),
        ({"mounting_rpy_deg": [1, 2]}, "must be three numbers"),
        ({"record_every": True}, "record_every must be a int"),
        ({"arm_m": "long"}, "arm_m must be a float"),
    ],
)
def test_a_wrong_plan_is_named(values, message):
    with pytest.raises(ConfigError, match=message):
        acoustic_plan_from_mapping(values)


def test_no_errors_means_none():
    assert ERROR_SETS["none"].shadowed_share == 0.0
    assert ERROR_SETS["none"].beacon_watch_s > 0.0


@pytest.mark.parametrize(
    ("fault", "found"),
    [("dead 2", Fault.DEAD), ("silent 1", Fault.SILENT), ("clipped 3", Fault.CLIPPED)],
)
def test_a_faulty_receiver_shows_in_the_record(scene, fault, found):
    board = _board(scene, replace(QUIET, record_every=1, faults=(fault,)))
    frames = _frames(board.advance(1.6))
    chunks = [unpack_record_chunk(p) for _, kind, p in frames if kind == MessageType.ACOUSTIC_RECORD]
    samples = np.concatenate([chunk.samples for chunk in chunks if chunk.record_id == 1]).T
    (finding,) = examine_record(samples, chunks[0].sample_rate_hz)
    assert (finding.fault, finding.receivers) == (found, (int(fault[-1]),))


def test_exchanged_receivers_show_in_the_delays(scene):
    board = _board(scene, replace(QUIET, faults=("swapped 1 2",)))
    delays_s = np.array([reading.delays_ns for reading in _readings(board.advance(8.0))]) * 1e-9
    finding = find_swapped(delays_s, board.nominal_array, 1500.0)
    assert finding is not None
    assert "1 and 2" in finding.text


def test_a_dead_receiver_s_delay_is_not_measured(scene):
    board = _board(scene, replace(QUIET, faults=("dead 2",)))
    for reading in _readings(board.advance(4.0)):
        assert [delay == NO_DELAY_NS for delay in reading.delays_ns] == [False, True, False]


def test_two_beacons_are_heard_in_turn(scene):
    plan = replace(QUIET, second_beacon_ned_m=(-30.0, 40.0, 3.0))
    board = _board(scene, plan)
    readings = _readings(board.advance(10.0))
    heard = [pulse for pulse in board.pulses if not pulse.reason]
    assert len(readings) == len(heard)
    assert {pulse.beacon for pulse in heard} == {0, 1}
    directions = [pulse.direction_frd for pulse in heard]
    assert np.degrees(np.arccos(np.clip(directions[0] @ directions[1], -1.0, 1.0))) > 20.0


@pytest.mark.parametrize("fault", ["dead", "dead 4", "odd 1", "swapped 1", "swapped 1 1", "dead x"])
def test_a_fault_that_makes_no_sense_is_named(fault):
    with pytest.raises(ConfigError, match="is none of dead N"):
        AcousticPlan(faults=(fault,))


def test_a_whole_dive_has_the_array_on_the_esp32_s_line():
    plan = dive_plan_from_mapping({"base": "beacon", "legs": 1, "leg_m": 12.0, "afloat_first_s": 5.0})
    plan = replace(plan, acoustics=replace(plan.acoustics, pulse_period_s=1.0, errors="none"))
    dive = SimulatedDive(plan, 3)
    decoder = LinkDecoder()
    readings = [
        record
        for received in dive.inputs()
        if isinstance(received, LinkBytes)
        for record in decoder.feed(received.data, received.arrived_s)
        if isinstance(record, TimeDifferenceReading)
    ]
    assert len(readings) > 0.8 * plan.duration_s
    array, mounting = fitted_array(plan.acoustics), rotation_frd_array(plan.acoustics)
    for reading in readings[20::10]:
        # The pulse is under way for hundredths of a second; the vehicle turns by hundredths of a degree meanwhile.
        truth = dive.truth.at(reading.measured_s)
        centre_m = truth.position_ned_m + truth.rotation_ned_frd @ plan.acoustics.lever_arm_frd_m
        way_m = np.array([90.0, 40.0, 14.5]) - centre_m
        source_m = (truth.rotation_ned_frd @ mounting).T @ way_m
        off_s = reading.delays_s - array.delays_s(source_m, 1507.0)
        assert np.abs(off_s).max() < 20e-6  # bent rays


def test_a_plan_s_table_reaches_the_dive():
    plan = dive_plan_from_mapping({"acoustics": {"beacon_depth_m": 7}})
    assert plan.acoustics.beacon_depth_m == 7.0
    with pytest.raises(ConfigError, match="unknown key 'depth'"):
        dive_plan_from_mapping({"acoustics": {"depth": 7}})
